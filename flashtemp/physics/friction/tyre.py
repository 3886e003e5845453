"""Side force of a tyre: the cold-hot law over an elliptic footprint, with rigid or shearing (brush) bristles.

A line of the footprint at y has the length l(y) = l0 sqrt(1 - (2y/b)^2), l0 = 4F/(pi p b).  At a slip angle a the road
moves sideways under every bristle at v_R tan(a).  Rigid bristles slide over ls = l tan(a) at that speed, and (V24)

    <mu> = mu_hot + (mu_cold - mu_hot) (r0/ls)(1 - exp(-ls/r0)),    ls = l(y) tan(a), weighted by l(y)

>>> import numpy as np
>>> from flashtemp.physics.friction.cold_hot_law import ColdHotLaw, FrictionBranch
>>> v, zero = np.array([1e-3, 99.0]), np.zeros(2)
>>> cold, hot = (FrictionBranch(v, np.full(2, mu), zero, zero) for mu in (1.0, 0.5))
>>> tyre = Tyre(speed=27.0, width=0.14, pressure=3e5)
>>> force = rigid_side_force(tyre, ColdHotLaw(cold, hot, 2e-3), [3000.0], [2.0])
>>> print(f"{1e3 * tyre.footprint_length(3000.0):.1f} mm", force.round(4))
90.9 mm [[0.7772]]
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import minimize_scalar

from flashtemp.errors import SolverFailure
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction.cold_hot_law import ColdHotLaw
from flashtemp.physics.friction.curve_peak import CurvePeak, find_peak
from flashtemp.physics.friction.tread_block import FootprintPath, TreadBlock, is_chattering, pass_footprint

FOOTPRINT_LINES = 96  # Gauss points across the footprint
BRUSH_STEPS = 1000  # steps along its longest line
CONTROL_LAWS = ("cold", "hot")  # the law with both branches equal
COMPARED_LAWS = ("law", *CONTROL_LAWS)
TYRE_MODELS = ("rigid", "brush")
MIN_FORCE_FALL = 1e-3  # relative decrease of side force over load above which it counts as falling
MAX_SLIP_ANGLE_DEG, MIN_SLIP_ANGLE_DEG = 45.0, 0.01  # range of slip angles in the search for a maximum
ANGLE_RATIO, ANGLES_PER_EXTENSION = 1.15, 4  # ratio of successive angles; angles added before the next check


@dataclass(frozen=True)
class Tyre:
    """Rolling `speed` m/s, `width` b of the footprint m, its `pressure` Pa, uniform and independent of load."""

    speed: float
    width: float
    pressure: float

    def footprint_length(self, load: Value) -> Value:
        """Longest line l0 (m) of the footprint at a load (N)."""
        return 4.0 * np.asarray(load) / (np.pi * self.pressure * self.width)

    def lateral_speed(self, angles: Value) -> Value:
        """Lateral speed (m/s) of the road under the tyre at slip angles (deg)."""
        return self.speed * np.tan(np.radians(angles))

    def footprint_lines(self, load: Value) -> tuple[np.ndarray, np.ndarray]:
        """Lengths (FOOTPRINT_LINES,) m of lines across the footprint, and the widths (m) that they represent."""
        cos, weight = _lateral_quadrature()
        return self.footprint_length(load) * cos, self.width * weight


@cache
def _lateral_quadrature() -> tuple[np.ndarray, np.ndarray]:
    """l/l0 and weights (fractions of the width) at Gauss points of the angle asin(2y/b), smooth at the ends."""
    x, w = np.polynomial.legendre.leggauss(FOOTPRINT_LINES)
    cos = np.cos(0.25 * np.pi * (x + 1))  # both halves are alike
    return cos, 0.25 * np.pi * w * cos


def rigid_side_force(tyre: Tyre, law: ColdHotLaw, loads: Value, angles: Value) -> np.ndarray:
    """Side force over load (n_loads, n_angles) with rigid bristles, V24; loads N, slip angles deg > 0."""
    angles = np.asarray(angles, dtype=float)
    cold, hot = law.branch_friction(tyre.lateral_speed(angles))
    out = []
    for load in loads:
        length, width = tyre.footprint_lines(load)
        x = np.multiply.outer(length, np.tan(np.radians(angles))) / law.memory_distance(tyre.lateral_speed(angles))
        mean = hot + (cold - hot) * -np.expm1(-x) / x
        out.append((width * length) @ mean / (width @ length))
    return np.array(out)


def rigid_force_peak(tyre: Tyre, law: ColdHotLaw, load: float, angles: Value) -> CurvePeak:
    """Maximum of `rigid_side_force` between the smallest and the largest of the slip angles (deg)."""
    angles = np.asarray(angles, dtype=float)
    i = int(np.argmax(rigid_side_force(tyre, law, [load], angles)[0]))
    if i in (0, len(angles) - 1):
        value = float(rigid_side_force(tyre, law, [load], angles[[i]])[0, 0])
        return CurvePeak(float(angles[i]), value, i == 0, i == len(angles) - 1)
    optimum = minimize_scalar(
        lambda a: -rigid_side_force(tyre, law, [load], [a])[0, 0],
        bounds=(angles[i - 1], angles[i + 1]),  # neighbours of the highest angle bracket the maximum
        method="bounded",
        options={"xatol": 1e-7},
    )
    return CurvePeak(float(optimum.x), float(-optimum.fun))


def make_bristle(tyre: Tyre, loads: Value, stiffness: float, mass: float) -> TreadBlock:
    """A bristle of `stiffness` (Pa/m) and `mass` (kg/m2) as a tread block on the longest line of all loads (N)."""
    return TreadBlock(tyre.speed, float(np.max(tyre.footprint_length(loads))), stiffness, mass, tyre.pressure)


def brush_side_force(
    tyre: Tyre, law: ColdHotLaw, loads: Value, angles: Value, stiffness: float, mass: float, steps: int = BRUSH_STEPS
) -> Value:
    """Side force over load (n_loads, n_angles) of shearing bristles, and the FootprintPath of a bristle at every angle.

    All bristles at one angle follow the same path, which ends earlier on short lines.  Raises SolverFailure.
    """
    tread = make_bristle(tyre, loads, stiffness, mass)
    path = pass_footprint(tread, law, np.tan(np.radians(np.asarray(angles, dtype=float))), steps)
    force = _line_force(tread, path)
    out = []
    for load in loads:
        length, width = tyre.footprint_lines(load)
        out.append(width @ force(length / tyre.speed) / load)
    return np.array(out), path


def _line_force(tread: TreadBlock, path: FootprintPath) -> CubicHermiteSpline:
    """Side force per width (N/m) of a line that a bristle passes in t (s): int k_t u v_R dt."""
    rate = tread.stiffness * tread.speed * path.shear
    dt = path.time[1]
    bend = np.gradient(rate, dt, axis=0)
    parts = 0.5 * dt * (rate[1:] + rate[:-1]) - dt * dt / 12 * (bend[1:] - bend[:-1])
    return CubicHermiteSpline(path.time, np.concatenate([np.zeros_like(rate[:1]), np.cumsum(parts, axis=0)]), rate)


@dataclass(frozen=True, eq=False)
class CorneringResult:
    """Side force over load (n_loads, n_angles) of every model and law in `curves`, their maxima in `peaks`.

    Keys are (model, law): "rigid" or "brush"; "law", or the controls "cold" and "hot".  `loads` N, `angles` deg, T0 K.
    Maxima are compared where every load has one inside the range of angles.
    """

    tyre: Tyre
    law: ColdHotLaw
    bristle: TreadBlock
    T0: float
    loads: np.ndarray
    angles: np.ndarray
    curves: dict[tuple[str, str], np.ndarray]
    peaks: dict[tuple[str, str], tuple[CurvePeak, ...]]
    chatter: bool

    def has_inner_peaks(self, model: str, law: str = "law") -> bool:
        """Whether every load has its maximum inside the slip angles."""
        return not any(p.is_at_edge for p in self.peaks[model, law])

    def peak_fall(self, model: str, law: str = "law") -> float | None:
        """Relative decrease of the maximum side force over load from the lowest to the highest load.

        None where a load has no maximum inside the slip angles.
        """
        if not self.has_inner_peaks(model, law):
            return None
        first, last = self.peaks[model, law][0].value, self.peaks[model, law][-1].value
        return float(1.0 - last / first)

    def has_peak_fall(self, model: str) -> bool:
        """Whether the law's maximum side force over load is known to fall with load."""
        fall = self.peak_fall(model)
        return fall is not None and fall > MIN_FORCE_FALL

    def has_flat_controls(self, model: str) -> bool | None:
        """Whether no control falls with load; a decrease by the law is then caused by the flash temperature alone.

        A control without an inner maximum is compared at the angles of the law's maxima, the same for both loads.  None
        where the law has no inner maximum.
        """
        if not self.has_inner_peaks(model):
            return None
        return all(self._control_fall(model, control) <= MIN_FORCE_FALL for control in CONTROL_LAWS)

    def _control_fall(self, model: str, control: str) -> float:
        fall = self.peak_fall(model, control)
        if fall is not None:
            return fall
        at = np.log([p.at for p in self.peaks[model, "law"]])
        first, last = (np.interp(at, np.log(self.angles), self.curves[model, control][i]) for i in (0, -1))
        return float(np.max(1.0 - last / first))

    def rising_up_to_deg(self, model: str) -> float | None:
        """Largest slip angle (deg) if the law's side force still rises there at one of the loads, else None."""
        return float(self.angles[-1]) if any(p.last for p in self.peaks[model, "law"]) else None

    def as_dict(self) -> dict[str, Any]:
        """Numbers for JSON; slip angles in degrees, loads in N, lengths in m."""
        flat_controls = [self.has_flat_controls(model) for model in TYRE_MODELS]
        maxima = [
            {"model": model, "law": law, "load_N": float(load), "mu": p.value, "angle_deg": p.at,
             "at_edge": p.is_at_edge, "at_first": p.first, "at_last": p.last}
            for (model, law), peaks in self.peaks.items()
            for load, p in zip(self.loads, peaks, strict=True)
        ]  # fmt: skip
        return {
            "maxima": maxima,
            "fall": {model: self.peak_fall(model) for model in TYRE_MODELS},
            "no_maximum_up_to_deg": {model: self.rising_up_to_deg(model) for model in TYRE_MODELS},
            "fall_of_controls": {f"{m}, both {c}": self.peak_fall(m, c) for m in TYRE_MODELS for c in CONTROL_LAWS},
            "controls_hold": None if None in flat_controls else all(flat_controls),
            "footprint_length_m": [float(self.tyre.footprint_length(load)) for load in self.loads],
            "memory_m": float(self.law.memory_distance(self.tyre.lateral_speed(self.peaks["brush", "law"][0].at))),
            "ringing": self.ringing_ratio,
            "chatter": self.chatter,
            "curves": {f"{m}, {c}": v.tolist() for (m, c), v in self.curves.items()},
            "angles_deg": self.angles.tolist(),
            "loads_N": self.loads.tolist(),
        }

    @property
    def ringing_ratio(self) -> float:
        """Period of a bristle's oscillation over the contact time of the shortest footprint."""
        return self.bristle.ringing_ratio * self.bristle.footprint / float(self.tyre.footprint_length(self.loads.min()))

    def csv_rows(self) -> Iterator[str]:
        """Columns and rows of the curves."""
        names = list(self.curves)
        yield "load_N,angle_deg," + ",".join("_".join(n) for n in names)
        for i, load in enumerate(self.loads):
            for j, angle in enumerate(self.angles):
                yield f"{load:g},{angle:g}," + ",".join(f"{self.curves[n][i, j]:.8g}" for n in names)


