"""Colours of temperatures: the maps of matplotlib as short tables, between whose entries the page interpolates."""

from __future__ import annotations

from typing import Final

PALETTE_TABLES: Final = {  # name in matplotlib: equally spaced colours from the lowest to the highest temperature
    "inferno": "0000040b0724210c4a3d096557106e71196e8a226aa32c61bc3754d24644e45a31f1731df98e09fcac11f9cb35f2ea69fcffa4",
    "gray": "000000ffffff",
    "gray_r": "ffffff000000",
    "turbo": "30123b4040a2466be34294ff28bceb18ddc232f2986dfe62a4fc3ccdec34eecf3afdac34fb7e21eb500ed02f05a916017a0403",
    "viridis": "44015448186a472d7b4240863b528b33638d2c728e26828e21918c1fa08828ae803fbc735ec96284d44baddc30d8e219fde725",
}
PALETTE_LABELS: Final = {  # what the page calls them
    "inferno": "iron (inferno)", "gray": "grey", "gray_r": "grey, inverted", "turbo": "rainbow (turbo)",
    "viridis": "viridis",
}  # fmt: skip
HEX_DIGITS = 6  # of one colour


def palette_colours(name: str) -> list[str]:
    """The colours of a palette as `#rrggbb`, from the lowest to the highest temperature."""
    table = PALETTE_TABLES[name]
    return [f"#{table[k : k + HEX_DIGITS]}" for k in range(0, len(table), HEX_DIGITS)]


def labelled_palettes() -> dict[str, list[str]]:
    """{label: colours} of all palettes, the usual one first."""
    return {label: palette_colours(name) for name, label in PALETTE_LABELS.items()}
