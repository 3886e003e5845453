"""The compiled loops: heat flows between cells, and depth-line solves swept downstream.

Arrays are packed by lines (`mesh.Mesh`); `m` is the number of road cells of every line.  Everything
here is linear in the temperatures, so complex arrays pass through and give exact derivatives.
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.just_in_time import njit


@njit(cache=True)
def face_conductances(start, m, half_x, half_z, gap, factor, gx, gz):
    """Series conductances W/(m K) per metre across: gx to the line upstream, gz to the cell above.

    `half_x`, `half_z` are half-cell resistances at reference conductivity, `gap` that of a contact with the cell above,
    `factor` k/k_reference.
    """
    n = len(start) - 1
    for i in range(n):
        a, b = start[i], start[i + 1]
        for c in range(a, b - 1):
            gz[c] = 1.0 / (half_z[c] / factor[c] + half_z[c + 1] / factor[c + 1] + gap[c])
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
def add_heat_flows(start, m, gx, gz, advection, upwind, T, h, T_in, h_in, g_in, rate):
    """Add conduction and advection to `rate` (W/m per cell): every flux once added, once taken.

    `T` temperature rise, `h` enthalpy rise over rho c (both K), `advection` rho c v dz of the road cells (W/(m K)), `upwind`
    the second-order upwind weight of every line, `T_in`, `h_in` (m,) rises of the entering road, `g_in` its
    conductance to the first line.
    """
    n = len(start) - 1
    for i in range(n):
        a, b = start[i], start[i + 1]
        for c in range(a, b - 1):
            q = gz[c] * (T[c + 1] - T[c])
            rate[c] += q
            rate[c + 1] -= q
        if i == 0:
            for k in range(m):
                rate[a + k] += g_in[k] * (T_in[k] - T[a + k]) + advection[k] * h_in[k]
        else:
            p = start[i - 1]
            for k in range(min(b - a, a - p)):
                q = gx[a + k] * (T[p + k] - T[a + k])
                rate[a + k] += q
                rate[p + k] -= q
        s = upwind[i]
        for k in range(m):
            back = h_in[k] if i == 0 else h[start[i - 1] + k]
            q = advection[k] * (h[a + k] + s * (h[a + k] - back))
            rate[a + k] -= q
            if i + 1 < n:
                rate[b + k] += q


@njit(cache=True)
def find_undershoots(start, m, upwind, floor, h, h_in):
    """Faces (n, 4) between road cells whose extrapolated value lies below their own cell and below the `floor`.

    Of each the cell, the cell upstream (-1: road that enters), the cell downstream and the depth level; cells count
    within planes.  h (cells,), h_in (m planes,) rises.
    """
    across = len(h_in) // m
    hits = np.zeros((len(start) - 2, m), np.int64)
    for i in range(len(start) - 2):
        s = upwind[i]
        for k in range(m):
            c, count = (start[i] + k) * across, 0
            if i > 0:
                p = (start[i - 1] + k) * across
                for j in range(across):  # no branches: it runs on whole vectors of planes
                    own = h[c + j].real
                    face = own + s * (own - h[p + j].real)
                    count += (face < floor) & (face < own)
            else:
                for j in range(across):
                    own = h[c + j].real
                    face = own + s * (own - h_in[k * across + j].real)
                    count += (face < floor) & (face < own)
            hits[i, k] = count
    found = np.empty((hits.sum(), 4), np.int64)
    n = 0
    for i in range(len(hits)):
        for k in range(m):
            for j in range(across if hits[i, k] > 0 else 0):
                c, p = (start[i] + k) * across + j, (start[i - 1] + k) * across + j if i > 0 else -1
                back = h[p].real if i > 0 else h_in[k * across + j].real
                face = h[c].real + upwind[i] * (h[c].real - back)
                if face < floor and face < h[c].real:
                    found[n] = c, p, (start[i + 1] + k) * across + j, k
                    n += 1
    return found


@njit(cache=True)
def limit_faces(faces, line, across, upwind, advection, capacity, floor, h, h_in, rate):
    """Add to `rate` (cells,) K/s what faces advection more where they hold the lesser of their cell and the `floor`.

    `line` (n_plane,) of a cell of a plane.  What leaves one cell enters the next, so that heat is conserved.
    """
    for f in range(len(faces)):
        c, p, after, k = faces[f]
        back = h[p] if p >= 0 else h_in[k * across + c % across]
        face = h[c] + upwind[line[c // across]] * (h[c] - back)
        held = h[c] if h[c].real < floor else 0.0 * h[c] + floor
        q = advection[k] * (held - face)
        rate[c] -= q / capacity[c // across]
        rate[after] += q / capacity[after // across]


@njit(cache=True)
def limit_products(faces, line, across, upwind, advection, capacity, held, v, rate):
    """The derivative of `limit_faces`: add to `rate` what changes v (cells,) do.

    `held` says of every face whether it holds its cell (else the floor).
    """
    for f in range(len(faces)):
        c, p, after, k = faces[f]
        back = v[p] if p >= 0 else 0.0 * v[c]
        face = v[c] + upwind[line[c // across]] * (v[c] - back)
        q = advection[k] * ((v[c] if held[f] else 0.0 * v[c]) - face)
        rate[c] -= q / capacity[c // across]
        rate[after] += q / capacity[after // across]


@njit(cache=True)
def solve_line(o, a, size, m, gamma, up, down, inv, mul, z):
    """Solve one depth line in place, z starting at o, with the factors of `factorise_lines`."""
    nb = size - m
    f = a - o
    s, top = o + m - 1, o + size - 1
    both = min(m, nb)
    road = z[o]  # running values in registers: the next step need not wait for the store
    block = z[top]
    for k in range(1, both):
        road = z[o + k] - mul[a + k] * road
        z[o + k] = road
        block = z[top - k] - mul[f + top - k] * block
        z[top - k] = block
    for k in range(max(both, 1), m):
        road = z[o + k] - mul[a + k] * road
        z[o + k] = road
    for k in range(max(both, 1), nb):
        block = z[top - k] - mul[f + top - k] * block
        z[top - k] = block
    if nb == 0:
        road = road * inv[f + s]
    else:
        under, over = inv[f + s], inv[f + s + 1]
        u, d = -gamma * up, -gamma * down
        scale = 1.0 / (1.0 - u * d * under * over)
        road, block = (road - u * over * block) * under * scale, (block - d * under * road) * over * scale
        z[s + 1] = block
    z[s] = road
    for k in range(1, both):
        road = z[s - k] * inv[f + s - k] - mul[f + s - k + 1] * road
        z[s - k] = road
        block = z[s + 1 + k] * inv[f + s + 1 + k] - mul[f + s + k] * block
        z[s + 1 + k] = block
    for k in range(max(both, 1), m):
        road = z[s - k] * inv[f + s - k] - mul[f + s - k + 1] * road
        z[s - k] = road
    for k in range(max(both, 1), nb):
        block = z[s + 1 + k] * inv[f + s + 1 + k] - mul[f + s + k] * block
        z[s + 1 + k] = block


@njit(cache=True)
def factorise_lines(lines, transport, gamma, own, up, down, factors):
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
        _fill_diagonal(i, lines, transport, gamma, own, fix, factors)
        fix[:] = 0.0
        _eliminate_line(start[i], start[i + 1] - start[i], m, gamma, transport.gz, factors.inv, factors.mul)
        if i + 2 < len(start):
            at = i - lines.first if start[i + 1] - start[i] > m else 0
            _correct_column_sums(i, lines, transport, gamma, up[at], down[at], factors, work, fix)


@njit(cache=True)
def _fill_diagonal(i, lines, transport, gamma, own, fix, factors):
    """Diagonal of line i, into `factors.inv` for `_eliminate_line`, and its couplings to the lines around it."""
    start, m, _, capacity, upwind, g_in, _, _ = lines
    gx, gz, advection, stretch = transport
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
            s = upwind[i]
            d -= advection[k] * (1.0 + s) * stretch[c]
            if i == 0:
                d -= g_in[k]
                low[c] = 0.0
            else:
                low[c] -= gamma * advection[k] * (1.0 + upwind[i - 1] + s) * stretch[start[i - 1] + k]
                if i > 1:
                    low2[c] = gamma * advection[k] * upwind[i - 1] * stretch[start[i - 2] + k]
        inv[c] = capacity[c] * stretch[c] - gamma * d + fix[k]


@njit(cache=True)
def _eliminate_line(a, size, m, gamma, gz, inv, mul):
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
def _correct_column_sums(i, lines, transport, gamma, up, down, factors, work, fix):
    """Column sums of L D^-1 U from line i, which go back onto the next diagonal: `fix`."""
    start, m, _, _, upwind, _, weight, _ = lines
    gx, _, advection, stretch = transport
    inv, mul, _, _, high = factors
    a, b = start[i], start[i + 1]
    size, top = b - a, min(b - a, start[i + 2] - b)
    work[:size] = 0.0
    for k in range(top):
        s = -gamma * gx[b + k]
        if k < m:
            carried = gamma * advection[k]
            s -= carried * (1.0 + upwind[i] + upwind[i + 1]) * stretch[a + k]
            if i + 3 < len(start):
                s += carried * upwind[i + 1] * stretch[a + k]
        work[k] = s * weight[a + k]
    # D is symmetric but for the interface: D^T is D with `up` and `down` exchanged
    solve_line(0, a, size, m, gamma, down, up, inv, mul, work)
    for k in range(top):
        fix[k] = -work[k] * high[a + k] / weight[a + k]


@njit(cache=True)
def sweep_lines(start, m, first, capacity, gamma, up, down, inv, mul, low, low2, high, r, z):
    """z = P^-1 (capacity r): lines solved in the direction of sliding, then corrected back.

    Arrays one by one: to unpack bundles takes 4 us of each call's 80.
    """
    n = len(start) - 1
    longest = 0
    for i in range(n):
        longest = max(longest, start[i + 1] - start[i])
        a, b = start[i], start[i + 1]
        size = b - a
        for c in range(a, b):
            z[c] = capacity[c] * r[c]
        if i > 0:
            p = start[i - 1]
            for k in range(min(size, a - p)):
                z[a + k] -= low[a + k] * z[p + k]
        if i > 1:
            p = start[i - 2]
            for k in range(m):
                z[a + k] -= low2[a + k] * z[p + k]
        at = i - first if size > m else 0
        solve_line(a, a, size, m, gamma, up[at], down[at], inv, mul, z)
    work = np.empty(longest)
    for i in range(n - 2, -1, -1):
        a, b = start[i], start[i + 1]
        size = b - a
        top = min(size, start[i + 2] - b)
        for k in range(top):
            work[k] = high[a + k] * z[b + k]
        for k in range(top, size):
            work[k] = 0.0
        at = i - first if size > m else 0
        solve_line(0, a, size, m, gamma, up[at], down[at], inv, mul, work)
        for k in range(size):
            z[a + k] -= work[k]


@njit(cache=True)
def add_slopes(cell, slope, road, block, own, up, down, v, lane, rate):
    """Add the linearised boundary and contact laws to `rate`: on the diagonal at `cell`, and across the interface.

    `road`, `block` (columns,) are the cells on both sides of the interface, `own`, `down` the slopes of their heat
    with the `lane` (columns,), `up` that of the road's heat with the block.
    """
    for i in range(len(cell)):
        rate[cell[i]] += slope[i] * v[cell[i]]
    for i in range(len(road)):
        rate[road[i]] += up[i] * v[block[i]] + own[i] * lane[i]
        rate[block[i]] += down[i] * lane[i]


@njit(cache=True)
def add_film_heat(offset, cell, area, half, factor, film, far, T, rate, total, surface):
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
def deposit_heat(block, weight, power, rate):
    """Volumetric friction heat: `power` (W/m per line) shared over block cells by `weight`."""
    for i in range(block.shape[0]):
        for k in range(len(weight)):
            rate[block[i, k]] += weight[k] * power[i]
