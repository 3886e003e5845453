"""Fluxes into rubber and road where they touch, spots on average (Level H), eliminated between the two half-cells.

Unknown per depth line is the flux J_R into the rubber per spot area; everything else follows.
With T_m the rubber temperature where it touches inside the spots (theory 1.4 eqs. (9)-(12)):
    T_m = T_0 + A J_R + c q,   A = phi h_R + R_flash + R_micro,   c q = flash of the volumetric part
    J_R = g [(chi r + h_S) q_a - (T_0 - T_lane) - c q],        g = 1/(A + h_S + r)
and q = m mu(T_m), m = p v/phi, closes it: one scalar equation per line, solved by Newton.  Of q the share F s(T_m) is
released in depth (c = s(T_m) `deep`), the rest is q_a.  The spots' own mean is R_micro J_R below T_m.
Where spots are resolved A = h_R, and block and road are heated through what is covered at the moment.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.model.effect_laws import COMPLEX_STEP
from flashtemp.physics.quantities import KELVIN
from flashtemp.solver import kernels_contact
from flashtemp.solver.kernels_contact import common_dtype
from flashtemp.solver.road_frame import RoadOverlap


class ContactState(NamedTuple):
    """What the contact laws give along the block (lines,), apart from temperature.

    `m` = p v/phi (W/m2 per unit mu) of the spots, `phi` contact fraction and `covered` its mean over the length,
    `pressure` local nominal pressure (Pa), `r` = 1/alpha, without bound where the block lifts off, `flash` (m2 K/W) of
    spots and `micro` of micro-contacts, `lane` rise of the lanes in contact over that of the road's column, `widen`
    (n_road,) share of a column's rise in each cell, deepest first, by which its surface falls below it as lanes widen,
    `fall` times as much in the lanes, `split` chi, `inside` share F of the heat released in depth, `deep` flash of
    those deposits (m2 K/W).
    """

    heat_per_mu: np.ndarray
    phi: np.ndarray
    covered: float
    pressure: np.ndarray
    resistance: np.ndarray
    flash_resistance: np.ndarray
    micro_resistance: np.ndarray
    lane_ratio: np.ndarray
    loss_ratio: np.ndarray
    spreading_weights: np.ndarray
    heat_split: np.ndarray
    depth_fraction: float
    depth_flash: np.ndarray
    block_coverage: (
        np.ndarray
    )  # share of its area through which a column's block cell is heated: phi while spots are averaged
    road_coverage: (
        np.ndarray
    )  # that of its road cell, which stands for a constant share of the width: 1 where spots cover it
    half_cell_factor: np.ndarray  # factor on the block's half cell: what one spot heats, averaged over what all do
    touched_road: RoadOverlap  # the road under the columns
    rim_resistance: Any = (
        0.0  # m2 K/W by which road that a column of cells holds in part is hotter there than on average
    )
    lane_history: Any = None  # `lanes.Apart`, where `lane` and `fall` have still to follow from the temperatures
    lane_slopes: Any = None  # `lanes.Follow`, where they did


class ContactFluxes(NamedTuple):
    """Result of the interface: per spot area W/m2, temperatures in K."""

    into_block: np.ndarray  # J_R
    into_road: np.ndarray  # J_S
    heat: np.ndarray  # q, all friction heat per spot area
    deep: np.ndarray  # its part in depth
    mu: np.ndarray
    touch: np.ndarray  # rubber temperature where it touches the road, which friction feels
    spot: np.ndarray  # its mean in the spots: the same without micro-contacts
    lane: np.ndarray  # road surface temperature in the lanes


class FluxSlopes(NamedTuple):
    """Derivatives with respect to the first cell temperatures of the block (0) and of the road's column (1)."""

    block: tuple[np.ndarray, np.ndarray]  # of J_R
    road: tuple[np.ndarray, np.ndarray]  # of J_S
    heat: tuple[np.ndarray, np.ndarray]  # of q
    deep: tuple[np.ndarray, np.ndarray]  # of its part in depth
    spot: tuple[np.ndarray, np.ndarray]  # of the temperature in the spots
    mu: tuple[np.ndarray, np.ndarray]


