"""Names and words of set-up errors: names for files, sentences for reports."""

from __future__ import annotations

import numpy as np

from flashtemp.discovery.parameters import Kind, ParameterId
from flashtemp.discovery.prediction.problem import Problem

SETUP_ERROR_NAMES = {Kind.SCALE: "pixel_scale", Kind.TURN: "image_turn", Kind.CLOCK: "clock"}
BLOCK_SIZE_NAMES = {"block.length": "block_length", "block.width": "block_width"}
SETUP_ERROR_UNITS = {Kind.SCALE: "1", Kind.TURN: "degree", Kind.CLOCK: "s", Kind.SIZE: "1"}
ALL_IMAGES_WORDS = {
    "sidewall": "all side walls",
    "wake": "all wakes",
    "profile": "all profiles",
    "points": "all points",
}


def setup_error_name(p: ParameterId) -> str:
    """The name of a set-up error in files, as a cause.

    >>> setup_error_name(ParameterId(Kind.SCALE, file="wall.nc"))
    'pixel_scale'
    >>> setup_error_name(ParameterId(Kind.SIZE, name="block.length"))
    'block_length'
    """
    return BLOCK_SIZE_NAMES[p.name] if p.kind is Kind.SIZE else SETUP_ERROR_NAMES[p.kind]


def describe_setup_error(problem: Problem, p: ParameterId, value: float) -> str:
    """A set-up error in words; its `value` is relative for scales and sizes, else in rad or s."""
    where = ALL_IMAGES_WORDS.get(p.name, p.name) if p.name else p.file.rpartition("/")[2]
    if p.kind is Kind.SCALE:
        return f"the pixel scale of {where} is {100.0 * abs(value):.2g} % too {'small' if value > 0 else 'large'}"
    if p.kind is Kind.TURN:
        way = "anticlockwise" if value > 0 else "clockwise"
        return f"the image of {where} has to be rotated {way} by {np.degrees(abs(value)):.2g} degrees"
    if p.kind is Kind.CLOCK:
        return f"the time stamps of {where} are {abs(value):.2g} s too {'late' if value > 0 else 'early'}"
    stated = problem.case[p.name]
    side = p.name.rpartition(".")[2]
    return (
        f"the block's {side} is {1e3 * stated * (1.0 + value):.4g} mm, {100.0 * abs(value):.2g} % "
        f"{'larger' if value > 0 else 'smaller'} than stated"
    )
