"""Curves and tables of a case, from rows in the case or a CSV file beside it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flashtemp.errors import BadInput
from flashtemp.physics.interpolation import Curve, Surface, read_rows, read_surface, read_xy_pairs

CURVE = Curve((0.0, 1.0, 3.0), (2.0, 4.0, 3.0))
SURFACE = Surface((0.1, 1.0), (20.0, 60.0, 100.0), ((0.8, 0.6, 0.3), (0.9, 0.7, 0.5)))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.floats(-2.0, 5.0))
def test_curve_is_the_broken_line(at):
    assert CURVE(at) == pytest.approx(np.interp(at, CURVE.x, CURVE.y), rel=1e-14)
    assert CURVE(np.array([at, 0.5]))[0] == CURVE(at)


def test_curve_passes_the_derivative_on():
    """Inside by the slope, outside not at all: what the complex step of the Jacobian needs."""
    at = np.array([-1.0, 0.5, 2.0, 4.0])
    slope = np.imag(CURVE(at + 1e-30j)) / 1e-30
    np.testing.assert_allclose(slope, [0.0, 2.0, -0.5, 0.0], rtol=1e-14, atol=0)
    assert isinstance(CURVE(0.5), float)
    assert isinstance(CURVE(0.5 + 1e-30j), complex)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.floats(0.0, 2.0), st.floats(0.0, 120.0))
def test_surface_is_bilinear_and_held_outside(u, v):
    ends = [np.interp(v, SURFACE.v, z) for z in SURFACE.z]
    assert SURFACE(u, v) == pytest.approx(np.interp(u, SURFACE.u, ends), rel=1e-13)


def test_surface_passes_the_derivative_on():
    at = np.array([0.0, 40.0, 80.0, 110.0]) + 1e-30j
    np.testing.assert_allclose(np.imag(SURFACE(0.1, at)) / 1e-30, [0.0, -0.005, -0.0075, 0.0], rtol=1e-13, atol=0)


def test_surface_of_one_node():
    assert Surface((0.1,), (20.0,), ((0.8,),))(5.0, 300.0) == 0.8
    assert Surface((0.1,), (20.0, 40.0), ((0.8, 0.6),))(5.0, 30.0) == pytest.approx(0.7)
    assert Surface((0.1, 1.0), (20.0,), ((0.8,), (0.6,)))(0.55, 30.0) == pytest.approx(0.7)


def test_file_as_people_write_it(tmp_path):
    """Byte-order mark, comment, header, blank line, blanks around numbers, no newline at the end."""
    text = "\ufeff# made by hand\ntime_s, v_m_s\n\n0, 0.10\n 1.5 ,2e-1\n# stop\n3,0.3"
    (tmp_path / "v.csv").write_text(text, encoding="utf-8")
    assert read_rows("v.csv", tmp_path, "schedule.speed", 2).tolist() == [[0.0, 0.1], [1.5, 0.2], [3.0, 0.3]]
    assert read_xy_pairs("v.csv", tmp_path, "schedule.speed") == ((0.0, 1.5, 3.0), (0.1, 0.2, 0.3))


def test_rows_in_the_case_and_in_a_file_are_the_same(tmp_path):
    (tmp_path / "t.csv").write_text("v,T,mu\n1,20,0.9\n0.1,60,0.6\n0.1,20,0.8\n1,60,0.7\n")
    inline = [[0.1, 20, 0.8], [0.1, 60, 0.6], [1, 20, 0.9], [1, 60, 0.7]]
    assert read_surface("t.csv", tmp_path, "friction.table") == read_surface(inline, tmp_path, "friction.table")
    assert read_surface(inline, tmp_path, "k")(0.1, 40.0) == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ([], "no rows"),
        ([[0, 1], [1]], "row 2"),
        ([[0, 1], [1, "x"]], "'x'"),
        ([[0, 1], [1, float("nan")]], "nan"),
        ([[0, 1], [0, 2]], "increase"),
        ([[0, 1], [1, -2]], ">= 0"),
        ("nowhere.csv", "nowhere.csv"),
    ],
)
def test_refused_with_key_and_place(source, words, tmp_path):
    with pytest.raises(BadInput) as fault:
        read_xy_pairs(source, tmp_path, "contact.pressure", low=0.0)
    [line] = fault.value.lines
    assert line.startswith("contact.pressure: ")
    assert words in line


@pytest.mark.parametrize(
    "source",
    [
        [[0.1, 20, 0.8], [0.1, 60, 0.6], [1, 20, 0.9]],
        [[0.1, 20, 0.8], [0.1, 20, 0.8]],
        [[0.1, 20, 1.0], [0.1, 20, 0.8], [1, 60, 1.0], [1, 60, 1.0]],
    ],
    ids=["one missing", "one twice", "as many twice as missing"],
)
def test_grid_needs_every_node_once(source, tmp_path):
    with pytest.raises(BadInput, match="^k: "):
        read_surface(source, tmp_path, "k")
