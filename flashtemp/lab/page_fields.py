"""What messages of the command line call an option, in the words of the camera page and its fields."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from flashtemp.errors import FlashtempError
from flashtemp.lab.page_layout import show_error

OPTION_WORDS: Final = {  # option with its arguments: what the page calls it; the longest form first
    "give --fps and --start, or --times FILE.csv": "enter the frame rate and the time of the first frame, or choose a"
    " table of times",
    "give --repetition N, --starts with the time of each start of sliding, --case, or a column repetition in --times": (
        "enter the starts of sliding (0 where there is one), or choose a table of times with a column repetition"
    ),
    "--fps and --start, or --times": "enter the frame rate and the time of the first frame, or choose a table of times",
    "--times FILE.csv": "a table of times",
    "--times": "a table of times",
    "--fps": "the frame rate",
    "--starts": "the starts of sliding",
    "--start": "the time of the first frame",
    "--view sidewall, wake, profile or points": "the view",
    "--view points": "view = 'points' in a template",
    "--view": "the view",
    "--downstream right, left, up or down": "both edges of the block on the image",
    "--downstream": "both edges of the block on the image",
    "--up left or right": "the direction 'up is'",
    "--up": "the direction 'up is'",
    "--pixel COLUMN ROW of the leading edge at the interface": "the leading edge on the image",
    "--pixel COLUMN ROW": "the leading edge on the image",
    "--mm-per-pixel (or a --second point)": "the trailing edge on the image",
    "--mm-per-pixel": "the length of the block",
    "--second": "the trailing edge on the image",
    "four times --point COLUMN ROW U_MM V_MM": "all four corners on the image",
    "--was.emissivity": "the emissivity in the export",
    "--was.reflected": "the reflected temperature in the export",
    "--emissivity": "the emissivity",
    "--reflected": "the reflected temperature",
    "--netd": "the noise of one pixel",
    "--scale": "the scale",
    "--offset": "the offset",
    "--unit": "the unit",
    "--decimal": "the decimal mark",
    "--rows": "the rows of one image",
    "--labels": "the labels",
    "--variable NAME": "the name of the array",
    "--variable": "the name of the array",
    "--below": "the lowest temperature",
}
KNOWN_OPTIONS: Final = re.compile(
    "|".join(rf"{re.escape(words)}(?![\w-])" for words in sorted(OPTION_WORDS, key=len, reverse=True))
)
OTHER_OPTIONS: Final = re.compile(r"(?<![\w-])--([a-z][a-z-]*(?:\.[a-z]+)?)")


def name_page_fields(text: str) -> str:
    """A message of the command line with the fields of the page in place of options; others become template keys.

    >>> name_page_fields("give --start, s of the first frame after the first start of sliding")
    'give the time of the first frame, s of the first frame after the first start of sliding'
    >>> name_page_fields("dead pixels masked (--dead-pixels keep leaves them)")
    'dead pixels masked (dead_pixels in the template keep leaves them)'
    """
    named = KNOWN_OPTIONS.sub(lambda found: OPTION_WORDS[found[0]], text)
    return OTHER_OPTIONS.sub(lambda found: f"{found[1].replace('-', '_')} in the template", named)


@contextmanager
def show_file_errors(folder: Path) -> Iterator[None]:
    """Context manager: show errors of camera files in place, with the fields of the page and names in `folder`."""
    try:
        yield
    except (FlashtempError, OSError) as fault:
        show_error(name_page_fields(str(fault)), folder)
