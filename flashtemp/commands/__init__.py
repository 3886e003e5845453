"""The commands of flashtemp, one function each; `__main__` puts them together."""
