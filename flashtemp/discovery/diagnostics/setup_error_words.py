"""What errors of a laboratory are called: names for files and words for people."""

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
    """As a cause is called in files.

    >>> setup_error_name(ParameterId(Kind.SCALE, file="wall.nc")), setup_error_name(ParameterId(Kind.SIZE, name="block.length"))
    ('pixel_scale', 'block_length')
    """
    return BLOCK_SIZE_NAMES[p.name] if p.kind is Kind.SIZE else SETUP_ERROR_NAMES[p.kind]


def describe_setup_error(problem: Problem, p: ParameterId, value: float) -> str:
    """An error in plain words; `value` relative, in rad or in s."""
    where = ALL_IMAGES_WORDS.get(p.name, p.name) if p.name else p.file.rpartition("/")[2]
    if p.kind is Kind.SCALE:
        return f"the pixel scale of {where} is {100.0 * abs(value):.2g} % too {'small' if value > 0 else 'large'}"
    if p.kind is Kind.TURN:
        way = "anticlockwise" if value > 0 else "clockwise"
        return f"the image of {where} has to be turned {way} by {np.degrees(abs(value)):.2g} degrees"
    if p.kind is Kind.CLOCK:
        return f"the frames of {where} are stamped {abs(value):.2g} s too {'late' if value > 0 else 'early'}"
    told = problem.case[p.name]
    side = p.name.rpartition(".")[2]
    return (
        f"the block's {side} is {1e3 * told * (1.0 + value):.4g} mm, {100.0 * abs(value):.2g} % "
        f"{'more' if value > 0 else 'less'} than stated"
    )
