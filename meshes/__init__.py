"""Geometries: one per file, each a function of dimensions that returns a Mesh; installed as flashtemp.meshes."""

if __name__ != "flashtemp.meshes":
    raise ImportError("import flashtemp.meshes, not meshes: a second copy breaks isinstance")
