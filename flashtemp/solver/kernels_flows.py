"""The compiled loops of the rates: conduction and advection between cells, films, slopes and deposits.

Arrays are packed by lines (`mesh.Mesh`); `m` is the number of road cells of every line.  Everything here is linear in
the temperatures, so complex arrays pass through and give exact derivatives.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def face_conductances(start, m, half_x, half_z, factor, gx, gz):
    """Series conductances W/(m K) per metre across: gx to the line upstream, gz to the cell above.

    `half_x`, `half_z` are half-cell resistances at reference conductivity, `factor` k/k_reference.
    """
    n = len(start) - 1
    for i in range(n):
        a, b = start[i], start[i + 1]
        for c in range(a, b - 1):
            gz[c] = 1.0 / (half_z[c] / factor[c] + half_z[c + 1] / factor[c + 1])
        gz[b - 1] = 0.0
        if b - a > m:
            gz[a + m - 1] = 0.0  # the interface belongs to the contact laws
        before = 0 if i == 0 else a - start[i - 1]
        for c in range(a, b):
            if c - a < before:
                p = start[i - 1] + c - a
                gx[c] = 1.0 / (half_x[c] / factor[c] + half_x[p] / factor[p])
            else:
                gx[c] = 0.0


@njit(cache=True)
def heat_flows(lines, gx, gz, carry, T, h, T_in, h_in, rate):
    """Add conduction and advection to `rate` (W/m per cell): every flux once added, once taken.

    `lines` as in `kernel_arrays`, `T` temperature rise, `h` enthalpy rise over rho c (both K), `carry` rho c v dz of
    the road's cells (W/(m K)), `T_in`, `h_in` (m,) rises of the entering road.
    """
    start, m, slope, g_in = lines.start, lines.m, lines.slope, lines.g_in
    n = len(start) - 1
    for i in range(n):
        a, b = start[i], start[i + 1]
        for c in range(a, b - 1):
            q = gz[c] * (T[c + 1] - T[c])
            rate[c] += q
            rate[c + 1] -= q
        if i == 0:
            for k in range(m):
                rate[a + k] += g_in[k] * (T_in[k] - T[a + k]) + carry[k] * h_in[k]
        else:
            p = start[i - 1]
            for k in range(min(b - a, a - p)):
                q = gx[a + k] * (T[p + k] - T[a + k])
                rate[a + k] += q
                rate[p + k] -= q
        s = slope[i]
        for k in range(m):
            back = h_in[k] if i == 0 else h[start[i - 1] + k]
            q = carry[k] * (h[a + k] + s * (h[a + k] - back))
            rate[a + k] -= q
            if i + 1 < n:
                rate[b + k] += q


@njit(cache=True)
def _advect(i, k, c, m, start, carry, slope, T, h, T_in, h_in, g_in, q):
    """Add to row c, place k of line i, what the moving road carries in and out."""
    if k >= m:
        return
    ny, s, w = q.shape[1], slope[i], carry[k]
    if i == 0:
        for j in range(ny):
            q[c, j] += g_in[k] * (T_in[k, j] - T[c, j])
            q[c, j] += w * h_in[k, j] - w * (h[c, j] + s * (h[c, j] - h_in[k, j]))
        return
    r, back = slope[i - 1], start[i - 1] + k
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
def _line(i, start):
    """First row of line i, of the one upstream (itself where there is none), of the two downstream."""
    a, b = start[i], start[i + 1]
    return a, start[i - 1] if i > 0 else a, b, start[i + 2] if i + 2 < len(start) else b


@njit(cache=True)
def _neighbours(k, line, m):
    """Rows above, below, upstream, downstream of place k of a `_line`; its own where none is or the interface lies."""
    a, before, b, end = line
    c = a + k
    up = c + 1 if c + 1 < b and k + 1 != m else c
    down = c - 1 if k > 0 and k != m else c
    back = before + k if before + k < a else c
    to = b + k if b + k < end else c
    return up, down, back, to


@njit(cache=True)
def _along(g, at, half, factor, c, other, j):
    """Conductance in plane j between cells c and `other`, `g[at]` while conductivity is constant."""
    if factor.ndim == 1:
        return g[at]
    return 1.0 / (half[c] / factor[c, j] + half[other] / factor[other, j])


@njit(cache=True)
def _sideways(even, dy, factor, c, j, other):
    """1/(distance dy) from plane j of cell c to plane `other`, `even[j]` while conductivity is constant."""
    if factor.ndim == 1:
        return even[j]
    return 1.0 / (0.5 * (dy[j] / factor[c, j] + dy[other] / factor[c, other]) * dy[j])


@njit(cache=True)
def flows_across(lines, walls, carry, T, h, T_in, h_in, q):
    """q (cells of a plane, planes): heat in W per metre of width on entry, rates in K/s on return.

    What `heat_flows` does for one plane, for all at once: every inner loop runs along the row of neighbours across.
    """
    start, m, share = lines.start, lines.m, lines.share
    factor, ny = walls.factor, T.shape[1]
    for i in range(len(start) - 1):
        line = _line(i, start)
        for c in range(line[0], line[2]):
            k = c - line[0]
            up, down, back, to = _neighbours(k, line, m)
            for j in range(ny):
                here = T[c, j]
                over = (T[up, j] - here) * _along(walls.gz, c, walls.half_z, factor, c, up, j)
                under = (T[down, j] - here) * _along(walls.gz, down, walls.half_z, factor, c, down, j)
                ahead = (T[back, j] - here) * _along(walls.gx, c, walls.half_x, factor, c, back, j)
                along = (T[to, j] - here) * _along(walls.gx, to, walls.half_x, factor, c, to, j)
                q[c, j] = q[c, j] / share[j] + (over + under + ahead + along)
            _advect(i, k, c, m, start, carry, lines.slope, T, h, T_in, h_in, lines.g_in, q)
            g = walls.gy[c]
            for j in range(1, ny):
                q[c, j] += g * _sideways(walls.before, walls.dy, factor, c, j, j - 1) * (T[c, j - 1] - T[c, j])
            for j in range(ny - 1):
                q[c, j] += g * _sideways(walls.after, walls.dy, factor, c, j, j + 1) * (T[c, j + 1] - T[c, j])
            unit = 1.0 / lines.capacity[c]
            for j in range(ny):
                q[c, j] *= unit


@njit(cache=True)
def add_slopes(cell, slope, road, block, up, down, v, rate):
    """Add the linearised boundary and contact laws to `rate`: on the diagonal at `cell`, and across the interface.

    `road`, `block` (columns,) are the cells on both sides of the interface, `up`, `down` their slopes.
    """
    for i in range(len(cell)):
        rate[cell[i]] += slope[i] * v[cell[i]]
    for i in range(len(road)):
        rate[road[i]] += up[i] * v[block[i]]
        rate[block[i]] += down[i] * v[road[i]]


@njit(cache=True)
def exchange(offset, cell, area, half, factor, film, far, T, rate, total, surface):
    """Convective films: heat (W/m per cell) from `far` (K) through `film` (m2 K/W) and half a cell.

    Sites are packed: faces offset[s]..offset[s+1]-1.  Adds to `rate`;
    `total` gets each site's heat (W/m), `surface` its area-weighted surface temperature (K m).
    """
    for s in range(len(offset) - 1):
        total[s] = 0.0
        surface[s] = 0.0
        if film[s] == np.inf:
            continue
        for j in range(offset[s], offset[s + 1]):
            c = cell[j]
            inner = half[j] / factor[c]
            g = area[j] / (inner + film[s])
            q = g * (far[s] - T[c])
            rate[c] += q
            total[s] += q
            surface[s] += area[j] * T[c] + q * inner


@njit(cache=True)
def deposit(block, weight, power, rate):
    """Volumetric friction heat: `power` (W/m per line) shared over block cells by `weight`."""
    for i in range(block.shape[0]):
        for k in range(len(weight)):
            rate[block[i, k]] += weight[k] * power[i]


@njit(cache=True)
def lift(start, m, rise, z):
    """Add `rise` to all cells (of a plane, planes) of the block."""
    for i in range(len(start) - 1):
        for c in range(start[i] + m, start[i + 1]):
            for j in range(z.shape[1]):
                z[c, j] += rise
