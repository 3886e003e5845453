"""What commands and notebooks call: one function per command, each returns an object that shows itself.

The first argument is a path or what has been loaded from it; `overrides` {"table.key": value} change a case;
`out` is a new folder or file, nothing is written without it; `say` is told about progress in words.
"""
