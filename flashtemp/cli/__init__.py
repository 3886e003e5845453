"""The commands of flashtemp, one module per group of commands."""
