"""Errors of the measurement: recordings that are not what they are stated to be, images that lie elsewhere."""
