"""Heat fluxes into rubber and road in the contact spots of Level H, by elimination of the two half-cells.

The unknown of a column is the flux J_R into the rubber per area of a spot.  With T_m the rubber's temperature where
it touches the road, T_0 and T_lane the first cells of block and lane, and h_R, h_S the resistances of the half-cells,
theory.md, eqs. (9) to (12) become

    T_m = T_0 + A J_R + c q,   A = phi h_R + R_flash + R_micro,   c q = flash temperature of the heat in depth
    J_R = g [(chi r + h_S) q_a - (T_0 - T_lane) - c q],        g = 1/(A + h_S + r),   r = 1/alpha

The heat q = m mu(T_m) with m = p v/phi, eq. (5), closes the system: one scalar equation per column, solved by Newton's
method.  The fraction F s(T_m) of q is released in depth, with c = s(T_m) `depth_flash`; the rest is q_a.  The mean
temperature of the spots is T_m - R_micro J_R.  Where spots are resolved (Level R, eq. (7b)), A = h_R, and block and
road exchange heat through the area that spots cover at that moment.
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
    """The contact laws at one pressure, arrays (columns,) unless stated; temperatures are not part of it."""

    heat_per_mu: np.ndarray  # m = p v/phi of eq. (5), W/m2
    phi: np.ndarray  # contact fraction
    covered: float  # its mean over the length
    pressure: np.ndarray  # local nominal pressure, Pa
    resistance: np.ndarray  # r = 1/alpha, m2 K/W; it grows without bound where the block lifts off
    flash_resistance: np.ndarray  # (1 - phi) Theta_s F of eq. (12), m2 K/W
    micro_resistance: np.ndarray  # of the micro-contacts inside a spot, m2 K/W
    lane_ratio: np.ndarray  # temperature rise of the lanes in contact over that of their column, eq. (15d)
    loss_ratio: np.ndarray  # the same ratio for the heat that lanes lose sideways, over `lane_ratio`
    spreading_weights: np.ndarray  # (n_road,), deepest first: w(r) of eq. (15c) integrated over each road cell
    heat_split: np.ndarray  # chi of eq. (4)
    depth_fraction: float  # F, the fraction of the friction heat that is released in depth
    depth_flash: np.ndarray  # flash temperature of that heat over q, m2 K/W: Theta_v of eq. (12)
    block_coverage: np.ndarray  # fraction of a block cell's area that is heated: phi while spots are averaged
    road_coverage: np.ndarray  # the same of a road cell, which stands for a constant fraction of the width
    half_cell_factor: (
        np.ndarray
    )  # factor on h_R: the mean flux phi J_R crosses the half-cell, or J_R of a resolved spot
    touched_road: RoadOverlap  # the road under the columns
    rim_resistance: Any = 0.0  # eq. (7c) in the road: a spot is hotter than a cell that it covers in part, m2 K/W
    lane_history: Any = None  # `LaneHistory` while `lane_ratio` and `loss_ratio` still have to follow from temperatures
    lane_slopes: Any = None  # `LaneSlopes` once they have


class ContactFluxes(NamedTuple):
    """Fluxes of the interface (columns,), W/m2 per area of a spot; temperatures in K."""

    into_block: np.ndarray  # J_R
    into_road: np.ndarray  # J_S
    heat: np.ndarray  # q, all friction heat per spot area
    deep: np.ndarray  # the part of it that is released in depth
    mu: np.ndarray
    touch: np.ndarray  # T_m, the rubber's temperature where it touches the road: the argument of the friction law
    spot: np.ndarray  # T_spot, mean temperature of the spots: equal to `touch` without micro-contacts
    lane: np.ndarray  # road surface temperature in the lanes


class FluxSlopes(NamedTuple):
    """Derivatives with respect to the first-cell temperatures of the block [0] and of the road's column [1]."""

    block: tuple[np.ndarray, np.ndarray]  # of J_R
    road: tuple[np.ndarray, np.ndarray]  # of J_S
    heat: tuple[np.ndarray, np.ndarray]  # of q
    deep: tuple[np.ndarray, np.ndarray]  # of the part of q in depth
    spot: tuple[np.ndarray, np.ndarray]  # of the temperature in the spots
    mu: tuple[np.ndarray, np.ndarray]


