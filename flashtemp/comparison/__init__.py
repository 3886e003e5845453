"""Measured against computed: campaigns of recordings and load cells, their noise, and twins with a hidden effect."""
