"""The compiled loops of the preconditioner: depth lines factorised, solved and swept downstream, one plane or many.

In 2D temperatures are (cells,).  In 3D they are (cells of a plane, planes): the neighbours across y of a cell are a
row, and the same sweep runs along rows.  Only what is done to one row differs; which it is, `z.ndim`, is known when
numba compiles, so that neither pays for the other.
"""

from __future__ import annotations

import numpy as np
from numba import njit

SUM = {"reassoc", "contract", "nsz"}


# --- one row: a number in 2D, the neighbours across in 3D ----------------------------------------------
@njit(cache=True)
def _held(z, i):
    """What stands for row i: in 2D its value, which stays in a register, so that the next step need not wait."""
    if z.ndim == 1:
        return z[i]
    return i


@njit(cache=True)
def _less(z, to, factor, last):
    """z[to] -= factor z[last], down the elimination."""
    if z.ndim == 1:
        value = z[to] - factor * last
        z[to] = value
        return value
    for j in range(z.shape[1]):
        z[to, j] -= factor * z[last, j]
    return to


@njit(cache=True)
def _back(z, to, unit, factor, last):
    """z[to] = unit z[to] - factor z[last], back up."""
    if z.ndim == 1:
        value = z[to] * unit - factor * last
        z[to] = value
        return value
    for j in range(z.shape[1]):
        z[to, j] = z[to, j] * unit - factor * z[last, j]
    return to


@njit(cache=True)
def _pair(road, block, u, d, under, over):
    """Both sides of the interface, solved together."""
    scale = 1.0 / (1.0 - u * d * under * over)
    return (road - u * over * block) * under * scale, (block - d * under * road) * over * scale


@njit(cache=True)
def _across(z, s, road, block, gamma, up, down, under, over):
    """`_pair` for rows s and s + 1."""
    if z.ndim == 1:
        z[s], z[s + 1] = road, block = _pair(road, block, -gamma * up, -gamma * down, under, over)
        return road, block
    for j in range(z.shape[1]):
        z[s, j], z[s + 1, j] = _pair(z[s, j], z[s + 1, j], -gamma * up[j], -gamma * down[j], under[j], over[j])
    return s, s + 1


@njit(cache=True)
def _times(z, i, unit, last):
    """z[i] *= unit."""
    if z.ndim == 1:
        value = last * unit
        z[i] = value
        return value
    for j in range(z.shape[1]):
        z[i, j] *= unit
    return i


@njit(cache=True)
def _bring(z, c, unit, r, low, old, low2, older, lines):
    """z[c] = unit r[c], less what `lines` (0, 1 or 2) lines upstream give to it."""
    if z.ndim == 1:
        if lines == 2:
            z[c] = unit * r[c] - low * z[old] - low2 * z[older]
        elif lines == 1:
            z[c] = unit * r[c] - low * z[old]
        else:
            z[c] = unit * r[c]
    elif lines == 2:
        for j in range(z.shape[1]):
            z[c, j] = unit * r[c, j] - low * z[old, j] - low2 * z[older, j]
    elif lines == 1:
        for j in range(z.shape[1]):
            z[c, j] = unit * r[c, j] - low * z[old, j]
    else:
        for j in range(z.shape[1]):
            z[c, j] = unit * r[c, j]


@njit(cache=True)
def _product(work, k, factor, z, c):
    """work[k] = factor z[c]."""
    if z.ndim == 1:
        work[k] = factor * z[c]
    else:
        for j in range(z.shape[1]):
            work[k, j] = factor * z[c, j]


@njit(cache=True)
def _minus(z, c, work, k):
    """z[c] -= work[k]."""
    if z.ndim == 1:
        z[c] -= work[k]
    else:
        for j in range(z.shape[1]):
            z[c, j] -= work[k, j]


@njit(cache=True, fastmath=SUM)
def _mean(z, c, share):
    """Mean of a row across y."""
    total = 0.0
    for j in range(len(share)):
        total += share[j] * z[c, j]
    return total


