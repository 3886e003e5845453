"""What is checked before and after a run: effects, inert inputs, stability, the error of the mesh."""
