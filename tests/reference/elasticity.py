"""Contact of an elastic rubber block with a flat rigid road by finite elements that share nothing with the package.

Plane strain, small displacements.  The block fills 0 < x < L, 0 < z < H: its face is z = 0, x runs from the leading
to the trailing edge, and z = H is bonded to the rigid holder.  The road slides towards +x.

- Triangles with quadratic displacements, a cubic bubble and linear pressures that jump between elements (Crouzeix and
  Raviart, 1973): stable and free of locking up to nu = 0.5.  Bubble and pressures are eliminated in every element.
- The inner nodes are eliminated, which leaves the stiffness matrix of the face (a Schur complement).
- Contact by penalty at the nodes of the face, p = max(0, penetration / epsilon), whose loads follow by Simpson's rule.
  Newton's method on displacements, approach and tilt together, friction included; epsilon falls by tens until it no
  longer matters.
- Heat strains the rubber by alpha T in all three directions, the one across the plane included.

In the frame of the holder the road moves up by d + theta (L/2 - x), and with the worn depth w the gap is
    g = w + u_z - d - theta (L/2 - x) >= 0,     p >= 0,     p g = 0,     traction along +x:  mu p,
    int p dx = P,     k theta = h int mu p dx - int p (L/2 - x) dx,    k = inf: theta = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.interpolate import PchipInterpolator
from scipy.sparse.linalg import splu

Profile = Callable[[np.ndarray], np.ndarray]


def crowd_at_ends(length: float, elements: int) -> np.ndarray:
    """Lines from 0 to `length`, m, whose spacing falls linearly towards both ends (Chebyshev points)."""
    return 0.5 * length * (1.0 - np.cos(np.linspace(0.0, np.pi, elements + 1)))


def grow_from_ends(length: float, first: float, ratio: float, largest: float) -> np.ndarray:
    """Lines from 0 to `length`, m, whose spacing grows by `ratio` from about `first` at both ends up to `largest`."""
    spacing = np.minimum(first * ratio ** np.arange(int(np.log(largest / first) / np.log(ratio)) + 2), largest)
    left = 0.5 * length - spacing.sum()
    spacing = np.append(spacing, np.full(max(0, int(np.ceil(left / largest))), largest))
    half = np.append(0.0, np.cumsum(spacing * 0.5 * length / spacing.sum()))
    return np.append(half, (length - half[:-1])[::-1])


def column_values(edges: np.ndarray, values: np.ndarray) -> Profile:
    """Function of x, m, that is constant in every column between the `edges`, m."""

    def step(x: np.ndarray) -> np.ndarray:
        return np.asarray(values)[np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(values) - 1)]

    return step


@dataclass(frozen=True)
class Contact:
    """Solution: approach d, m; tilt theta, rad, positive where the leading edge is pressed harder; pressure by x."""

    approach: float
    tilt: float
    nodes: np.ndarray = field(repr=False)  # (2n + 1,) of the face, m
    nodal_pressure: np.ndarray = field(repr=False)  # (2n + 1,) Pa
    nodal_load: np.ndarray = field(repr=False)  # (2n + 1,) N/m

    @cached_property
    def _carried(self) -> PchipInterpolator:
        """Load, N/m, on the face from 0 to x: monotone between the mesh lines, where Simpson's rule gives it."""
        share = simpson_weights(self.nodes[::2]) * self.nodal_pressure[element_nodes(len(self.nodes) // 2)]
        return PchipInterpolator(self.nodes[::2], np.concatenate([[0.0], share.sum(1).cumsum()]))

    def column_means(self, edges: np.ndarray) -> np.ndarray:
        """Mean pressure, Pa, of every column between the `edges` (n + 1,), m."""
        return np.diff(self._carried(edges)) / np.diff(edges)

    def moment(self) -> float:
        """Moment of the pressure about the middle of the face, N, positive where the leading edge carries more."""
        return float(self.nodal_load @ (0.5 * self.nodes[-1] - self.nodes))


def element_nodes(elements: int) -> np.ndarray:
    """Nodes (n, 3) of every element of the face."""
    return 2 * np.arange(elements)[:, None] + np.arange(3)


def simpson_weights(lines: np.ndarray) -> np.ndarray:
    """Weights (n, 3), m, of the nodes of every element of the face."""
    return np.diff(lines)[:, None] * np.array([1.0, 4.0, 1.0]) / 6.0


def gauss_points(lines: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre points and weights in every interval between the `lines`."""
    at, weight = np.polynomial.legendre.leggauss(points)
    half = 0.5 * np.diff(lines)[:, None]
    return (lines[:-1, None] + half * (1.0 + at)).ravel(), (half * weight).ravel()


def triangle_points() -> tuple[np.ndarray, np.ndarray]:
    """Points (q, 2) and weights (q,) exact to degree 6 on the triangle (0,0), (1,0), (0,1): Gauss, collapsed."""
    at, weight = gauss_points(np.array([0.0, 1.0]), 4)
    r, s = np.meshgrid(at, at, indexing="ij")
    return np.stack([r, s * (1.0 - r)], -1).reshape(-1, 2), (np.outer(weight, weight) * (1.0 - r)).ravel()


def triangle_gradients(points: np.ndarray) -> np.ndarray:
    """Gradients (q, 7, 2) of six quadratic functions (corners, then middles 01, 12, 20) and the bubble."""
    b = np.stack([1.0 - points.sum(1), *points.T])  # barycentric
    db = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    corners = [(4.0 * b[i] - 1.0)[:, None] * db[i] for i in range(3)]
    middles = [4.0 * (b[i][:, None] * db[j] + b[j][:, None] * db[i]) for i, j in ((0, 1), (1, 2), (2, 0))]
    bubble = 27.0 * sum((b[i] * b[j])[:, None] * db[k] for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)))
    return np.stack([*corners, *middles, bubble], axis=1)


@dataclass(frozen=True, eq=False)
class ElasticBlock:
    """Block with mesh lines `x_lines` and `z_lines`, m, from 0; Young's `modulus`, Pa, and ratio `poisson`.

    `top`: "bonded" or "gliding" (only z held, and x in the middle).  `sides`: "free" or "confined" (x held).
    """

    x_lines: np.ndarray
    z_lines: np.ndarray
    modulus: float = 5e6
    poisson: float = 0.49
    top: str = "bonded"
    sides: str = "free"

    @classmethod
    def with_graded_mesh(
        cls, length: float, height: float, ratio: float = 1.5, largest: float = 0.018, **options
    ) -> ElasticBlock:
        """Block of `length` and `height`, m, with elements that grow by `ratio` from all edges, the bond's included.

        `largest` and the smallest, 1e-4, in lengths of the block; up the block they are 6 `largest` and 2e-4 heights,
        and grow by the square of `ratio`.
        """
        x_lines = grow_from_ends(length, 1e-4 * length, ratio, largest * length)
        return cls(x_lines, grow_from_ends(height, 2e-4 * height, ratio**2, 6.0 * largest * height), **options)

    def refine_at_ends(self, contact: Contact) -> ElasticBlock:
        """The same block with elements a quarter as long about every place inside the face where `contact` ends."""
        ends = np.flatnonzero(np.diff((contact.nodal_pressure > 0.0).astype(int))) // 2
        near = np.unique([k + d for k in ends for d in (-1, 0, 1)])
        near = near[(near >= 0) & (near < len(self.x_lines) - 1)]
        parts = (np.linspace(*self.x_lines[k : k + 2], 5)[1:-1] for k in near)
        return replace(self, x_lines=np.sort(np.concatenate([self.x_lines, *parts])))

    @property
    def length(self) -> float:
        """Length of the face, m."""
        return float(self.x_lines[-1])

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodal lines (2n + 1,) along x and z: mesh lines and the middles between them."""
        halved = [np.interp(np.arange(2 * len(a) - 1) / 2, np.arange(len(a)), a) for a in (self.x_lines, self.z_lines)]
        return halved[0], halved[1]

    @cached_property
    def _triangles(self) -> np.ndarray:
        """Nodes (t, 6) of every triangle; rectangles are cut by diagonals that start in the corners of the face."""
        across = 2 * len(self.x_lines) - 1
        i, j = np.meshgrid(2 * np.arange(len(self.x_lines) - 1), 2 * np.arange(len(self.z_lines) - 1), indexing="ij")
        left = self.x_lines[i // 2 + 1] <= 0.5 * self.length * (1 + 1e-12)

        def node(di, dj):
            """Node in a rectangle, mirrored in the right half."""
            return (j + dj) * across + i + np.where(left, di, 2 - di)

        below = [node(*at) for at in ((0, 0), (2, 0), (2, 2), (1, 0), (2, 1), (1, 1))]
        above = [node(*at) for at in ((0, 0), (2, 2), (0, 2), (1, 1), (1, 2), (0, 1))]
        return np.concatenate([np.stack(c, -1).reshape(-1, 6) for c in (below, above)])

    @cached_property
    def _elements(self) -> dict[str, np.ndarray]:
        """Element matrices: stiffness of the six nodes, and the forces there of a heat stress at the points."""
        x, z = self._nodes
        corner = np.stack([np.tile(x, len(z)), np.repeat(z, len(x))], -1)[self._triangles[:, :3]]
        jacobian = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], -1)  # (t, 2, 2)
        points, weight = triangle_points()
        weight = weight * np.abs(np.linalg.det(jacobian))[:, None]  # (t, q)
        grad = np.einsum("qad,tdc->tqac", triangle_gradients(points), np.linalg.inv(jacobian))
        q = len(points)
        strain = np.zeros((len(grad), q, 3, 14))  # xx, zz and xz times the square root of 2
        strain[..., 0, 0::2], strain[..., 1, 1::2] = grad[..., 0], grad[..., 1]
        strain[..., 2, 0::2], strain[..., 2, 1::2] = grad[..., 1] / np.sqrt(2), grad[..., 0] / np.sqrt(2)
        shear = self.modulus / 2 / (1 + self.poisson)
        lame = 2 * shear * self.poisson / (1 - 2 * self.poisson)
        stiffness = 2 * shear * np.einsum("tq,tqsa,tqsb->tab", weight, strain, strain, optimize=True)
        linear = np.concatenate([np.ones((q, 1)), points], axis=1)
        dilation = np.einsum("tq,qp,tqa->tpa", weight, linear, strain[..., 0, :] + strain[..., 1, :], optimize=True)
        mass = np.einsum("tq,qp,qr->tpr", weight, linear, linear, optimize=True)
        projected = np.linalg.solve(mass, dilation)  # the part of div v that linear pressures see
        stiffness += lame * np.einsum("tpa,tpb->tab", dilation, projected)
        heat = np.einsum("tpa,qp,tq->taq", projected, linear, weight, optimize=True)
        held = np.linalg.solve(stiffness[:, 12:, 12:], stiffness[:, 12:, :12]).transpose(0, 2, 1)
        return {
            "stiffness": stiffness[:, :12, :12] - held @ stiffness[:, 12:, :12],
            "heat": heat[:, :12] - held @ heat[:, 12:],
            "x": corner[:, :1, 0] + np.einsum("qd,td->tq", points, jacobian[:, 0]),
            "z": corner[:, :1, 1] + np.einsum("qd,td->tq", points, jacobian[:, 1]),
        }

    @cached_property
    def _freedoms(self) -> np.ndarray:
        """Degrees of freedom (t, 12) of every triangle: x and z of each node."""
        return np.stack([2 * self._triangles, 2 * self._triangles + 1], -1).reshape(-1, 12)

    @cached_property
    def _condensed(self) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Stiffness of the face (2n, 2n), x and z of each node in turn, and the map of nodal forces onto the face.

        The Schur complement is the product of the last blocks of the factors L and U; forces in the block act on the
        face like those that hold it back from where they would move it.
        """
        x, z = self._nodes
        rows, columns = np.repeat(self._freedoms, 12, axis=1).ravel(), np.tile(self._freedoms, 12).ravel()
        size = 2 * len(x) * len(z)
        whole = sparse.coo_array((self._elements["stiffness"].ravel(), (rows, columns)), shape=(size, size)).tocsc()
        if self.sides == "confined":
            corners = np.array([0, 2 * len(x) - 2])
            whole += sparse.coo_array(([1e6 * whole.max()] * 2, (corners, corners)), shape=(size, size)).tocsc()
        number = np.arange(size).reshape(len(z), len(x), 2)
        face = number[0].ravel()
        free = np.ones(number.shape, dtype=bool)
        free[0] = False
        free[-1] = False
        if self.top == "gliding":
            free[-1, :, 0] = True
            free[-1, len(x) // 2, 0] = False
        if self.sides == "confined":
            free[:, [0, -1], 0] = False
        inner = number[free]
        symmetric = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        order = splu(whole[inner][:, inner], permc_spec="MMD_AT_PLUS_A", **symmetric).perm_c
        last = np.concatenate([inner[np.argsort(order)], face])  # the face is eliminated last
        factors = splu(whole[last][:, last], permc_spec="NATURAL", **symmetric)
        place = factors.perm_c[-len(face) :] - len(inner)
        if place.min() < 0 or not np.array_equal(factors.perm_c, factors.perm_r):
            raise ArithmeticError("the face was not eliminated last")
        block = slice(len(inner), None)
        stiffness = (factors.L[block, block] @ factors.U[block, block]).toarray()[np.ix_(place, place)]
        return stiffness, lambda force: stiffness @ factors.solve(force[last])[len(inner) :]

    def face_forces(self, expansion: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
        """Forces (2n,), N/m, by which a free thermal strain `expansion`(x, z) acts on the held face."""
        part = self._elements
        stress = self.modulus / (1 - 2 * self.poisson) * expansion(part["x"], part["z"])  # 3 K alpha T
        force = np.zeros(2 * len(self._nodes[0]) * len(self._nodes[1]))
        np.add.at(force, self._freedoms, np.einsum("taq,tq->ta", part["heat"], stress))
        return self._condensed[1](force)

    def interpolation(self, x: np.ndarray) -> np.ndarray:
        """Quadratic functions (len(x), n) of the nodes of the face at `x`, m."""
        e = np.clip(np.searchsorted(self.x_lines, x, side="right") - 1, 0, len(self.x_lines) - 2)
        s = (x - self.x_lines[e]) / np.diff(self.x_lines)[e]
        functions = np.zeros((len(x), 2 * len(self.x_lines) - 1))
        for k, value in enumerate(((1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1))):
            functions[np.arange(len(x)), 2 * e + k] = value
        return functions

    def displace_face(self, pressure: Profile, traction: Profile | None = None, expansion=None) -> np.ndarray:
        """Motion (n, 2), m, of the face's nodes along x and z by given tractions, Pa, and thermal strain."""
        x, weight = gauss_points(self.x_lines, 8)
        functions = self.interpolation(x) * weight[:, None]
        force = np.zeros(2 * functions.shape[1]) if expansion is None else self.face_forces(expansion)
        force[1::2] += pressure(x) @ functions
        if traction is not None:
            force[0::2] += traction(x) @ functions
        return np.linalg.solve(self._condensed[0], force).reshape(-1, 2)

    def solve_contact(
        self,
        load: float,
        friction: float | Profile = 0.0,
        worn_depth: Profile | None = None,
        expansion: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
        arm: float = 0.0,
        turning_stiffness: float = np.inf,
        epsilon: float = 1e-6,
    ) -> Contact:
        """Contact under `load` P, N/m.

        `friction` mu, number or function of x; `worn_depth` w(x), m; `expansion` alpha T(x, z); `arm` h, m, of the
        pivot and `turning_stiffness` k, N m/rad per m of width.  `epsilon` in lengths of the block per modulus.
        """
        stiffness, nodes = self._condensed[0], self._nodes[0]
        n = len(nodes)
        weight = np.zeros(n)
        np.add.at(weight, element_nodes(len(self.x_lines) - 1), simpson_weights(self.x_lines))
        mu = friction(nodes) if callable(friction) else np.full(n, float(friction))
        depth = np.zeros(n) if worn_depth is None else worn_depth(nodes)
        heat = np.zeros(2 * n) if expansion is None else self.face_forces(expansion)
        lever = 0.5 * self.length - nodes
        penetration = np.zeros((n, 2 * n + 2))  # penetration by displacements, approach and tilt
        penetration[:, 1 : 2 * n : 2], penetration[:, 2 * n], penetration[:, 2 * n + 1] = -np.eye(n), 1.0, lever
        response = np.zeros((2 * n + 2, n))  # what the pressures at the nodes do in the equations
        response[0 : 2 * n : 2], response[1 : 2 * n : 2] = np.diag(weight * mu), np.diag(weight)
        response[2 * n] = -weight
        guided = np.isinf(turning_stiffness)
        if not guided:
            response[2 * n + 1] = weight * (arm * mu - lever)
        linear = np.zeros((2 * n + 2, 2 * n + 2))
        linear[: 2 * n, : 2 * n] = stiffness
        linear[2 * n + 1, 2 * n + 1] = 1.0 if guided else turning_stiffness
        forces = np.concatenate([heat, [load, 0.0]])
        state = np.zeros(2 * n + 2)
        state[2 * n] = depth.min() + load / self.modulus
        for softness in np.geomspace(1e-1, epsilon, 6) * self.length / self.modulus:
            state = solve_penalty(linear, response, penetration, depth, forces, softness, state)
        pressure = np.maximum(0.0, penetration @ state - depth) / softness
        return Contact(float(state[2 * n]), float(state[2 * n + 1]), nodes, pressure, weight * pressure)


def solve_penalty(linear, response, penetration, depth, forces, softness, state):
    """Newton's method on linear y - response p = forces with p = max(0, penetration y - depth) / softness.

    Raises ArithmeticError where it does not converge.
    """

    def residual(y):
        over = penetration @ y - depth
        return linear @ y - response @ (np.maximum(0.0, over) / softness) - forces, over > 0

    rest, on = residual(state)
    for _ in range(100):
        tangent = linear - (response[:, on] / softness) @ penetration[on]
        step = np.linalg.solve(tangent, -rest)
        for shrink in 0.5 ** np.arange(8):
            after, now_on = residual(state + shrink * step)
            if np.array_equal(on, now_on) or np.linalg.norm(after) < (1 - 0.1 * shrink) * np.linalg.norm(rest):
                break
        settled = shrink == 1.0 and np.array_equal(on, now_on)
        state, rest, on = state + shrink * step, after, now_on
        if settled:
            return state
    raise ArithmeticError(f"contact by penalty did not converge at softness {softness:.1e} m/Pa")
