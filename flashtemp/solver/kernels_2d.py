"""Compiled loops in 2D: heat flows between cells, and the depth-line preconditioner (theory.md, section 8).

Arrays are packed by depth lines (`mesh.Mesh`); `m` is the number of road cells of every line.  Neighbours follow from
the offsets `start`, so the loops read no index arrays: the cell at the same level of the line upstream of cell
start[i] + k is start[i - 1] + k.  Heat flows are linear in the temperatures, so a complex step passes through and
gives exact derivatives.
"""

from __future__ import annotations

import numpy as np

from flashtemp.physics.just_in_time import njit


@njit(cache=True)
def face_conductances(start, m, half_x, half_z, gap, factor, gx, gz):
    """Conductances W/(m K) per metre across: `gx` to the line upstream, `gz` to the cell above.

    Two half-cells conduct in series, and between them the resistance `gap` of a joint of layers (theory.md, section
    1.4).  `half_x`, `half_z` are half-cell resistances at the reference conductivity, `factor` is k/k_reference.
    """
    n = len(start) - 1
    for i in range(n):
        a, b = start[i], start[i + 1]
        for c in range(a, b - 1):
            gz[c] = 1.0 / (half_z[c] / factor[c] + half_z[c + 1] / factor[c + 1] + gap[c])
        gz[b - 1] = 0.0
        if b - a > m:
            gz[a + m - 1] = 0.0  # the contact laws conduct across the interface, not this conductance
        # a line under the block is longer than one of free road: cells above the shorter one have no neighbour
        before = 0 if i == 0 else a - start[i - 1]
        for c in range(a, b):
            if c - a < before:
                p = start[i - 1] + c - a
                gx[c] = 1.0 / (half_x[c] / factor[c] + half_x[p] / factor[p])
            else:
                gx[c] = 0.0


