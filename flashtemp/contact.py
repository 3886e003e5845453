"""The interface of Level H: fluxes into rubber and road, eliminated between the two half-cells.

Unknown per depth line is the flux J_R into the rubber per spot area; everything else follows.
With T_m the rubber temperature inside the spots (theory 1.4 eqs. (9)-(12)):
    T_m = T_0 + A J_R + c q,          A = phi h_R + R_flash,         c q = flash of the volumetric part
    J_R = g [(chi r + f h_S) q_a - (T_0 - T_road) - c q],      g = 1/(A + f h_S + r)
and q = m mu(T_m), m = p v/phi, closes it: one scalar equation per line, solved by Newton.
Where spots are resolved A = h_R, and block and road are heated through what is covered at the moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flashtemp.errors import SolverFailure
from flashtemp.laws import STEP


@dataclass(frozen=True)
class ContactState:
    """What the contact laws give along the block (lines,), apart from temperature.

    `m` = p v/phi (W/m2 per unit mu) of the spots, `phi` contact fraction and `covered` its mean over the length,
    `pressure` local nominal pressure (Pa), `r` = 1/alpha, without bound where the block lifts off, `flash` (m2 K/W),
    `lane` factor on the road rise, `split` chi, `surface` share of the heat released at the interface, `deep`
    flash of the deposits (m2 K/W).
    """

    m: np.ndarray
    phi: np.ndarray
    covered: float
    pressure: np.ndarray
    r: np.ndarray
    flash: np.ndarray
    lane: np.ndarray
    split: float
    surface: float
    deep: np.ndarray
    block: np.ndarray  # share of its area through which a column's block cell is heated: phi while spots are averaged
    road: np.ndarray | float  # that of its road cell: 1 while that is the lane under the spots
    half: np.ndarray  # factor on the block's half cell: what one spot heats, averaged over what all do


class Fluxes(NamedTuple):
    """Result of the interface: per spot area W/m2, temperatures in K."""

    into_block: np.ndarray  # J_R
    into_road: np.ndarray  # J_S
    heat: np.ndarray  # q, all friction heat per spot area
    mu: np.ndarray
    spot: np.ndarray  # rubber temperature in the spots
    lane: np.ndarray  # road surface temperature in the lanes


class Slopes(NamedTuple):
    """Derivatives with respect to the block's (0) and the road's (1) first cell temperature."""

    block: tuple[np.ndarray, np.ndarray]  # of J_R
    road: tuple[np.ndarray, np.ndarray]  # of J_S
    heat: tuple[np.ndarray, np.ndarray]  # of q
    spot: tuple[np.ndarray, np.ndarray]  # of the temperature in the spots
    mu: tuple[np.ndarray, np.ndarray]


def solve(state: ContactState, T0, Ts, under, half_block, half_road, friction, guess=None, slopes=False):
    """Fluxes (and with `slopes` their derivatives) for first-cell temperatures T0, Ts in K (lines,).

    `under` K is the temperature of the entering road, `half_block`, `half_road` half-cell
    resistances m2 K/W, `friction(T, face, apart)` the friction coefficient at the temperatures in the spots and of the
    block's face around them; `apart` asks for slopes in these alone.
    Raises SolverFailure when the friction law has no consistent temperature.
    """
    A = state.half * half_block + state.flash
    fh = state.lane * half_road
    g = 1.0 / (A + fh + state.r)
    drop = T0 - under - state.lane * (Ts - under)
    gain = state.surface * (state.split * state.r + fh) - state.deep
    a = T0 - A * g * drop
    b = (A * g * gain + state.deep) * state.m
    T, mu, dmu = _spot_temperature(a, b, T0, friction, guess)
    q = state.m * mu
    J = g * (gain * q - drop)
    S = state.surface * q - J
    lane = under + state.lane * (Ts - under + half_road * S)
    out = Fluxes(J, S, q, mu, T, lane)
    if not slopes:
        return out
    rise = 1.0 / (1.0 - b * dmu)
    beside = friction(T, np.real(T0) + 1j * STEP, True).imag / STEP
    T0, T1 = rise * (1.0 - A * g + b * beside), rise * (A * g * state.lane)
    mu0, mu1 = dmu * T0 + beside, dmu * T1
    q0, q1 = state.m * mu0, state.m * mu1
    J0, J1 = g * (gain * q0 - 1.0), g * (gain * q1 + state.lane)
    s = state.surface
    return out, Slopes((J0, J1), (s * q0 - J0, s * q1 - J1), (q0, q1), (T0, T1), (mu0, mu1))


def _spot_temperature(a, b, face, friction, guess):
    """Solve T = a + b mu(T, face) for every line; derivatives of a, b and face pass through exactly."""
    T = np.array(np.real(a) if guess is None else guess)
    derived = any(np.iscomplexobj(v) for v in (a, b, face))
    for attempt in range(60):
        value = friction(T + 1j * STEP, np.real(face), True)
        mu, dmu = value.real, value.imag / STEP
        if not np.any(dmu):
            mu = friction(a, face)
            return a + b * mu, mu, np.zeros_like(np.real(a))
        slope = 1.0 - b.real * dmu
        step = (T.real - a.real - b.real * mu) / np.where(np.abs(slope) > 1e-3, slope, 1e-3)
        if attempt > 15:
            step = 0.5 * step
        T = T - step
        if np.all(np.abs(step) <= 1e-8 * np.abs(T)):  # the next step would be its square
            if derived:  # one complex step at the solution carries the derivative
                mu = friction(T, face)
                turn = (T - a - b * mu) / slope
                T, mu = T - turn, mu - dmu * turn
            else:
                mu = mu + dmu * (-step)
                T = a + b * mu
            return T, mu, dmu
    worst = int(np.argmax(np.abs(step)))
    raise SolverFailure(
        f"friction law has no consistent spot temperature on line {worst} near {T[worst] - 273.15:.0f} degC"
    )
