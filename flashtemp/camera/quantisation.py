"""Coarse digits of a camera: their step, and how often noise repeats one by chance."""

from __future__ import annotations

from math import erf

import numpy as np

MAX_DIGIT_VALUES = 20_000  # values from which the quantisation step is determined


def quantisation_step(temperature: np.ndarray) -> float:
    """Quantisation step (K) that divides all differences between values; 0 where there is none or it is below 1 mK."""
    values = temperature[np.isfinite(temperature)][:MAX_DIGIT_VALUES]
    different = np.unique(values)
    steps = np.diff(different)
    steps = steps[steps > 1e-6]  # smaller ones are rounding
    if len(steps) < 2 or 2 * len(different) > len(values) or (step := float(steps.min())) < 1e-3:
        return 0.0
    return step if np.all(np.abs(steps / step - np.round(steps / step)) < 0.01) else 0.0


def likeliest_digit_probability(temperature: np.ndarray, sigma: float) -> float:
    """Probability of the likeliest digit of Gaussian noise whose standard deviation with rounding is `sigma` (K).

    Rounding adds the square of the step over 12 to the variance.

    >>> round(likeliest_digit_probability(np.array([0.0, 0.1, 0.3, 0.1, 0.0, 0.2, 0.3, 0.1, 0.2]), 0.1), 2)
    0.4
    """
    step = quantisation_step(temperature)
    noise = np.sqrt(max(sigma**2 - step**2 / 12.0, 0.0))
    return erf(step / (np.sqrt(8.0) * noise)) if noise > 0.0 else 1.0