def solve_fluxes(state: ContactState, T0, Ts, half_block, half_road, friction, depth_factor, guess=None, slopes=False):
    """Fluxes at the first-cell temperatures T0 (block) and Ts (lanes, `contact_lanes.lane_rises`), K (columns,).

    Returns `ContactFluxes`, and with `slopes` the `FluxSlopes`, else None.  `half_block`, `half_road` are the half-cell
    resistances h_R, h_S in m2 K/W.  `friction(T, face, apart)` is the friction coefficient at the temperatures T of the
    spots and `face` of the block's face around them; `depth_factor` is likewise the factor s on the fraction in depth,
    1 if None.  With `apart` a complex step in these two temperatures is the only one that counts: any other that the
    state carries is left out.  `guess` (columns,) K starts Newton's method.  Raises SolverFailure when the friction law
    has no consistent temperature.
    """
    resistances = (state.half_cell_factor, state.flash_resistance, state.micro_resistance, state.resistance)
    sources = (state.heat_split, state.depth_flash, state.heat_per_mu)
    *laws, T0, Ts, half_block, half_road = common_dtype(*resistances, *sources, T0, Ts, half_block, half_road)
    micro, depth_flash, m = laws[2], laws[5], laws[6]
    has_factor, F = depth_factor is not None, state.depth_fraction
    solved = kernels_contact.eliminate_fluxes(*laws, F, has_factor, T0, Ts, half_block, half_road)
    a, gain, turn = solved[4:]
    # Newton's method calls the product of both laws; their last arguments and values are kept, because mu and s are
    # needed one by one afterwards and a call of a law costs more than the rest of this function
    last_call: list[Any] = [None, None, None]

    def heating_law(T, face, apart=False):
        last_call[:] = T, friction(T, face, apart), depth_factor(T, face, apart)
        return last_call[1] * (1.0 + (np.real(turn) if apart else turn) * last_call[2])

    T, mu, law_slope = _solve_spot_temperature(
        a, gain, T0, friction if depth_factor is None else heating_law, guess, slopes
    )
    s = mu
    if depth_factor is not None:
        mu, s = (
            (friction(T, T0), depth_factor(T, T0))
            if np.iscomplexobj(T)
            else _extrapolate_laws(last_call[0], last_call[1], last_call[2], T)
        )
    T, mu, s, solved, m, depth_flash, micro, Ts, half_road = common_dtype(
        T, mu, s, solved, m, depth_flash, micro, Ts, half_road
    )
    J, S, q, deep, spot, lane, s = kernels_contact.recover_fluxes(
        T, mu, s, has_factor, solved, m, F, depth_flash, micro, Ts, half_road
    )
    out = ContactFluxes(J, S, q, deep, mu, T, spot, lane)
    if not slopes:
        return out, None
    law = friction if depth_factor is None else heating_law
    return out, _flux_slopes(state, solved, gain, T, T0, q, s, law, law_slope, friction, depth_factor)


def _flux_slopes(state, solved, gain, T, T0, q, s, law, law_slope, friction, depth_factor) -> FluxSlopes:
    """Derivatives of the fluxes at the solution T of T_m = a + `gain` `law`(T_m, face) by implicit differentiation.

    The face is the block's first cell.  `solved` are the rows of `kernels_contact.eliminate_fluxes`; `law_slope` is the
    derivative of `law` by T_m.
    """
    Ag, g, _, way = solved[:4]

    def total_derivative(law, in_spots=None):
        """Derivatives of a law with respect to both first-cell temperatures, along the solution."""
        in_spots = law(T + 1j * COMPLEX_STEP, T0, True).imag / COMPLEX_STEP if in_spots is None else in_spots
        return in_spots * dT[0] + face_derivative(law), in_spots * dT[1]

    def face_derivative(law):
        return law(T, T0 + 1j * COMPLEX_STEP, True).imag / COMPLEX_STEP

    # a change of T_m changes the law and so the heat, which changes T_m again: the sum of that series
    feedback = 1.0 / (1.0 - gain * law_slope)
    dT = feedback * (1.0 - Ag + gain * face_derivative(law)), feedback * (Ag * state.lane_ratio)
    dmu, ds = (
        (total_derivative(friction, law_slope), (0.0, 0.0))
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
    return FluxSlopes(dJ, dS, dq, tuple(state.depth_fraction * e for e in dsq), spot, dmu)


def _extrapolate_laws(at, mu, s, T):
    """Both laws at T, to first order from their values and complex-step derivatives at a temperature nearby."""
    return (v.real + v.imag / COMPLEX_STEP * (T - np.real(at)) for v in (mu, s))


def _solve_spot_temperature(a, b, face, friction, guess, slopes):
    """Solve T = a + b mu(T, face) for every column by Newton's method.

    Returns T, mu and dmu/dT; the derivative is evaluated at the solution where `slopes` are required.  Complex steps in
    a, b and face pass through exactly.
    """
    T = np.real(a) if guess is None else guess
    is_complex = any(np.iscomplexobj(v) for v in (a, b, face))
    cold = np.real(face)
    for attempt in range(60):
        value = friction(T + 1j * COMPLEX_STEP, cold, True)
        depends, last, (T, mu, dmu, step) = kernels_contact.newton_step(
            T,
            value,
            a,
            b,
            COMPLEX_STEP,
            0.5 if attempt > 15 else 1.0,  # damped if it oscillates
        )
        if not depends:
            mu = friction(a, face)
            return a + b * mu, mu, dmu
        if last:
            if not (is_complex or slopes):
                mu = mu + dmu * (-step)
                return a + b * mu, mu, dmu
            value = friction(T + 1j * COMPLEX_STEP, cold, True)  # Newton's last value is a step before
            mu, dmu = (friction(T, face) if is_complex else value.real), value.imag / COMPLEX_STEP
            # one more Newton step with complex a, b and face: its imaginary part is the derivative of the solution
            correction = (T - a - b * mu) / (1.0 - b.real * dmu)
            return T - correction, mu - dmu * correction, dmu
    worst = int(np.argmax(np.abs(step)))
    raise SolverFailure(
        f"the friction law has no consistent spot temperature in column {worst} near {T[worst] - KELVIN:.0f} degC"
    )
