"""Compiled loops in 3D: the flows and sweeps of `kernels_2d` for all planes across y at once (theory.md, 1.8).

A row of n_across neighbours in y is contiguous in memory, and every inner loop runs along it.  While conductivity is
constant, all planes have the same conductances per metre of width; only the interface differs from plane to plane.
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.just_in_time import njit

FASTMATH_SUM = {"reassoc", "contract", "nsz"}  # sums may be reordered, so that they run on vector registers


@njit(cache=True)
def _advect_row(i, k, c, m, start, advection, upwind, T, h, T_in, h_in, g_in, q):
    """Add the advection in and out of row c, at level k of line i: second-order upwind as in `kernels_2d`."""
    if k >= m:
        return
    ny, s, w = q.shape[1], upwind[i], advection[k]
    # faces are extrapolated from two cells; at the first lines the entering road stands in for the missing ones
    if i == 0:
        for j in range(ny):
            q[c, j] += g_in[k] * (T_in[k, j] - T[c, j])
            q[c, j] += w * h_in[k, j] - w * (h[c, j] + s * (h[c, j] - h_in[k, j]))
        return
    r, back = upwind[i - 1], start[i - 1] + k
    if i == 1:
        for j in range(ny):
            near = h[back, j]
            q[c, j] += w * (near + r * (near - h_in[k, j])) - w * (h[c, j] + s * (h[c, j] - near))
        return
    old = start[i - 2] + k
    for j in range(ny):
        near = h[back, j]
        q[c, j] += w * (near + r * (near - h[old, j])) - w * (h[c, j] + s * (h[c, j] - near))


@njit(cache=True)
def _line_bounds(i, start):
    """First rows of line i, of the line upstream (line i itself if there is none), and of the two lines downstream."""
    a, b = start[i], start[i + 1]
    return a, start[i - 1] if i > 0 else a, b, start[i + 2] if i + 2 < len(start) else b


@njit(cache=True)
def _neighbour_rows(k, line, m):
    """Rows above, below, upstream and downstream of level k of a line with these `_line_bounds`.

    Where there is no neighbour, and across the interface, the row itself stands in: its temperature difference is zero,
    so the inner loops need no branch.
    """
    a, before, b, end = line
    c = a + k
    up = c + 1 if c + 1 < b and k + 1 != m else c
    down = c - 1 if k > 0 and k != m else c
    back = before + k if before + k < a else c
    to = b + k if b + k < end else c
    return up, down, back, to


@njit(cache=True)
def uniform_rates(lines, walls, advection, T, h, T_in, h_in, q):
    """Turn heat `q` (cells of a plane, planes) into rates K/s in place, for constant conductivity.

    On entry `q` is the heat of boundary and contact in W.  `T_in`, `h_in` are (m, planes); other arguments are as in
    `kernels_2d.add_heat_flows`.
    """
    start, m, _, capacity, upwind, g_in, _, share = lines  # locals: attribute access in a loop counts references
    gx, gz, gy, _, _, _, _, _, before, after = walls
    n, ny = len(start) - 1, T.shape[1]
    for i in range(n):
        line = _line_bounds(i, start)
        for c in range(line[0], line[2]):
            k = c - line[0]
            up, down, back, to = _neighbour_rows(k, line, m)
            over, under, ahead, along = gz[c], gz[down], gx[c], gx[to]
            for j in range(ny):
                here = T[c, j]
                z = (T[up, j] - here) * over + (T[down, j] - here) * under
                # W of this plane to W per metre of the block's width, the unit of the conductances
                q[c, j] = q[c, j] / share[j] + (z + (T[back, j] - here) * ahead + (T[to, j] - here) * along)
            _advect_row(i, k, c, m, start, advection, upwind, T, h, T_in, h_in, g_in, q)
            g = gy[c]
            for j in range(1, ny):
                q[c, j] += g * before[j] * (T[c, j - 1] - T[c, j])
            for j in range(ny - 1):
                q[c, j] += g * after[j] * (T[c, j + 1] - T[c, j])
            unit = 1.0 / capacity[c]
            for j in range(ny):
                q[c, j] *= unit


@njit(cache=True)
def varying_rates(lines, walls, advection, T, h, T_in, h_in, q):
    """`uniform_rates` for conductivity that varies: every conductance is two half-cells in series."""
    start, m, _, capacity, upwind, g_in, _, share = lines
    _, _, gy, half_x, half_z, gap, factor, dy, _, _ = walls
    n, ny = len(start) - 1, T.shape[1]
    for i in range(n):
        line = _line_bounds(i, start)
        for c in range(line[0], line[2]):
            k = c - line[0]
            up, down, back, to = _neighbour_rows(k, line, m)
            for j in range(ny):
                # gap[c] is the joint above cell c, so the face below has that of the cell there
                f, here = factor[c, j], T[c, j]
                over = (T[up, j] - here) * (1.0 / (half_z[c] / f + half_z[up] / factor[up, j] + gap[c]))
                under = (T[down, j] - here) * (1.0 / (half_z[c] / f + half_z[down] / factor[down, j] + gap[down]))
                ahead = (T[back, j] - here) * (1.0 / (half_x[c] / f + half_x[back] / factor[back, j]))
                along = (T[to, j] - here) * (1.0 / (half_x[c] / f + half_x[to] / factor[to, j]))
                q[c, j] = q[c, j] / share[j] + (over + under + ahead + along)
            _advect_row(i, k, c, m, start, advection, upwind, T, h, T_in, h_in, g_in, q)
            g = gy[c]
            for j in range(1, ny):
                apart = 0.5 * (dy[j] / factor[c, j] + dy[j - 1] / factor[c, j - 1])
                q[c, j] += g * (1.0 / (apart * dy[j])) * (T[c, j - 1] - T[c, j])
            for j in range(ny - 1):
                apart = 0.5 * (dy[j + 1] / factor[c, j + 1] + dy[j] / factor[c, j])
                q[c, j] += g * (1.0 / (apart * dy[j])) * (T[c, j + 1] - T[c, j])
            unit = 1.0 / capacity[c]
            for j in range(ny):
                q[c, j] *= unit


@njit(cache=True)
def _subtract_row(z, to, factor, source, ny):
    """z[to] -= factor z[source] along a row."""
    for j in range(ny):
        z[to, j] -= factor * z[source, j]


@njit(cache=True)
def solve_line(o, a, size, m, gamma, up, down, under, over, inv, mul, z):
    """`kernels_2d.solve_line` for rows of z; `under`, `over` (planes,) are 1/pivot of road and block at the interface.

    All planes have the pivots of the mean plane except these two: the contact differs from plane to plane.
    """
    ny, nb, f = z.shape[1], size - m, a - o
    s, top = o + m - 1, o + size - 1
    for k in range(1, m):
        _subtract_row(z, o + k, mul[a + k], o + k - 1, ny)
    for k in range(1, nb):
        _subtract_row(z, top - k, mul[f + top - k], top - k + 1, ny)
    if nb == 0:
        for j in range(ny):
            z[s, j] *= inv[f + s]
    else:
        for j in range(ny):
            # road from below and block from above are eliminated: two cells at the interface remain, a 2 x 2 system
            u, d = -gamma * up[j], -gamma * down[j]
            road, block = z[s, j], z[s + 1, j]
            scale = 1.0 / (1.0 - u * d * under[j] * over[j])
            z[s, j] = (road - u * over[j] * block) * under[j] * scale
            z[s + 1, j] = (block - d * under[j] * road) * over[j] * scale
    for k in range(1, m):
        i, g = inv[f + s - k], mul[f + s - k + 1]
        for j in range(ny):
            z[s - k, j] = z[s - k, j] * i - g * z[s - k + 1, j]
    for k in range(1, nb):
        i, g = inv[f + s + 1 + k], mul[f + s + k]
        for j in range(ny):
            z[s + 1 + k, j] = z[s + 1 + k, j] * i - g * z[s + k, j]


@njit(cache=True, fastmath=FASTMATH_SUM)
def _row_mean(z, c, share, ny):
    """Mean of a row across y."""
    total = 0.0
    for j in range(ny):
        total += share[j] * z[c, j]
    return total


@njit(cache=True)
def sweep_lines(lines, factors, crossing, gamma, r, z):
    """z = P^-1 (capacity r): the sweeps of `kernels_2d.sweep_lines` for all planes; P has no conduction across y.

    Returns the heat (J per metre of width, rows weighted by `weight`) in r and in z.
    """
    # the loops over lines stay in one function: split up they cost a quarter more (docs/explanation/performance.md)
    start, m, first, capacity, _, _, weight, share = lines
    inv, mul, low, low2, high = factors
    up, down, under, over = crossing
    n, ny = len(start) - 1, r.shape[1]
    longest = 0
    heat_in = 0.0
    for i in range(n):
        a, b = start[i], start[i + 1]
        size = b - a
        longest = max(longest, size)
        p = start[i - 1] if i > 0 else a
        for k in range(size):
            c = a + k
            w = capacity[c]
            heat_in += weight[c] * w * _row_mean(r, c, share, ny)
            if i > 1 and k < m:
                f, g, old, older = low[c], low2[c], p + k, start[i - 2] + k
                for j in range(ny):
                    z[c, j] = w * r[c, j] - f * z[old, j] - g * z[older, j]
            elif i > 0 and k < a - p:
                f, old = low[c], p + k
                for j in range(ny):
                    z[c, j] = w * r[c, j] - f * z[old, j]
            else:
                for j in range(ny):
                    z[c, j] = w * r[c, j]
        at = i - first if size > m else 0
        solve_line(a, a, size, m, gamma, up[at], down[at], under[at], over[at], inv, mul, z)
    work = np.empty((longest, ny))
    for i in range(n - 2, -1, -1):
        a, b = start[i], start[i + 1]
        size = b - a
        top = min(size, start[i + 2] - b)
        for k in range(top):
            f = high[a + k]
            for j in range(ny):
                work[k, j] = f * z[b + k, j]
        for k in range(top, size):
            for j in range(ny):
                work[k, j] = 0.0
        at = i - first if size > m else 0
        solve_line(0, a, size, m, gamma, up[at], down[at], under[at], over[at], inv, mul, work)
        for k in range(size):
            for j in range(ny):
                z[a + k, j] -= work[k, j]
    heat_out = 0.0
    for c in range(start[n]):
        heat_out += weight[c] * capacity[c] * _row_mean(z, c, share, ny)
    return heat_in, heat_out


@njit(cache=True)
def lift_block(start, m, rise, z):
    """Add `rise` (K) to all cells of the block."""
    for i in range(len(start) - 1):
        for c in range(start[i] + m, start[i + 1]):
            for j in range(z.shape[1]):
                z[c, j] += rise
