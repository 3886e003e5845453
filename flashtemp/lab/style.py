"""The visual style of all pages: colours for light and dark, spacing, type scale, as one style sheet.

Colours are custom properties of CSS, so that a page states what a colour is for and never its value.  Every pair of
text and ground has a contrast of at least 4.5:1 (Web Content Accessibility Guidelines 2.2, criterion 1.4.3).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

# role of a colour: (light, dark)
COLOURS: Final = {
    "ground": ("#F6F5F2", "#151412"),  # behind everything
    "surface": ("#FFFFFF", "#1F1D1B"),  # of cards
    "sunken": ("#EEECE7", "#2A2825"),  # of command lines, tracks, placeholders
    "line": ("#DAD7D0", "#3B3834"),  # borders and grid lines
    "text": ("#1D1B19", "#EFECE7"),
    "muted": ("#5C5852", "#B5B0A8"),  # text of second rank
    "accent": ("#8C2D04", "#FFAD80"),  # the one accent colour
    "on-accent": ("#FFFFFF", "#1D1B19"),  # text on it
    "accent-soft": ("#F7E7DF", "#3D2A20"),  # behind what is chosen
    "good": ("#1E6B35", "#7FD69A"),
    "warning": ("#7A4A00", "#FFC966"),
    "error": ("#A31515", "#FF9C92"),
    "series-1": ("#8C2D04", "#FFAD80"),  # lines of charts: distinguishable with the usual colour blindness (Wong 2011)
    "series-2": ("#0060A0", "#6CB8F0"),
    "series-3": ("#00735C", "#3FCFA8"),
    "series-4": ("#8A4A78", "#E0A0CC"),
    "series-5": ("#5C5852", "#B5B0A8"),
}  # fmt: skip
SPACE_PX: Final = (4, 8, 12, 16, 24, 32)  # --space-1 ... --space-6
TEXT_REM: Final = {"small": 0.8125, "body": 0.9375, "large": 1.125, "title": 1.5}

ASSETS: Final = Path(__file__).parent / "assets"  # style sheets and scripts of the pages


def style_sheet() -> str:
    """The style sheet of the pages: custom properties of both colour schemes, spacing and type, then `pages.css`."""
    shared = [f"--space-{k}: {px}px" for k, px in enumerate(SPACE_PX, 1)]
    shared += [f"--text-{name}: {rem}rem" for name, rem in TEXT_REM.items()]
    light, dark = ([f"--{role}: {pair[k]}" for role, pair in COLOURS.items()] for k in (0, 1))
    return (
        f":root {{ {'; '.join([*shared, *light])}; color-scheme: light }}\n"
        f"body.body--dark {{ {'; '.join(dark)}; color-scheme: dark }}\n{read_asset('pages.css')}"
    )


def read_asset(name: str) -> str:
    """The text of a style sheet or script of the pages."""
    return (ASSETS / name).read_text(encoding="utf-8")
