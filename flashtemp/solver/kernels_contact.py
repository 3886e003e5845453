"""The compiled loops along the interface: column by column, what numpy would do in many passes over fifty numbers.

All arrays of a call are float or all are complex (`common_dtype`): then a complex step passes through.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from flashtemp.physics.just_in_time import njit

MIN_NEWTON_SLOPE = 1e-3  # smallest |1 - gain dlaw/dT| that a Newton step divides by


def common_dtype(*arrays: np.ndarray) -> Any:
    """Arrays as they are, or all complex where one is: so every loop is compiled for two kinds at most."""
    for a in arrays:
        if a.dtype.kind == "c":
            return [one.astype(complex, copy=False) for one in arrays]
    return arrays


@lru_cache(maxsize=256, typed=True)
def _constant_columns(value: complex, n: int) -> np.ndarray:
    """A number on every column."""
    return np.full(n, value)


def broadcast_columns(value, n: int) -> np.ndarray:
    """What a law says, on all n columns: it may say one number for all of them."""
    if np.ndim(value) == 0:
        return _constant_columns(complex(value) if isinstance(value, complex) else float(value), n)
    if value.shape == (n,) and value.dtype.kind in "fc" and value.flags.c_contiguous:
        return value
    found: np.ndarray = value * np.ones(n)
    return found


@njit(cache=True)
def friction_heat_rows(local, phi, speed, mean, share):
    """Rows (3, columns): m = p v/phi, p over `mean` held between 1e-9 and 500, and phi/share."""
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
    """Values (columns,), held where they are below `low` or above `high`."""
    out = np.empty_like(values)
    for i in range(len(values)):
        out[i] = low if values[i].real < low else high if values[i].real > high else values[i]
    return out


@njit(cache=True)
def surface_deficit(start, widen, fall, T, T_in):
    """By how much (columns,) widening lowers the surface of columns of road; `start` (lines,) their deepest cells.

    `widen` (n_road,) shares and `fall` (columns,) of the `ContactState`; `T` (cells,), `T_in` (n_road n_across,) rises,
    which may be float where those are complex: there are many cells.
    """
    across = len(fall) // len(start)
    low = 0
    while low < len(widen) and widen[low] == 0.0:
        low += 1
    out = np.empty(len(fall), fall.dtype)
    for i in range(len(start)):
        for j in range(across):
            lost = 0.0 * fall[0]
            for k in range(low, len(widen)):
                lost += widen[k] * (T[(start[i] + k) * across + j] - T_in[k * across + j])
            out[i * across + j] = fall[i * across + j] * lost
    return out


@njit(cache=True)
def lane_rises(gap, lane, lowered, seen, came, widen, own):
    """Rises (columns,) of lanes of columns `seen` and `lowered` at the surface, where those of planes `came` in.

    What earlier passes left in lanes, `own` (n_road planes,), has widened into the `gap` between them.
    """
    across = len(came)
    mixed = own[-across:].copy()
    total = widen.sum()
    if total.real > 0.0:
        for j in range(across):
            lost = 0.0 * own[0]
            for k in range(len(widen)):
                lost += widen[k] * own[k * across + j]
            mixed[j] = lost / total
    out = np.empty_like(seen)
    for c in range(len(seen)):
        j = c % across
        out[c] = came[j] - gap * mixed[j] + lane[c] * (seen[c] - came[j] - lowered[c])
    return out


@njit(cache=True)
def eliminate_fluxes(half, flash, micro, r, split, deep, m, inside, has_depth_factor, T0, Ts, half_block, half_road):
    """Rows (7, columns) of what is left of the contact's equations: A g, g, drop, way, a, gain and `turn`.

    T_m = a + gain law(T_m), where the law is mu, or where heat is `has_depth_factor` mu (1 + turn s); `turn` is heat in depth
    over heat at the face, less 1.
    """
    out = np.empty((7, len(T0)), T0.dtype)
    for i in range(len(T0)):
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
    """One step of Newton's method on T = a + gain law(T), T (columns,) real; `value` has a complex `step` in T.

    Whether the law depends on T at all, whether the step was the last; rows (4, columns): the new T, the law at the
    old one and its slope, and the change.
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
        last = last and abs(change) <= 1e-8 * abs(new)  # the next step would be its square
        out[0, i], out[1, i], out[2, i], out[3, i] = new, law, slope, change
    return depends, last, out


@njit(cache=True)
def recover_fluxes(T, mu, s, has_depth_factor, solved, m, inside, deep, micro, Ts, half_road):
    """Rows (7, columns) of `Fluxes` but mu and touch: J_R, J_S, q, its part in depth, spot, lane; and the factor s."""
    out = np.empty((7, len(T)), T.dtype)
    for i in range(len(T)):
        g, drop, way = solved[1, i], solved[2, i], solved[3, i]
        own = s[i] if has_depth_factor else 1.0 + 0.0 * T[i]
        q = m[i] * mu[i]
        below = inside * own * q
        J = g * (way * (q - below) - deep[i] * own * q - drop)
        S = q - below - J
        out[0, i], out[1, i], out[2, i], out[3, i] = J, S, q, below
        out[4, i], out[5, i], out[6, i] = T[i] - micro[i] * J, Ts[i] + half_road[i] * S, own
    return out


@njit(cache=True)
def add_contact_heat(block, block_share, road_share, area, into_block, into_road, heat, q):
    """Add the heat of the contact to cells q (W/m) of the `block`.

    Rows (3, columns): friction heat, all heat into the road, and that of it which its cells stand for.
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
    """Heat (n_road, n_across) W/m that road carries out of the window, less what comes in.

    `last`, `before`, `first` (n_road,) are cells of a plane; T, h rises (cells,), T_in, h_in of entering road.
    """
    across = len(T_in) // len(advection)
    out = np.empty((len(advection), across), T.dtype)
    for k in range(len(advection)):
        for j in range(across):
            end, back, begin = h[last[k] * across + j], h[before[k] * across + j], T[first[k] * across + j]
            c = k * across + j
            out[k, j] = advection[k] * (end + upwind * (end - back) - h_in[c]) - g_in[k] * (T_in[c] - begin)
    return out


@njit(cache=True)
def add_to_ledger(entry, offset, cell, weight, T, scale, out):
    """Add `scale` times the sums of weight T, from offset[i] to offset[i + 1], to `out` at entry[i]."""
    for i in range(len(entry)):
        total = 0.0 * T[0]
        for begin in range(offset[i], offset[i + 1], 64):  # in two floors: rounding grows with the longest sum
            part = 0.0 * T[0]
            for c in range(begin, min(begin + 64, offset[i + 1])):
                part += weight[c] * T[cell[c]]
            total += part
        out[entry[i]] += scale * total


@njit(cache=True)
def redistribute_load(spread, load, free):
    """free - spread (load free) in place, spread (lines, m), load (m, lines): what lines lose others advection."""
    lost = np.zeros(len(load), free.dtype)
    for j in range(len(load)):
        for i in range(len(free)):
            lost[j] += load[j, i] * free[i]
    for i in range(len(free)):
        for j in range(len(load)):
            free[i] -= spread[i, j] * lost[j]


@njit(cache=True)
def scatter_response(place, column, gain, change, scale, out):
    """Add `scale` gain change[column] to `out` at each place."""
    for e in range(len(place)):
        out[place[e]] += scale * gain[e] * change[column[e]]
