"""Compiled loops over the columns of the interface: contact laws, fluxes, heated lanes and the energy ledger.

There are some fifty columns, so numpy would spend more time on calls than on numbers.  The arrays of a call are all
float or all complex (`common_dtype`): a complex step then passes through and gives exact derivatives.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from flashtemp.physics.just_in_time import njit

MIN_NEWTON_SLOPE = 1e-3  # smallest |1 - gain dlaw/dT| that a Newton step divides by


def common_dtype(*arrays: np.ndarray) -> Any:
    """The arrays unchanged, or all complex if one is: every loop is then compiled for two types at most."""
    for a in arrays:
        if a.dtype.kind == "c":
            return [one.astype(complex, copy=False) for one in arrays]
    return arrays


@lru_cache(maxsize=256, typed=True)
def _constant_columns(value: complex, n: int) -> np.ndarray:
    """An array of n equal values; cached, so it must not be written to."""
    return np.full(n, value)


def broadcast_columns(value, n: int) -> np.ndarray:
    """The value of a law on all n columns, as a contiguous array; a law may return one number for all of them."""
    if np.ndim(value) == 0:
        return _constant_columns(complex(value) if isinstance(value, complex) else float(value), n)
    if value.shape == (n,) and value.dtype.kind in "fc" and value.flags.c_contiguous:
        return value
    columns: np.ndarray = value * np.ones(n)
    return columns


@njit(cache=True)
def friction_heat_rows(local, phi, speed, mean, share):
    """Rows (3, columns): heat per unit of friction p v/phi, eq. (5); p/`mean` limited to 1e-9..500; phi/`share`."""
    out = np.empty((3, len(local)), local.dtype)
    for i in range(len(local)):
        out[0, i] = local[i] * speed / phi[i]
        light = local[i] / mean
        if light.real < 1e-9:
            light = 1e-9 + 0.0 * light
        elif light.real > 500.0:
            light = 500.0 + 0.0 * light
        out[1, i] = light
        out[2, i] = phi[i] / share
    return out


@njit(cache=True)
def clip_values(values, low, high):
    """Values (columns,) limited to `low`..`high`; a limited value carries no derivative."""
    out = np.empty_like(values)
    for i in range(len(values)):
        out[i] = low if values[i].real < low else high if values[i].real > high else values[i]
    return out


@njit(cache=True)
def surface_deficit(start, weights, loss_ratio, T, T_in):
    """Sum of w(r) T_S(r) over depth in eq. (15c): by how much (columns,) K widening lowers the surface of a lane.

    `start` (lines,) are the deepest cells of the road under the block; `weights` (n_road,) and `loss_ratio` (columns,)
    belong to the `ContactState`.  The rises `T` (cells,), `T_in` (n_road n_across,) may be float where those are
    complex, because converting all cells would cost more than the sum.
    """
    across = len(loss_ratio) // len(start)
    low = 0
    while low < len(weights) and weights[low] == 0.0:  # cells deeper than D have no weight
        low += 1
    out = np.empty(len(loss_ratio), loss_ratio.dtype)
    for i in range(len(start)):
        for j in range(across):
            lost = 0.0 * loss_ratio[0]
            for k in range(low, len(weights)):
                lost += weights[k] * (T[(start[i] + k) * across + j] - T_in[k * across + j])
            out[i * across + j] = loss_ratio[i * across + j] * lost
    return out


@njit(cache=True)
def lane_rises(gap, lane_ratio, deficit, columns, incoming, weights, earlier):
    """Temperature rises (columns,) of heated lanes at the surface: eq. (15c), and (15d) by `lane_ratio`.

    `columns` are the rises of the columns of road, `deficit` the `surface_deficit`, `incoming` (planes,) the rises with
    which the columns entered.  `earlier` (n_road planes,) is the part that earlier passes left in the lanes.  It has
    spread in the meantime over the `gap` between lanes, a fraction of the width.
    """
    across = len(incoming)
    mixed = earlier[-across:].copy()
    total = weights.sum()
    if total.real > 0.0:
        for j in range(across):
            lost = 0.0 * earlier[0]
            for k in range(len(weights)):
                lost += weights[k] * earlier[k * across + j]
            mixed[j] = lost / total
    out = np.empty_like(columns)
    for c in range(len(columns)):
        j = c % across
        out[c] = incoming[j] - gap * mixed[j] + lane_ratio[c] * (columns[c] - incoming[j] - deficit[c])
    return out


@njit(cache=True)
def eliminate_fluxes(half, flash, micro, r, split, deep, m, inside, has_depth_factor, T0, Ts, half_block, half_road):
    """Eliminate the fluxes of eqs. (9) to (12): rows (7, columns) A g, g, drop, way, a, gain and `turn`.

    Symbols are those of `contact_flux`; `way` is chi r + h_S and `drop` is T_0 - T_lane.  One equation is left:
    T_m = a + gain law(T_m).  The law is mu, or mu (1 + turn s) with `has_depth_factor`; `turn` is the effect of heat
    released in depth over that of heat at the face, minus 1.
    """
    out = np.empty((7, len(T0)), T0.dtype)
    for i in range(len(T0)):
        # J = g (way q - drop) and T_m = T_0 + A J, as in eq. (7b): both are linear in the heat q = m law
        A = half[i] * half_block[i] + flash[i] + micro[i]
        g = 1.0 / (A + half_road[i] + r[i])
        drop = T0[i] - Ts[i]
        way = split[i] * r[i] + half_road[i]
        a, b = T0[i] - A * g * drop, A * g * way
        turn = ((1.0 - A * g) * deep[i] - b * inside) / b
        out[0, i], out[1, i], out[2, i], out[3, i], out[4, i] = A * g, g, drop, way, a
        out[5, i] = b * m[i] if has_depth_factor else b * (1.0 + turn) * m[i]
        out[6, i] = turn
    return out


@njit(cache=True)
def newton_step(T, value, a, gain, step, damp):
    """One step of Newton's method on T = a + gain law(T), T (columns,) real; `value` is the law at T + 1j `step`.

    Returns whether the law depends on T at all, whether the iteration has converged, and rows (4, columns): the new T,
    the law at the old T, its derivative, and the change.
    """
    out = np.empty((4, len(T)))
    depends, last = False, True
    for i in range(len(T)):
        law, slope = value[i].real, value[i].imag / step
        depends = depends or slope != 0.0
        steep = 1.0 - gain[i].real * slope
        change = (T[i] - a[i].real - gain[i].real * law) / (
            steep if abs(steep) > MIN_NEWTON_SLOPE else MIN_NEWTON_SLOPE
        )
        change = damp * change
        new = T[i] - change
        last = last and abs(change) <= 1e-8 * abs(new)  # quadratic convergence: the next change would be rounding
        out[0, i], out[1, i], out[2, i], out[3, i] = new, law, slope, change
    return depends, last, out


@njit(cache=True)
def recover_fluxes(T, mu, s, has_depth_factor, solved, m, inside, deep, micro, Ts, half_road):
    """Fluxes at the temperature T of the contact: rows (7, columns) J_R, J_S, q, q in depth, T_spot, T_lane and s.

    The first six are the fields of `ContactFluxes` without mu and touch; s is the factor on the heat in depth.
    """
    out = np.empty((7, len(T)), T.dtype)
    for i in range(len(T)):
        g, drop, way = solved[1, i], solved[2, i], solved[3, i]
        factor = s[i] if has_depth_factor else 1.0 + 0.0 * T[i]
        q = m[i] * mu[i]
        # heat released in depth does not cross the contact; it raises the spots by Theta_v of eq. (12), which lowers J
        below = inside * factor * q
        J = g * (way * (q - below) - deep[i] * factor * q - drop)
        S = q - below - J
        out[0, i], out[1, i], out[2, i], out[3, i] = J, S, q, below
        out[4, i], out[5, i], out[6, i] = T[i] - micro[i] * J, Ts[i] + half_road[i] * S, factor
    return out


@njit(cache=True)
def add_contact_heat(block, block_share, road_share, area, into_block, into_road, heat, q):
    """Add the heat of the contact to the cells `block` of q (W/m).

    Returns rows (3, columns) in W/m: friction heat, all heat into the road, and the heat into the road's cells, which
    stand for a constant fraction of the width.
    """
    out = np.empty((3, len(area)), into_block.dtype)
    for i in range(len(area)):
        q[block[i]] += block_share[i] * into_block[i] * area[i]
        taken = into_road[i] * area[i]
        out[0, i] = block_share[i] * heat[i] * area[i]
        out[1, i] = block_share[i] * taken
        out[2, i] = road_share[i] * taken
    return out


@njit(cache=True)
def road_outflow(last, before, first, upwind, advection, g_in, T, h, T_in, h_in):
    """Heat (n_road, n_across) W/m that the road carries out of the computed window, minus what it brings in.

    `last`, `before`, `first` (n_road,) are cells of a plane on the last line, the one before it and the first line.  T,
    h are temperature and enthalpy rises (cells,), T_in, h_in those of the entering road.
    """
    across = len(T_in) // len(advection)
    out = np.empty((len(advection), across), T.dtype)
    for k in range(len(advection)):
        for j in range(across):
            # the face behind the last cell is extrapolated like every other; conduction acts at the inflow only
            end, back, begin = h[last[k] * across + j], h[before[k] * across + j], T[first[k] * across + j]
            c = k * across + j
            out[k, j] = advection[k] * (end + upwind * (end - back) - h_in[c]) - g_in[k] * (T_in[c] - begin)
    return out


@njit(cache=True)
def add_to_ledger(entry, offset, cell, weight, T, scale, out):
    """Add `scale` times the sum of weight T over offset[i]..offset[i + 1] - 1 to `out` at entry[i]."""
    for i in range(len(entry)):
        total = 0.0 * T[0]
        for begin in range(offset[i], offset[i + 1], 64):  # blocks of 64: rounding grows with the longest sum
            part = 0.0 * T[0]
            for c in range(begin, min(begin + 64, offset[i + 1])):
                part += weight[c] * T[cell[c]]
            total += part
        out[entry[i]] += scale * total


@njit(cache=True)
def redistribute_load(spread, load, free):
    """free - spread (load free) in place: the load that some columns lose is carried by the others.

    `spread` (columns, m), `load` (m, columns) with m = 1 for the load alone and 2 for load and moment.
    """
    lost = np.zeros(len(load), free.dtype)
    for j in range(len(load)):
        for i in range(len(free)):
            lost[j] += load[j, i] * free[i]
    for i in range(len(free)):
        for j in range(len(load)):
            free[i] -= spread[i, j] * lost[j]


@njit(cache=True)
def scatter_response(place, column, gain, change, scale, out):
    """Product of a sparse matrix: add `scale` gain change[column] to `out` at each place."""
    for e in range(len(place)):
        out[place[e]] += scale * gain[e] * change[column[e]]
