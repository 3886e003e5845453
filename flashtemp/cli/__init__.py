"""The commands of flashtemp, one file per group of commands."""
