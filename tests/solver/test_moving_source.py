"""A source that moves over the face of a block: against cosine series in closed form, and what it gives in all."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from flashtemp.model.case import load_case
from flashtemp.solver.time_integration import integrate_schedule

K, RC, L, H, W = 40.0, 3.7e6, 0.04, 0.006, 0.015  # a small steel block
CASE = f"""
effects = ["moving_source"]
[materials.steel]
conductivity = {K}
density = 7400.0
heat_capacity = 500.0
[block]
material = "steel"
length = {L}
height = {H}
width = {W}
[road]
depth = 0.001
upstream = 0.0
downstream = 0.0
[ambient]
convection = 0.0
[numerics]
cells = [40, 12, 3]
first_x = 1e-3
last_x = 1e-3
first_block = 2e-4
rtol = 1e-6
"""
SPEED, WIDTH, STRENGTH = 2e-3, 2e-3, 1e3


def run(folder, given):
    (folder / "case.toml").write_text(CASE)
    case = load_case(folder / "case.toml", {k if "." in k else f"moving_source.{k}": v for k, v in given.items()})
    return integrate_schedule(case.scene, case.settings)


def series(x, z, t, enters=2.0, modes=40, deep=150):
    """Rise (x, z) at a time in a block insulated all round: cosines of x and z, their heat linear between many times."""
    s, m = np.linspace(0.0, t, 1501), np.arange(modes)
    at = np.linspace(0.0, L, 801)
    at = 0.5 * (at[1:] + at[:-1])
    flux = (
        np.exp(-0.5 * ((at - SPEED * (s[:, None] - enters)) / WIDTH) ** 2) * STRENGTH / (WIDTH * np.sqrt(2.0 * np.pi))
    )
    along = flux @ np.cos(np.pi * m * at[:, None] / L) * (L / 800)  # (s, m)
    whole = np.zeros((len(x), len(z)))
    dt = s[1]
    for n in range(deep):
        rate = np.maximum(K / RC * np.pi**2 * ((m / L) ** 2 + (n / H) ** 2), 1e-9)
        mean = -np.expm1(-rate * dt) / rate
        late = (dt - mean) / (rate * dt)  # share of a step's end value, the rest is that of its beginning
        heat = np.sum(((mean - late) * along[:-1] + late * along[1:]) * np.exp(-rate * (t - s[1:, None])), axis=0)
        norm = np.where(m > 0, 2.0, 1.0) * (2.0 if n else 1.0) / (L * H * RC)
        whole += np.outer((norm * heat) @ np.cos(np.pi * m[:, None] * x / L), np.cos(np.pi * n * z / H))
    return whole


def test_a_line_that_moves_over_the_face_is_the_cosine_series(tmp_path, lab):
    """After 12 s it is half way: second order in the cells, and about (dx/width)^2/12 of the largest rise off."""
    errors = []
    for mesh in (1.0, 2.0):
        own = {"speed": SPEED, "width": WIDTH, "strength": STRENGTH, "enters": 2.0}
        found = run(tmp_path, own | {"schedule.alone": 12.0, "numerics.mesh": mesh})
        z = 0.5 * (found.mesh.height[1:] + found.mesh.height[:-1])
        exact = series(found.x, z, 12.0)
        errors.append(float(np.abs(found.field[-1][found.mesh.block] - 20.0 - exact).max() / exact.max()))
        assert found.x[np.argmax(found.T_block[-1])] == pytest.approx(0.019, abs=0.0015)  # just behind the source
    lab.check("moving line, of the largest rise", errors[0], 0.5**2 / 12)
    lab.check("the same on cells of half the size", errors[1], 0.25**2 / 12)
    assert errors[1] < errors[0] / 3.0


def test_both_arcs_and_the_chips_give_what_they_say(tmp_path, lab):
    """3D: strength over speed per pass, the trailing arc and the chips besides; tilt and edges only share it out."""
    own = {
        "speed": SPEED, "width": WIDTH, "strength": STRENGTH, "enters": 5.0, "radius": 0.01, "axis": 0.002, "back": 0.5,
        "back_width": 3e-3, "tilt": 0.4, "back_tilt": 0.2, "edges": 0.5, "chips": 0.2, "chips_width": 3e-3, "chips_ahead": 0.005,
    }  # fmt: skip
    given = {"schedule.alone": 45.0, "numerics.across": 8, "numerics.rtol": 1e-4, "numerics.cells": [40, 6, 3]}
    found = run(tmp_path, own | given)
    exact = STRENGTH * L / SPEED * (1.0 + 0.5 + 0.2)  # J per metre of width: strength times the time over the block
    lab.check("heat of a pass, relative", abs(found.energy["block"][-1] / exact - 1.0), 5e-3)
    assert abs(found.energy_imbalance) < 1e-13
    face = found.maps["T_block"][-1].reshape(-1, 8)
    assert (face[:, -1] > face[:, 0]).all()  # tilted towards y > 0


def test_what_bites_at_first_and_what_heaps_up_is_its_integral_over_time_and_face(tmp_path, lab):
    """Error functions along x, Gauss points across, a fine sum over time; and more of it on the side where it bites."""
    own = {
        "speed": SPEED, "width": WIDTH, "strength": STRENGTH, "enters": 5.0, "radius": 0.01, "edges": 0.5,
        "chips": 0.6, "chips_width": 3e-3, "chips_ahead": 0.005, "chips_rise": 8.0, "chips_tilt": 0.3,
        "bite": 4.0, "bite_length": 5e-3, "bite_tilt": -1.0,
    }  # fmt: skip
    given = {"schedule.alone": 45.0, "numerics.across": 8, "numerics.rtol": 1e-4, "numerics.cells": [40, 6, 3]}
    found = run(tmp_path, own | given)

    def on_the_block(centre, width):
        return ndtr((L - centre) / width) - ndtr(-centre / width)

    t = np.linspace(0.0, 45.0, 45001)[:, None]
    e, share = np.polynomial.legendre.leggauss(16)
    come = SPEED * (t - 5.0)
    begun = np.maximum(t - 5.0, 0.0)
    bend = 0.01 - np.sqrt(0.01**2 - (e * W / 2) ** 2)
    more = 1.0 + 4.0 * (1.0 - e) * np.exp(-SPEED * begun / 5e-3)
    arc = (1.0 + 0.5 * (e * e - 1 / 3)) * more * on_the_block(come - bend, WIDTH)
    chips = 0.6 * (1.0 + 0.3 * e) * (1.0 - np.exp(-begun / 8.0)) * on_the_block(come + 0.005, 3e-3)
    exact = STRENGTH * np.trapezoid(0.5 * (arc + chips) @ share, t[:, 0])
    lab.check("heat of a pass that bites, relative", abs(found.energy["block"][-1] / exact - 1.0), 5e-3)
    assert exact > 1.05 * STRENGTH * np.trapezoid(0.5 * (arc / more + chips) @ share, t[:, 0])  # the bite is seen
    early, plain = (run(tmp_path, own | given | {"schedule.alone": 7.0, "bite": b}) for b in (4.0, 0.0))
    face = (early.maps["T_block"][-1] - plain.maps["T_block"][-1]).reshape(-1, 8)
    assert face[0, 0] > 2.0 * face[0, -1] > 0.0  # the second is what was conducted


def test_a_round_tool_comes_to_the_side_walls_later(tmp_path):
    """At the time when the tip stands at x = 20 mm, the leading arc is R - sqrt(R^2 - y^2) behind it at the wall."""
    own = {"speed": 1e-2, "width": 1e-3, "strength": STRENGTH, "enters": 0.0, "radius": 0.009}
    found = run(tmp_path, own | {"schedule.alone": 2.0, "numerics.across": 9, "numerics.rtol": 1e-4})
    face = found.maps["T_block"][-1].reshape(-1, 9)
    middle, wall = found.x[face[:, 4].argmax()], found.x[face[:, 0].argmax()]
    y = W / 2 - W / 18
    assert middle - wall == pytest.approx(0.009 - np.sqrt(0.009**2 - y**2), abs=1e-3)


def test_a_source_that_comes_after_a_long_rest_is_not_stepped_over(tmp_path, lab):
    """Nothing happens for 250 s, then it passes within 4 s: an integrator that may take any step would miss it."""
    own = {"speed": 1e-2, "width": WIDTH, "strength": STRENGTH, "enters": 250.0}
    given = {"schedule.alone": 500.0, "numerics.rtol": 1e-3, "numerics.cells": [20, 4, 3], "numerics.first_x": 2e-3}
    found = run(tmp_path, own | given | {"numerics.last_x": 2e-3})
    lab.check("heat of a late pass, relative", abs(found.energy["block"][-1] / (STRENGTH * L / 1e-2) - 1.0), 5e-3)
