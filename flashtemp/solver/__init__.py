"""The transient heat equation: finite volumes in block and road, the interface between them, CVODE, the march."""