@njit(cache=True)
def add_heat_flows(start, m, gx, gz, advection, upwind, T, h, T_in, h_in, g_in, rate):
    """Add conduction and advection to `rate` (W/m per cell), eqs. (8) and (10) of theory.md.

    Every flux is added to one cell and subtracted from another, so heat is conserved to rounding.
    `T` and `h` are the temperature rise and the enthalpy rise over rho c (K), `advection` (m,) is rho c v dz of road
    cells in W/(m K), `upwind` (lines,) the weight of the second-order upwind scheme.  `T_in`, `h_in` (m,) are rises of
    the entering road, `g_in` (m,) its conductance to the first line.
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
            # second-order upwind: the value on the downstream face is extrapolated from this cell and the one upstream
            back = h_in[k] if i == 0 else h[start[i - 1] + k]
            q = advection[k] * (h[a + k] + s * (h[a + k] - back))
            rate[a + k] -= q
            if i + 1 < n:
                rate[b + k] += q


@njit(cache=True)
def find_undershoots(start, m, upwind, floor, h, h_in):
    """Faces between road cells whose extrapolated value is below the cell upstream of them and below the `floor`.

    Returns (n, 4): the cell upstream of the face, the next cell upstream (-1 for the entering road), the cell
    downstream, and the depth level.  `h` (cells,), `h_in` (m planes,) are enthalpy rises of all planes.
    """
    across = len(h_in) // m
    # two passes: nearly every call finds nothing, so the first only counts, and the second fills an array that fits
    hits = np.zeros((len(start) - 2, m), np.int64)
    for i in range(len(start) - 2):
        s = upwind[i]
        for k in range(m):
            c, count = (start[i] + k) * across, 0
            if i > 0:
                p = (start[i - 1] + k) * across
                for j in range(across):  # without branches the compiler vectorises over planes
                    cell = h[c + j].real
                    face = cell + s * (cell - h[p + j].real)
                    count += (face < floor) & (face < cell)
            else:
                for j in range(across):
                    cell = h[c + j].real
                    face = cell + s * (cell - h_in[k * across + j].real)
                    count += (face < floor) & (face < cell)
            hits[i, k] = count
    faces = np.empty((hits.sum(), 4), np.int64)
    n = 0
    for i in range(len(hits)):
        for k in range(m):
            for j in range(across if hits[i, k] > 0 else 0):
                c, p = (start[i] + k) * across + j, (start[i - 1] + k) * across + j if i > 0 else -1
                back = h[p].real if i > 0 else h_in[k * across + j].real
                face = h[c].real + upwind[i] * (h[c].real - back)
                if face < floor and face < h[c].real:
                    faces[n] = c, p, (start[i + 1] + k) * across + j, k
                    n += 1
    return faces


@njit(cache=True)
def limit_faces(faces, line, across, upwind, advection, capacity, floor, h, h_in, rate):
    """Limit the values on `faces` from below, and add the change of the advected heat to `rate` (cells,) K/s.

    The limited value is the `floor`, or the cell upstream if that is colder (Zhang and Shu 2010).  `line` (n_plane,) is
    the line number of every cell of a plane.  One cell loses what the next gains, so heat is conserved.
    """
    for f in range(len(faces)):
        c, p, after, k = faces[f]
        back = h[p] if p >= 0 else h_in[k * across + c % across]
        face = h[c] + upwind[line[c // across]] * (h[c] - back)
        limited = h[c] if h[c].real < floor else 0.0 * h[c] + floor  # 0 h keeps the type: complex stays complex
        q = advection[k] * (limited - face)
        rate[c] -= q / capacity[c // across]
        rate[after] += q / capacity[after // across]


@njit(cache=True)
def limit_products(faces, line, across, upwind, advection, capacity, at_cell, v, rate):
    """Jacobian product of `limit_faces`: add its change by changes `v` (cells,) of the enthalpy rise to `rate`.

    `at_cell` (faces,) is True where a face is limited to its cell, False where it is limited to the constant floor.
    """
    for f in range(len(faces)):
        c, p, after, k = faces[f]
        back = v[p] if p >= 0 else 0.0 * v[c]
        face = v[c] + upwind[line[c // across]] * (v[c] - back)
        # the limited face no longer depends on the cell upstream, and at the floor on no cell
        q = advection[k] * ((v[c] if at_cell[f] else 0.0 * v[c]) - face)
        rate[c] -= q / capacity[c // across]
        rate[after] += q / capacity[after // across]


@njit(cache=True)
def solve_line(o, a, size, m, gamma, up, down, inv, mul, z):
    """Solve one depth line in place; z holds it from index `o` on, the factors of `factorise_lines` from `a` on.

    The tridiagonal system is eliminated from both ends towards the interface, so road and block are two independent
    chains, which the processor runs at once.  At the interface remain two equations for the cells on both sides, with
    the couplings `up` and `down` of the contact; they are solved directly, then both chains are substituted back.
    """
    nb = size - m
    f = a - o
    s, top = o + m - 1, o + size - 1
    both = min(m, nb)
    road = z[o]  # kept in registers: the next row does not wait for the store of this one
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
    K's entries across the interface: d(road rate)/d(block T) and d(block rate)/d(road T).  P is the exact matrix plus
    L D^-1 U.  The diagonals D are corrected by the column sums of that product, so that every column of P, with its
    rows weighted by `weight`, sums to that of the exact matrix.  The preconditioner then conserves heat (theory.md,
    section 8).
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
            at = i - lines.first if start[i + 1] - start[i] > m else 0  # any entry will do for a line of free road
            _correct_column_sums(i, lines, transport, gamma, up[at], down[at], factors, work, fix)


@njit(cache=True)
def _fill_diagonal(i, lines, transport, gamma, own, fix, factors):
    """Diagonal of line i, written to `factors.inv` for `_eliminate_line`, and its couplings to other lines.

    `low` couples to the line upstream, `low2` to the second line upstream (the second-order upwind scheme extrapolates
    from two lines), `high` to the line downstream.  `stretch` is dh/dT: rates follow the temperature, and advection
    carries enthalpy.
    """
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
    """Pivots of a line from both ends towards the interface, as `solve_line` needs them; the diagonal is in `inv`."""
    # both ends first: the interface comes last, so that its pivots alone differ between planes (theory.md, section 8)
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
    """Weighted column sums of L D^-1 U for line i, written to `fix` to correct the diagonal of the next line.

    With e the weighted column sums of L, those of L D^-1 U are (D^-T e) U: one transposed line solve.
    """
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
    # D is symmetric except at the interface, so D^T is D with `up` and `down` exchanged
    solve_line(0, a, size, m, gamma, down, up, inv, mul, work)
    for k in range(top):
        fix[k] = -work[k] * high[a + k] / weight[a + k]


@njit(cache=True)
def sweep_lines(start, m, first, capacity, gamma, up, down, inv, mul, low, low2, high, r, z):
    """z = P^-1 (capacity r): a forward sweep (D + L) in the direction of sliding, then a backward sweep (D + U).

    Arrays come one by one, because unpacking named tuples takes 4 us of the 80 us of a call.
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
    for i in range(n - 2, -1, -1):  # backward: z_i -= D_i^-1 U_i z_(i+1)
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

    `road`, `block` (columns,) are the cells on both sides of the interface.  `own` and `down` are the derivatives of
    their heat with the change `lane` (columns,) of the lanes, `up` that of the road's heat with the block.
    """
    for i in range(len(cell)):
        rate[cell[i]] += slope[i] * v[cell[i]]
    for i in range(len(road)):
        rate[road[i]] += up[i] * v[block[i]] + own[i] * lane[i]
        rate[block[i]] += down[i] * lane[i]


@njit(cache=True)
def add_film_heat(offset, cell, area, half, factor, film, far, T, rate, total, surface):
    """Heat transfer to the surroundings: heat (W/m per cell) from `far` (K) through `film` and half a cell.

    `film` (sites,) is 1/h in m2 K/W, inf where nothing passes.  Site s has the faces offset[s] to offset[s+1] - 1.
    Adds to `rate`; `total` receives the heat of each site (W/m), `surface` its area-weighted surface temperature (K m).
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
    """Distribute volumetric friction heat, `power` (columns,) W/m, over the block's cells by `weight` (eq. (7))."""
    for i in range(block.shape[0]):
        for k in range(len(weight)):
            rate[block[i, k]] += weight[k] * power[i]
