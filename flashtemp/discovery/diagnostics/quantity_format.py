"""Numbers with units as sentences of a verdict write them."""

from __future__ import annotations

import numpy as np

from flashtemp.discovery.verdict import InputCorrection

CHANGE_STANDARD_ERRORS = 2.0  # by which an rms value must change not to be called unchanged: 1 in 20 by chance


def format_digits(value: float, count: int = 4) -> str:
    """A number to some significant digits, without a power of ten for values of everyday size.

    >>> format_digits(150000.0), format_digits(7134.4, 2), format_digits(1.5e-7), format_digits(0.9600001)
    ('150000', '7100', '1.5e-07', '0.96')
    """
    if value and 1e-4 <= abs(value) < 1e6:
        return np.format_float_positional(value, precision=count, unique=False, fractional=False, trim="-")
    return f"{value:.{count}g}"


def unit_suffix(unit: str) -> str:
    """A unit after a space; nothing for "1"."""
    return "" if unit == "1" else f" {unit}"


def format_error(value: float, unit: str) -> str:
    """The size of an error of the set-up.

    >>> format_error(0.0123, "1"), format_error(2.0, "degree"), format_error(0.02, "s")
    ('1.2 %', '2 degrees', '0.02 s')
    """
    if unit == "1":
        return f"{100.0 * value:.2g} %"
    return f"{value:.2g} {'degrees' if unit == 'degree' else unit}"


def format_kelvin(T: float) -> str:
    """A difference in kelvin, below one in millikelvin.

    >>> format_kelvin(1.132), format_kelvin(0.0131)
    ('1.13 K', '13.1 mK')
    """
    return f"{T:.3g} K" if T >= 1.0 else f"{1e3 * T:.3g} mK"


def is_within_noise(before: float, after: float, error: float) -> bool:
    """Whether two numbers differ by no more than chance explains; `error` of the change, NaN if unknown.

    >>> is_within_noise(0.0587, 0.06, 0.001), is_within_noise(0.0587, 0.06, float("nan"))
    (True, False)
    """
    return abs(after - before) < CHANGE_STANDARD_ERRORS * error


def correction_words(h: InputCorrection) -> str:
    """A stated number that the data contradict, as a sentence without its end."""
    unit = unit_suffix(h.unit)
    needed = f"{format_digits(h.value)} +- {format_digits(h.stderr, 2)}{unit} (ln Bayes factor {h.ln_bayes:.0f})"
    return f"{h.key} is stated as {format_digits(h.told)}{unit}; the data require {needed}"


def wrong_input_words(h: InputCorrection) -> str:
    """A stated number with the value that would explain the data.

    >>> wrong_input_words(InputCorrection("friction.mu", 0.7, 0.983, 0.021, "1", 0.4, "friction"))
    'friction.mu is 0.983 +- 0.021 instead of 0.7'
    """
    needed = f"{format_digits(h.value)} +- {format_digits(h.stderr, 2)}{unit_suffix(h.unit)}"
    return f"{h.key} is {needed} instead of {format_digits(h.told)}{unit_suffix(h.unit)}"
