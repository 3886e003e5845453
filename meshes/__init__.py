"""Mesh generators: one geometry per file, a function of its dimensions that returns a `Mesh`; also flashtemp.meshes."""

if __name__ != "flashtemp.meshes":
    raise ImportError("import flashtemp.meshes, not meshes: a second copy breaks isinstance")
