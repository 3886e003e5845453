"""The transient heat equation: finite volumes in block and road, their interface, and integration in time by CVODE."""
