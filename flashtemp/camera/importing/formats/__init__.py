"""Readers of camera files, one module per format.

A module with `MAGIC`, a tuple of first bytes, and `read(file: CameraFile) -> Iterator[RawFrames]` is found by itself
(`flashtemp.camera.importing.readers.find_formats`); the other modules are shared by the readers.
"""