# --- lines ----------------------------------------------------------------------------------------------
@njit(cache=True)
def line_solve(o, a, size, m, gamma, up, down, under, over, inv, mul, z):
    """Solve one depth line in place, z starting at o, with the factors of `factorise`; two chains run at once."""
    nb, f = size - m, a - o
    s, top = o + m - 1, o + size - 1
    both = min(m, nb)
    road, block = _held(z, o), _held(z, top)
    for k in range(1, both):
        road = _less(z, o + k, mul[a + k], road)
        block = _less(z, top - k, mul[f + top - k], block)
    for k in range(max(both, 1), m):
        road = _less(z, o + k, mul[a + k], road)
    for k in range(max(both, 1), nb):
        block = _less(z, top - k, mul[f + top - k], block)
    if nb == 0:
        road = _times(z, s, inv[f + s], road)
    else:
        road, block = _across(z, s, road, block, gamma, up, down, under, over)
    for k in range(1, both):
        road = _back(z, s - k, inv[f + s - k], mul[f + s - k + 1], road)
        block = _back(z, s + 1 + k, inv[f + s + 1 + k], mul[f + s + k], block)
    for k in range(max(both, 1), m):
        road = _back(z, s - k, inv[f + s - k], mul[f + s - k + 1], road)
    for k in range(max(both, 1), nb):
        block = _back(z, s + 1 + k, inv[f + s + 1 + k], mul[f + s + k], block)


@njit(cache=True)
def _solve_line(i, o, lines, factors, crossing, gamma, z):
    """`line_solve` of line i, z starting at o."""
    a, size = lines.start[i], lines.start[i + 1] - lines.start[i]
    at = i - lines.first if size > lines.m else 0
    up, down, under, over = crossing.up[at], crossing.down[at], crossing.under[at], crossing.over[at]
    line_solve(o, a, size, lines.m, gamma, up, down, under, over, factors.inv, factors.mul, z)


@njit(cache=True)
def sweep(lines, factors, crossing, gamma, r, z):
    """z = P^-1 (capacity r): lines solved in the direction of sliding, then corrected back; nothing flows across.

    Returns, in 3D, the heat (J per metre of width, rows counted with their `weight`) in r and in z.
    """
    start, m, capacity = lines.start, lines.m, lines.capacity
    low, low2, high = factors.low, factors.low2, factors.high
    n = len(start) - 1
    longest, given, kept = 0, 0.0, 0.0
    for i in range(n):
        a, b = start[i], start[i + 1]
        size = b - a
        longest = max(longest, size)
        p, q = start[max(i - 1, 0)], start[max(i - 2, 0)]
        two, one = m if i > 1 else 0, min(size, a - p)
        for k in range(two):
            _bring(z, a + k, capacity[a + k], r, low[a + k], p + k, low2[a + k], q + k, 2)
        for k in range(two, one):
            _bring(z, a + k, capacity[a + k], r, low[a + k], p + k, 0.0, 0, 1)
        for k in range(one, size):
            _bring(z, a + k, capacity[a + k], r, 0.0, 0, 0.0, 0, 0)
        if r.ndim == 2:
            for c in range(a, b):
                given += lines.weight[c] * capacity[c] * _mean(r, c, lines.share)
        _solve_line(i, a, lines, factors, crossing, gamma, z)
    work = np.empty_like(z[:longest])
    for i in range(n - 2, -1, -1):
        a, b = start[i], start[i + 1]
        size = b - a
        top = min(size, start[i + 2] - b)
        for k in range(top):
            _product(work, k, high[a + k], z, b + k)
        work[top:size] = 0.0
        _solve_line(i, 0, lines, factors, crossing, gamma, work)
        for k in range(size):
            _minus(z, a + k, work, k)
    if r.ndim == 2:
        for c in range(start[n]):
            kept += lines.weight[c] * capacity[c] * _mean(z, c, lines.share)
    return given, kept


