"""Pictures of finished results: one per file, each a function that returns a figure."""

if __name__ != "flashtemp.viz":
    raise ImportError("import flashtemp.viz, not viz: a second copy breaks isinstance")