def solve_fluxes(state: ContactState, T0, Ts, half_block, half_road, friction, depth_factor, guess=None, slopes=False):
    """Fluxes, and with `slopes` their derivatives, else None, for first-cell temperatures T0, Ts in K (lines,).

    `Ts` is that of the lanes (`Interface.lanes`), `half_block`, `half_road` are half-cell resistances m2 K/W,
    `friction(T, face, apart)` is the friction coefficient at the temperatures in the spots and of the block's face
    around them, `depth_factor` likewise the factor s on the share in depth, 1 if None; `apart` asks for slopes in these
    temperatures alone.  Raises SolverFailure when the friction law has no consistent temperature.
    """
    half, flash, micro, r, split, deep_flash, m, T0, Ts, half_block, half_road = common_dtype(
        state.half_cell_factor,
        state.flash_resistance,
        state.micro_resistance,
        state.resistance,
        state.heat_split,
        state.depth_flash,
        state.heat_per_mu,
        T0,
        Ts,
        half_block,
        half_road,
    )
    solved = kernels_contact.eliminate_fluxes(
        half,
        flash,
        micro,
        r,
        split,
        deep_flash,
        m,
        state.depth_fraction,
        depth_factor is not None,
        T0,
        Ts,
        half_block,
        half_road,
    )
    a, gain, turn = solved[4:]
    seen: list[Any] = [None, None, None]  # where both laws were asked last, and their answers

    def heating_law(T, face, apart=False):
        seen[:] = T, friction(T, face, apart), depth_factor(T, face, apart)
        return seen[1] * (1.0 + (np.real(turn) if apart else turn) * seen[2])

    T, mu, own = _solve_spot_temperature(a, gain, T0, friction if depth_factor is None else heating_law, guess, slopes)
    s = mu
    if depth_factor is not None:
        mu, s = (
            (friction(T, T0), depth_factor(T, T0))
            if np.iscomplexobj(T)
            else _extrapolate_laws(seen[0], seen[1], seen[2], T)
        )
    T, mu, s, solved, m, deep_flash, micro, Ts, half_road = common_dtype(
        T, mu, s, solved, m, deep_flash, micro, Ts, half_road
    )
    J, S, q, deep, spot, lane, s = kernels_contact.recover_fluxes(
        T, mu, s, depth_factor is not None, solved, m, state.depth_fraction, deep_flash, micro, Ts, half_road
    )
    out = ContactFluxes(J, S, q, deep, mu, T, spot, lane)
    if not slopes:
        return out, None
    Ag, g, _, way = solved[:4]

    def total_derivative(law, own=None):
        """Derivative of a law of both temperatures along the solution."""
        own = law(T + 1j * COMPLEX_STEP, T0, True).imag / COMPLEX_STEP if own is None else own
        return own * dT[0] + face_derivative(law), own * dT[1]

    def face_derivative(law):
        return law(T, T0 + 1j * COMPLEX_STEP, True).imag / COMPLEX_STEP

    law = friction if depth_factor is None else heating_law
    rise = 1.0 / (1.0 - gain * own)
    dT = rise * (1.0 - Ag + gain * face_derivative(law)), rise * (Ag * state.lane_ratio)
    dmu, ds = (
        (total_derivative(friction, own), (0.0, 0.0))
        if depth_factor is None
        else (total_derivative(friction), total_derivative(depth_factor))
    )
    dq = tuple(state.heat_per_mu * d for d in dmu)
    dsq = tuple(s * d + e * q for d, e in zip(dq, ds, strict=True))
    face = tuple(d - state.depth_fraction * e for d, e in zip(dq, dsq, strict=True))
    dJ = tuple(
        g * (way * f - state.depth_flash * e - u) for f, e, u in zip(face, dsq, (1.0, -state.lane_ratio), strict=True)
    )
    dS = tuple(f - d for f, d in zip(face, dJ, strict=True))
    spot = tuple(d - state.micro_resistance * e for d, e in zip(dT, dJ, strict=True))
    return out, FluxSlopes(dJ, dS, dq, tuple(state.depth_fraction * e for e in dsq), spot, dmu)


def _extrapolate_laws(at, mu, s, T):
    """Both laws at T from their answers at a temperature nearby, asked by a complex step."""
    return (v.real + v.imag / COMPLEX_STEP * (T - np.real(at)) for v in (mu, s))


def _solve_spot_temperature(a, b, face, friction, guess, slopes):
    """Solve T = a + b mu(T, face) for every line: T, mu and its slope in T, exact where `slopes` are asked for.

    Derivatives of a, b and face pass through exactly.
    """
    T = np.real(a) if guess is None else guess
    derived = any(np.iscomplexobj(v) for v in (a, b, face))
    cold = np.real(face)
    for attempt in range(60):
        value = friction(T + 1j * COMPLEX_STEP, cold, True)
        depends, last, (T, mu, dmu, step) = kernels_contact.newton_step(
            T, value, a, b, COMPLEX_STEP, 0.5 if attempt > 15 else 1.0
        )
        if not depends:
            mu = friction(a, face)
            return a + b * mu, mu, dmu
        if last:
            if not (derived or slopes):
                mu = mu + dmu * (-step)
                return a + b * mu, mu, dmu
            value = friction(T + 1j * COMPLEX_STEP, cold, True)  # at the solution, not a step before
            mu, dmu = (friction(T, face) if derived else value.real), value.imag / COMPLEX_STEP
            turn = (T - a - b * mu) / (1.0 - b.real * dmu)  # where derived it carries the derivative
            return T - turn, mu - dmu * turn, dmu
    worst = int(np.argmax(np.abs(step)))
    raise SolverFailure(
        f"friction law has no consistent spot temperature on line {worst} near {T[worst] - KELVIN:.0f} degC"
    )
