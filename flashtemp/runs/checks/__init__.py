"""Checks before and after a run: effects, inactive effects, stick-slip stability, error of the mesh."""
