"""Compliance of the face of an elastic block bonded to its holder, by mixed finite elements (theory.md, eq. (21)).

Small strains, one modulus, one Poisson ratio; plane strain, or three dimensions where the breadth is given.  The top is
bonded to a rigid holder, the sides are free, and each column of the face has a constant traction.

Nearly incompressible rubber locks plain displacement elements.  The displacement is therefore biquadratic (in 3D
triquadratic), and the dilatation is projected onto the discontinuous linear functions of each element.  The pair Q2/P1
satisfies the inf-sup condition (Boffi, Brezzi and Fortin, Mixed Finite Element Methods and Applications, 2013, 8.6.3).
The split into dilatation and deviator is the B-bar form (Hughes, The Finite Element Method, 2000, section 4.5).

A block in three dimensions takes up to a minute, so its arrays are stored in the user's cache folder:
`$XDG_CACHE_HOME/flashtemp`, on Windows `%LOCALAPPDATA%\\flashtemp`, else `~/.cache/flashtemp`.  You can delete it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, reduce
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class _Grading(NamedTuple):
    """Sizes of elements.

    Halved elements change the pressure under a flat block with friction 0.5 by less than 1 % of the larger of its mean
    and itself, in 3D by less than 3 % of its mean except in the outermost columns.
    """

    per_column: int  # elements along a column, at least
    along: float  # largest ratio of the widths of neighbouring elements along the face, at least 2
    up: float  # the same from the face up to the holder
    per_side: int  # no element is larger than the shortest side of the block over this


CONSTANT = -1  # index of the constant term of a linear function, which belongs to no axis
CACHE_VERSION = 1  # increase with every change that affects the numbers
MOST_THERMAL_BYTES = 200_000_000
SMALLEST_PART_NODES = 30  # nested dissection ends here
PLANE = _Grading(2, 2.0, 1.3, 12)
SPACE = _Grading(1, 3.0, 2.0, 3)


@dataclass(frozen=True)
class FaceCompliance:
    """Mean displacement of each column's face by pressure, tangential traction and heat; E is Young's modulus.

    Row i, column j: displacement of i by the load on j.  Columns of a 3D block are numbered with y fastest.  With the
    areas a of the columns, in 2D widths, `a[:, None] * normal` is symmetric positive definite.  Arrays are read-only.
    """

    normal: Array  # (n, n) m: towards the holder, per pressure over E
    shear: Array  # (n, n) m: towards the holder, per traction along +x over E
    # (n, n, levels) m: of the free face towards the road, per free linear strain alpha dT of a thermal cell
    thermal: Array | None


def face_compliance(x_edges: Array, z_edges: Array, poisson: float, y_edges: Array | None = None) -> FaceCompliance:
    """Compliance of the face of a block from `z_edges[0]` (face) to `z_edges[-1]` (holder); lengths in m.

    `x_edges` (n+1,) separates the columns from the leading to the trailing edge, `z_edges` (levels+1,) the thermal
    cells from the face up.  Without `y_edges` the strain is plane.  In 3D `y_edges` (m+1,) divides the face into n m
    columns, and `thermal` is None where it would need more than 200 MB.  Raises ValueError for an invalid input.
    """
    names = ("x_edges", "z_edges") if y_edges is None else ("x_edges", "y_edges", "z_edges")
    given = (x_edges, z_edges) if y_edges is None else (x_edges, y_edges, z_edges)
    lines = [np.ascontiguousarray(e, dtype=float) for e in given]
    for name, edges in zip(names, lines, strict=True):
        if edges.ndim != 1 or len(edges) < 2 or not (np.all(np.diff(edges) > 0.0) and np.isfinite(edges).all()):
            raise ValueError(f"{name}: needs at least two finite values that increase")
    if not 0.0 <= poisson < 0.5:
        raise ValueError(f"poisson: {poisson} is not in 0 <= poisson < 0.5")
    key = tuple(e.tobytes() for e in lines)
    return _remember_compliance(key[:-1], key[-1], float(poisson))


def count_unknowns(x_edges: Array, z_edges: Array, y_edges: Array | None = None) -> int:
    """Number of displacements that `face_compliance` solves for; 176,000 in 3D took 110 s and 4.2 GB."""
    edges = [x_edges] if y_edges is None else [x_edges, y_edges]
    lines = _divide_block(edges, z_edges, PLANE if y_edges is None else SPACE)
    return int(len(lines) * np.prod([2.0 * len(li) - 1.0 for li in lines]))


def foundation_stiffness(length: float, height: float, modulus: float) -> float:
    """Mean pressure over compression (Pa/m) of a long bonded strip of incompressible rubber, E_c = 4/3 E (1 + S^2).

    S = length/(2 height).  Gent and Lindley, The compression of bonded rubber blocks, Proc. Inst. Mech. Eng. 173
    (1959), 111.

    >>> round(foundation_stiffness(0.025, 0.007, 5e6) / 1e9, 2)
    3.99
    """
    shape = length / (2.0 * height)
    return 4.0 / 3.0 * modulus * (1.0 + shape**2) / height


@lru_cache(maxsize=8)
def _remember_compliance(column_bytes: tuple[bytes, ...], z_bytes: bytes, poisson: float) -> FaceCompliance:
    """The compliance cached by the bytes of its inputs; in 3D also in a file, for later processes."""
    edges, z_edges = [np.frombuffer(b) for b in column_bytes], np.frombuffer(z_bytes)
    path = _locate_cache((*column_bytes, z_bytes), poisson) if len(edges) == 2 else None
    compliance = _read_cache(path) if path else None
    if compliance is None:
        compliance = _compute_compliance(edges, z_edges, poisson, PLANE if len(edges) == 1 else SPACE)
        if path:
            _write_cache(path, compliance)
    for array in vars(compliance).values():
        if array is not None:
            array.setflags(write=False)
    return compliance


def _compute_compliance(edges: Sequence[Array], z_edges: Array, poisson: float, grading: _Grading) -> FaceCompliance:
    """Solve for a unit force on each column; shear and heat follow by reciprocity."""
    lines = _divide_block(edges, z_edges, grading)
    block = _Block(lines, poisson)
    upward = block.mean_over_columns(edges, block.dim - 1)
    loaded, image = _find_mirror(edges)
    moved = block.solve(upward[loaded])
    normal = _mirror_loads((upward @ moved).T, loaded, image)
    along = _mirror_loads((block.mean_over_columns(edges, 0) @ moved).T, loaded, image)
    thermal = None
    if normal.size * (len(z_edges) - 1) * 8 <= MOST_THERMAL_BYTES:
        # Maysel: the displacement by heat is the integral of alpha dT times the stress trace of a unit force
        cells = _integrate_cells(block.stress_trace(moved), lines, (*edges, z_edges - z_edges[0]))
        thermal = _mirror_loads(-cells, loaded, image)
    areas = _outer_product([np.diff(e) for e in edges])
    # Betti: a force along x on column j displaces column i upward by as much as the same upward force on i
    # displaces column j along x
    return FaceCompliance(0.5 * (normal + normal.T) * areas, along * areas, thermal)


def _find_mirror(edges: Sequence[Array]) -> tuple[Indices, Indices]:
    """Columns to load, and the mirror image of every column across the breadth; all columns without symmetry."""
    index = np.arange(np.prod([len(e) - 1 for e in edges]))
    breadth = edges[-1]
    if len(edges) == 1 or np.ptp(breadth + breadth[::-1]) > 1e-9 * np.ptp(breadth):
        return index, index
    grid = index.reshape(len(edges[0]) - 1, -1)
    return grid[:, : (grid.shape[1] + 1) // 2].ravel(), grid[:, ::-1].ravel()


def _mirror_loads(response: Array, loaded: Indices, image: Indices) -> Array:
    """(columns, columns, ...): response to a load on every column, from (loaded, columns, ...) by symmetry."""
    full = np.empty((len(image), *response.shape[1:]))
    full[image[loaded]] = response[:, image]
    full[loaded] = response
    return full


def _locate_cache(inputs: Sequence[bytes], poisson: float) -> Path | None:
    """Path of the cache file for these inputs, None where the user has no cache folder."""
    folders = (os.environ.get("XDG_CACHE_HOME"), os.environ.get("LOCALAPPDATA"), os.path.expanduser("~/.cache"))
    folder = next((f for f in folders if f and os.path.isabs(f)), None)  # the XDG standard ignores relative paths
    digest = hashlib.sha256(repr((CACHE_VERSION, *SPACE, poisson, *inputs)).encode())
    return None if folder is None else Path(folder) / "flashtemp" / f"elastic_block_{digest.hexdigest()[:32]}.npz"


def _read_cache(path: Path) -> FaceCompliance | None:
    """The contents of the file; None where it is missing or damaged (the zip format contains checksums)."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return FaceCompliance(archive["normal"], archive["shear"], archive.get("thermal"))
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile):
        return None