def compute_cornering(
    tyre: Tyre,
    law: ColdHotLaw,
    loads: Value,
    angles: Value,
    stiffness: float,
    mass: float,
    T0: float,
    watch: Callable[..., Any] | None = None,
    steepest: float = MAX_SLIP_ANGLE_DEG,
) -> CorneringResult:
    """Side force over slip angle (deg) at every load (N), rigid and brush, with the law and its controls.

    More than one angle: the range is extended, down to MIN_SLIP_ANGLE_DEG and up to `steepest`, until it contains every
    maximum of the law.  `watch(done, total)` is called after every law.  Raises SolverFailure.
    """
    loads, angles = np.sort(np.asarray(loads, dtype=float)), np.sort(np.asarray(angles, dtype=float))
    if len(angles) > 1:
        angles = _extend_angles(tyre, law, loads, angles, stiffness, mass, steepest)
    curves, peaks, chatter = {}, {}, False
    for n, name in enumerate(COMPARED_LAWS):
        one = law if name == "law" else law.without_memory(name)
        curves["rigid", name] = rigid_side_force(tyre, one, loads, angles)
        peaks["rigid", name] = tuple(rigid_force_peak(tyre, one, load, angles) for load in loads)
        curves["brush", name], path = brush_side_force(tyre, one, loads, angles, stiffness, mass)
        peaks["brush", name] = tuple(find_peak(angles, mu) for mu in curves["brush", name])
        chatter |= bool(is_chattering(path, tyre.lateral_speed(angles)).any())
        if watch:
            watch(n + 1, len(COMPARED_LAWS))
    return CorneringResult(
        tyre, law, make_bristle(tyre, loads, stiffness, mass), T0, loads, angles, curves, peaks, chatter
    )


def _extend_angles(
    tyre: Tyre, law: ColdHotLaw, loads: np.ndarray, angles: np.ndarray, stiffness: float, mass: float, steepest: float
) -> np.ndarray:
    """The angles (deg), extended until the law's side force falls towards both ends, for every load and model.

    Angles at which the speed of a bristle is not found are left out.
    """
    kept = angles
    while True:
        try:
            curves = [
                rigid_side_force(tyre, law, loads, angles),
                brush_side_force(tyre, law, loads, angles, stiffness, mass)[0],
            ]
        except SolverFailure:
            return kept
        tops, kept = [find_peak(angles, mu) for curve in curves for mu in curve], angles
        more = []
        if any(t.last for t in tops) and angles[-1] < steepest:
            more += [min(angles[-1] * ANGLE_RATIO**k, steepest) for k in range(1, ANGLES_PER_EXTENSION + 1)]
        if any(t.first for t in tops) and angles[0] > MIN_SLIP_ANGLE_DEG:
            more += [max(angles[0] / ANGLE_RATIO**k, MIN_SLIP_ANGLE_DEG) for k in range(1, ANGLES_PER_EXTENSION + 1)]
        if not more:
            return angles
        angles = np.unique(np.concatenate([angles, more]))
