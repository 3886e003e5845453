"""Coarse digits of a camera: their step, how often noise repeats one by chance, and dither for robust estimates."""

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


def add_dither(values: np.ndarray, step: float, seed: int = 0) -> np.ndarray:
    """Values with uniform noise of the width of one `step`, the same for a `seed`; unchanged if the step is 0.

    Medians and shortest intervals of rounded values are multiples of the step.  With this dither the values are
    continuous again, and their variance is larger by step^2/12 (Gray & Stockham, IEEE Trans. Inf. Theory 39, 1993,
    805).
    """
    if step <= 0.0:
        return values
    return values + step * (np.random.default_rng(seed).random(values.shape) - 0.5)


def remove_dither(sigma: float, step: float) -> float:
    """Standard deviation of rounded values from that with dither; not below that of the rounding itself."""
    return float(np.sqrt(max(sigma**2 - step**2 / 12.0, step**2 / 12.0)))


def likeliest_digit_probability(temperature: np.ndarray, sigma: float) -> float:
    """Probability of the likeliest digit of Gaussian noise whose standard deviation with rounding is `sigma` (K).

    Rounding adds the square of the step over 12 to the variance.

    >>> round(likeliest_digit_probability(np.array([0.0, 0.1, 0.3, 0.1, 0.0, 0.2, 0.3, 0.1, 0.2]), 0.1), 2)
    0.4
    """
    step = quantisation_step(temperature)
    noise = np.sqrt(max(sigma**2 - step**2 / 12.0, 0.0))
    return erf(step / (np.sqrt(8.0) * noise)) if noise > 0.0 else 1.0