# --- factors --------------------------------------------------------------------------------------------
@njit(cache=True)
def factorise(lines, transport, gamma, own, up, down, factors):
    """Factors of P = (D + L) D^-1 (D + U) for capacity - gamma K, line by line downstream, written to `factors`.

    `own` (n_plane,) adds to the diagonal of K (boundary and contact laws), `up`, `down` (lines under the block,) are
    K's entries across the interface: d(road rate)/d(block T) and d(block rate)/d(road T).  The diagonals D are
    corrected so that every column of P, rows counted with their `weight`, sums to that of the exact matrix: the
    preconditioner conserves heat.
    """
    start, m = lines.start, lines.m
    longest = 0
    for i in range(len(start) - 1):
        longest = max(longest, start[i + 1] - start[i])
    fix, work = np.zeros(longest), np.empty(longest)
    for i in range(len(start) - 1):
        _diagonal(i, lines, transport, gamma, own, fix, factors)
        fix[:] = 0.0
        _pivots(start[i], start[i + 1] - start[i], m, gamma, transport.gz, factors.inv, factors.mul)
        if i + 2 < len(start):
            at = i - lines.first if start[i + 1] - start[i] > m else 0
            _correction(i, lines, transport, gamma, up[at], down[at], factors, work, fix)


@njit(cache=True)
def _diagonal(i, lines, transport, gamma, own, fix, factors):
    """Diagonal of line i, into `factors.inv` for `_pivots`, and its couplings to the lines around it."""
    start, m, slope = lines.start, lines.m, lines.slope
    gx, gz, carry, stretch = transport
    inv, _, low, low2, high = factors
    a, b = start[i], start[i + 1]
    ahead = start[i + 2] - b if i + 2 < len(start) else 0  # cells of the line downstream
    for k in range(b - a):
        c = a + k
        d = own[c] - gx[c]
        if k > 0:
            d -= gz[c - 1]
        d -= gz[c]
        if k < ahead:
            d -= gx[b + k]
            high[c] = -gamma * gx[b + k]
        else:
            high[c] = 0.0
        low[c] = -gamma * gx[c]
        low2[c] = 0.0
        if k < m:
            s = slope[i]
            d -= carry[k] * (1.0 + s) * stretch[c]
            if i == 0:
                d -= lines.g_in[k]
                low[c] = 0.0
            else:
                low[c] -= gamma * carry[k] * (1.0 + slope[i - 1] + s) * stretch[start[i - 1] + k]
                if i > 1:
                    low2[c] = gamma * carry[k] * slope[i - 1] * stretch[start[i - 2] + k]
        inv[c] = lines.capacity[c] * stretch[c] - gamma * d + fix[k]


@njit(cache=True)
def _pivots(a, size, m, gamma, gz, inv, mul):
    """Pivots of a line towards the interface from both ends: two chains that the processor runs at once."""
    b = a + size
    inv[a] = 1.0 / inv[a]
    for c in range(a + 1, a + m):
        g = gamma * gz[c - 1]
        mul[c] = -g * inv[c - 1]
        inv[c] = 1.0 / (inv[c] + mul[c] * g)
    if size > m:
        inv[b - 1] = 1.0 / inv[b - 1]
        for c in range(b - 2, a + m - 1, -1):
            g = gamma * gz[c]
            mul[c] = -g * inv[c + 1]
            inv[c] = 1.0 / (inv[c] + mul[c] * g)


@njit(cache=True)
def _correction(i, lines, transport, gamma, up, down, factors, work, fix):
    """Column sums of L D^-1 U from line i, which go back onto the next diagonal: `fix`."""
    start, m, slope, weight = lines.start, lines.m, lines.slope, lines.weight
    a, b = start[i], start[i + 1]
    size, top = b - a, min(b - a, start[i + 2] - b)
    work[:size] = 0.0
    for k in range(top):
        s = -gamma * transport.gx[b + k]
        if k < m:
            carried = gamma * transport.carry[k]
            s -= carried * (1.0 + slope[i] + slope[i + 1]) * transport.stretch[a + k]
            if i + 3 < len(start):
                s += carried * slope[i + 1] * transport.stretch[a + k]
        work[k] = s * weight[a + k]
    # D is symmetric but for the interface: D^T is D with `up` and `down` exchanged
    over = a + m if size > m else a
    inv = factors.inv
    line_solve(0, a, size, m, gamma, down, up, inv[a + m - 1], inv[over], inv, factors.mul, work)
    for k in range(top):
        fix[k] = -work[k] * factors.high[a + k] / weight[a + k]
