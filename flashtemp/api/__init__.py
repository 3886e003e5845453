"""The Python interface: one function per command, each of which returns an object with a text and an HTML table.

The first argument is a path or the object loaded from it.  `overrides` {"table.key": value} change a case.  `out` is a
new folder or file; nothing is written without it.  `say` is called with progress messages.
"""
