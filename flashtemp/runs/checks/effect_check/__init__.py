"""Checks of an effect against the rules of the catalogue: its file, its laws and its heat balance."""
