"""Friction of rubber on rough ground from a master curve and a power spectrum: contact, sources, flash, tyre."""