def _write_cache(path: Path, compliance: FaceCompliance) -> None:
    """Write under a temporary name and rename, so that no reader finds half a file; errors of writing are ignored."""
    arrays = {name: array for name, array in vars(compliance).items() if array is not None}
    part = path.with_suffix(f".{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            np.savez(file, **arrays)
        os.replace(part, path)
    except OSError:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _divide_block(edges: Sequence[Array], z_edges: Array, grading: _Grading) -> list[Array]:
    """Lines of elements along the face, and from there to the holder."""
    largest = min(float(np.ptp(e)) for e in (*edges, z_edges)) / grading.per_side
    lines = [_divide_columns(e, grading.per_column, largest, grading.along) for e in edges]
    first = min(float(np.diff(li).min()) for li in lines)
    return [*lines, _grade_height(float(np.ptp(z_edges)), first, largest, grading.up)]


def _divide_columns(edges: Array, least: int, largest: float, growth: float) -> Array:
    """Lines of elements: every column in `least` or more equal parts, none too wide, neighbours of similar width."""
    width = np.diff(edges)
    parts = np.maximum(np.ceil(width / largest - 1e-9).astype(int), least)
    while True:  # terminates: with a growth of 2 or more no part becomes smaller than the smallest
        size = width / parts
        neighbour = np.minimum(np.r_[np.inf, size[:-1]], np.r_[size[1:], np.inf])
        coarse = size > growth * neighbour * (1 + 1e-9)
        if not coarse.any():
            break
        parts[coarse] += 1
    inner = [np.linspace(a, b, p + 1)[:-1] for a, b, p in zip(edges[:-1], edges[1:], parts, strict=True)]
    return np.append(np.concatenate(inner), edges[-1])


def _grade_height(height: float, first: float, largest: float, growth: float) -> Array:
    """Lines from 0 to `height`, growing geometrically from at most `first` to at most `largest`."""
    sizes: list[float] = []
    while sum(sizes) < height * (1 - 1e-9):
        sizes.append(min(first * growth ** len(sizes), largest))
    graded: Array = np.append(0.0, np.cumsum(sizes)) * (height / sum(sizes))
    return graded


class _Block:
    """Stiffness of a block of Young's modulus 1 on a grid of Q2/P1 elements; the last axis points from face to holder.

    On a rectangular grid every matrix is a sum of Kronecker products of matrices of one axis (Deville, Fischer and
    Mund, High-Order Methods for Incompressible Fluid Flow, 2002, chapter 4).  Unknowns: by component, then x, y, z.
    """

    def __init__(self, lines: Sequence[Array], poisson: float) -> None:
        from scipy.sparse import block_array, diags_array

        self.axes = [_Axis(li) for li in lines]
        self.dim = len(lines)
        self.bulk = 1.0 / (3.0 * (1.0 - 2.0 * poisson))
        every = range(self.dim)
        products = [axis.products for axis in self.axes]
        gradient = {(a, b): _kron_axes(products, a, b) for a in every for b in every}
        laplace = sum(gradient[a, a] for a in every)
        modulus = 0.5 / (1.0 + poisson)
        # 2 G times the deviatoric strain; in plane strain, too, the deviator is three-dimensional
        deviator = [
            [modulus * ((a == b) * laplace + gradient[b, a] - 2.0 / 3.0 * gradient[a, b]) for b in every] for a in every
        ]
        # 1 and the linear functions are orthogonal on a box, so the projection needs no linear solve
        volume = _outer_product([np.diff(li) for li in lines])
        self.norms = [volume, *[volume / 12.0 for _ in every]]
        moments = [axis.moments for axis in self.axes]
        self.moments = [
            block_array([[_kron_axes(moments, b, term) for b in every]]).tocsr() for term in (CONSTANT, *every)
        ]
        self.stiffness = block_array(deviator).tocsr()
        for moment, norm in zip(self.moments, self.norms, strict=True):
            self.stiffness = self.stiffness + moment.T @ diags_array(self.bulk / norm) @ moment

    def mean_over_columns(self, edges: Sequence[Array], direction: int) -> Any:
        """(columns, dofs): weights of the unknowns that give the mean displacement of each column's face."""
        from scipy.sparse import block_array, csr_array, kron

        face = csr_array(([1.0], ([0], [0])), shape=(1, self.axes[-1].nodes))
        means = [axis.mean_between(e) for axis, e in zip(self.axes, edges, strict=False)]
        weights = reduce(kron, [*means, face])
        nothing = csr_array(weights.shape)
        return block_array([[weights if a == direction else nothing for a in range(self.dim)]]).tocsr()

    def solve(self, forces: Any) -> Array:
        """(dofs, loads): displacements by nodal forces (loads, dofs); the top is fixed."""
        from scipy.sparse.linalg import splu

        counts = [axis.nodes for axis in self.axes]
        lattice = np.arange(np.prod(counts)).reshape(counts)
        order = _dissect(lattice, tuple((0, count) for count in (*counts[:-1], counts[-1] - 1)))
        order = (order[:, None] + lattice.size * np.arange(self.dim)).ravel()
        factor = splu(
            self.stiffness[order][:, order].tocsc(),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        moved = np.zeros((self.stiffness.shape[0], forces.shape[0]))
        moved[order] = factor.solve(forces[:, order].T.toarray())
        return moved

    def stress_trace(self, moved: Array) -> list[Array]:
        """1 + dim arrays (elements, loads): trace of the stress, as coefficients of 1 and of the linear functions."""
        terms = zip(self.moments, self.norms, strict=True)
        return [3.0 * self.bulk * (moment @ moved) / norm[:, None] for moment, norm in terms]


class _Axis:
    """Integrals along one axis of quadratic elements between `lines`, by scikit-fem; nodes are numbered along it."""

    def __init__(self, lines: Array) -> None:
        import skfem

        self.lines = lines
        self.nodes = 2 * len(lines) - 1
        basis = skfem.Basis(skfem.MeshLine(lines), skfem.ElementLineP2(), intorder=4)
        pieces = basis.with_element(skfem.ElementLineP0())
        middle, size = 0.5 * (lines[1:] + lines[:-1])[:, None], np.diff(lines)[:, None]
        order = np.argsort(basis.doflocs[0])

        def integrate(integrand: Callable[[Any, Any, Any], Any], tests: Any) -> Any:
            return skfem.BilinearForm(integrand).assemble(basis, tests)[:, order]

        def place(w: Any) -> Any:
            return (w.x[0] - middle) / size

        # by whether the test function and the trial function are differentiated
        self.products = {
            (False, False): integrate(lambda u, v, w: u * v, basis)[order],
            (False, True): integrate(lambda u, v, w: u.grad[0] * v, basis)[order],
            (True, False): integrate(lambda u, v, w: u * v.grad[0], basis)[order],
            (True, True): integrate(lambda u, v, w: u.grad[0] * v.grad[0], basis)[order],
        }
        # by whether the function is differentiated, and by the weight: 1 or the place in the element from -1/2 to 1/2
        self.moments = {
            (False, False): integrate(lambda u, q, w: u * q, pieces),
            (False, True): integrate(lambda u, q, w: u * q * place(w), pieces),
            (True, False): integrate(lambda u, q, w: u.grad[0] * q, pieces),
            (True, True): integrate(lambda u, q, w: u.grad[0] * q * place(w), pieces),
        }

    def mean_between(self, edges: Array) -> Any:
        """(columns, nodes): mean over each column, whose edges are among the lines."""
        inside = _overlaps(self.lines, edges)[0] > 0.0
        return (inside / np.diff(edges)[:, None]) @ self.moments[False, False]


def _kron_axes(tables: Sequence[dict[tuple[bool, bool], Any]], first: int, second: int) -> Any:
    """Kronecker product of one matrix of each axis, chosen by whether the axis is the first and the second given."""
    from scipy.sparse import kron

    product, *others = [table[axis == first, axis == second] for axis, table in enumerate(tables)]
    for other in others:
        product = kron(product, other, format="csr")
    return product


def _outer_product(vectors: Sequence[Array]) -> Array:
    """All products of one entry of each vector, the last vector fastest."""
    product = vectors[0]
    for vector in vectors[1:]:
        product = np.multiply.outer(product, vector).ravel()
    return product


def _dissect(lattice: Indices, spans: tuple[tuple[int, int], ...]) -> Indices:
    """Order of elimination of a lattice of nodes by nested dissection (George, SIAM J. Numer. Anal. 10, 1973, 345).

    A plane of nodes between elements, which have even indices, cuts the longest span and follows both halves.
    """
    axis = int(np.argmax([stop - start for start, stop in spans]))
    start, stop = spans[axis]
    cut = (start + stop) // 4 * 2
    if not start < cut < stop - 1 or np.prod([b - a for a, b in spans]) <= SMALLEST_PART_NODES:
        return lattice[tuple(slice(*span) for span in spans)].ravel()

    def order_between(low: int, high: int) -> Indices:
        return _dissect(lattice, (*spans[:axis], (low, high), *spans[axis + 1 :]))

    plane = lattice[tuple(slice(*span) for span in (*spans[:axis], (cut, cut + 1), *spans[axis + 1 :]))]
    return np.concatenate([order_between(start, cut), order_between(cut + 1, stop), plane.ravel()])


def _integrate_cells(trace: list[Array], lines: Sequence[Array], edges: Sequence[Array]) -> Array:
    """(loads, columns, levels): integral over thermal cells of a function that is linear on each element."""
    from scipy.sparse import csr_array, kron

    pairs = [_overlaps(li, e) for li, e in zip(lines, edges, strict=True)]
    factors = [[csr_array(pair[axis + 1 == term]) for axis, pair in enumerate(pairs)] for term in range(len(trace))]
    total = sum(reduce(kron, f).tocsr() @ coefficient for f, coefficient in zip(factors, trace, strict=True))
    return np.ascontiguousarray(total.T).reshape(total.shape[1], -1, len(edges[-1]) - 1)


def _overlaps(lines: Array, edges: Array) -> tuple[Array, Array]:
    """(cells, elements) each: overlap length of a cell and an element, and the integral of the local coordinate."""
    low = np.maximum(edges[:-1, None], lines[None, :-1])
    high = np.maximum(np.minimum(edges[1:, None], lines[None, 1:]), low)
    middle = 0.5 * (lines[1:] + lines[:-1])
    return high - low, (high - low) * (0.5 * (high + low) - middle) / np.diff(lines)
