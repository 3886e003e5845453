"""Contact pressure of the elastic block against an independent finite-element program, which closed forms check first.

`reference.elasticity` shares no line, no element and no contact algorithm with the package.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from reference.elasticity import ElasticBlock, column_values, crowd_at_ends, gauss_points

from flashtemp.physics.elastic_block import face_compliance, foundation_stiffness
from flashtemp.solver.elastic_contact import ElasticFoundation, HolderSupport

E, L, H, MEAN = 5e6, 0.025, 7e-3, 0.15e6
COLUMNS = np.linspace(0.0, L, 41)


@cache
def block(height=H, **options) -> ElasticBlock:
    return ElasticBlock.with_graded_mesh(L, height, **options)


@cache
def half_plane(half_contact: float, poisson: float) -> ElasticBlock:
    """Unit square whose face is finely meshed to three half contacts on both sides of its middle."""
    near = 3.0 * half_contact
    parts = ((0.5 - near, 10), (0.5 - half_contact, 24), (0.5 + half_contact, 10))
    lengths = (near - half_contact, 2.0 * half_contact, near - half_contact)
    inner = np.concatenate([a + crowd_at_ends(b, n) for (a, n), b in zip(parts, lengths, strict=True)])
    outer = np.geomspace(near, 0.5, 12)
    z = np.concatenate([[0.0], np.geomspace(0.02 * half_contact, 1.0, 22)])
    return ElasticBlock(np.unique(np.r_[0.5 - outer, inner, 0.5 + outer].round(12)), z, 1.0, poisson)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.499])
def test_reference_compresses_and_swells_a_free_block_in_plane_strain(poisson):
    """u = p H (1 - nu^2)/E and (1 + nu) alpha T H."""
    free = block(ratio=4.0, largest=0.1, poisson=poisson, top="gliding")
    pressed = free.displace_face(lambda x: MEAN + 0.0 * x)[:, 1]
    swollen = free.displace_face(lambda x: 0.0 * x, expansion=lambda x, z: 0.01 + 0.0 * x)[:, 1]
    np.testing.assert_allclose(pressed, MEAN * H * (1 - poisson**2) / E, rtol=1e-7)
    np.testing.assert_allclose(swollen, -(1 + poisson) * 0.01 * H, rtol=1e-7)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.499])
def test_reference_compresses_and_swells_a_confined_block(poisson):
    """u = p H (1 + nu)(1 - 2 nu)/((1 - nu) E) and (1 + nu)/(1 - nu) times alpha T summed up the block."""
    confined = block(ratio=1.6, largest=0.015, poisson=poisson, sides="confined")
    pressed = confined.displace_face(lambda x: MEAN + 0.0 * x)[:, 1]
    swollen = confined.displace_face(lambda x: 0.0 * x, expansion=lambda x, z: 0.01 * np.exp(-z / 1e-3))[:, 1]
    np.testing.assert_allclose(pressed, MEAN * H * (1 + poisson) * (1 - 2 * poisson) / (1 - poisson) / E, rtol=1e-5)
    np.testing.assert_allclose(swollen, -(1 + poisson) / (1 - poisson) * 1e-5 * (1 - np.exp(-7)), rtol=2e-3)


def test_reference_carries_load_like_a_thin_nearly_incompressible_layer():
    """Lubrication-type theory of a bonded layer, plus the plane-strain modulus 4 G; the rest is of order H/L.

    p'' = (3 G/H^3)(p H/K - d), p = 4 G d/H at the edges.
    """
    thin, poisson = L / 40, 0.499
    G, K = E / 2 / (1 + poisson), E / 3 / (1 - 2 * poisson)
    contact = block(thin, poisson=poisson).solve_contact(MEAN * L)
    x, strain, rate = 0.5 * (COLUMNS[1:] + COLUMNS[:-1]) - L / 2, contact.approach / thin, np.sqrt(3 * G / K) / thin
    p = K * strain + (4 * G - K) * strain * np.cosh(rate * x) / np.cosh(rate * L / 2)
    np.testing.assert_allclose(contact.column_means(COLUMNS)[4:-4], p[4:-4], atol=0.03 * MEAN)


@pytest.mark.parametrize(("poisson", "mu"), [(0.3, 0.0), (0.3, 0.9), (0.0, 0.9), (0.49, 0.9)])
def test_reference_presses_like_a_sliding_flat_punch(poisson, mu):
    """Johnson, Contact Mechanics (1985), section 2.8: p = P cos(pi g)/pi / sqrt(a^2 - x^2) ((a - x)/(a + x))^g, tan(pi g) = mu (1 - 2 nu)/(2 - 2 nu).

    The face sinks ahead of a traction along +x (Cerruti), so that the leading edge is pressed harder.
    """
    a, load = 2e-3, 1e-5
    contact = half_plane(a, poisson).solve_contact(
        load, mu, worn_depth=lambda x: np.where(abs(x - 0.5) < a * (1 + 1e-9), 0.0, 1.0)
    )
    edges = np.linspace(-1.0, 1.0, 21)
    g = np.arctan(mu * (1 - 2 * poisson) / (2 - 2 * poisson)) / np.pi
    angle = np.linspace(0.0, np.pi, 200001)
    s = -np.cos(angle)
    density = np.cos(np.pi * g) / np.pi * ((1 - s + 1e-12) / (1 + s + 1e-12)) ** g
    carried = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(angle))])
    exact = np.diff(np.interp(edges, s, carried)) / 0.1 * load / a
    means = contact.column_means(0.5 + a * edges)
    np.testing.assert_allclose(means[2:-2], exact[2:-2], atol=0.02 * load / (2 * a))


def test_reference_touches_like_a_hertzian_cylinder():
    """a^2 = 4 P R/(pi E*), p_max = 2 P/(pi a), E* = E/(1 - nu^2)."""
    a, radius = 2e-3, 1.0
    load = np.pi * a**2 / (1 - 0.49**2) / 4 / radius
    contact = half_plane(a, 0.49).solve_contact(load, worn_depth=lambda x: (x - 0.5) ** 2 / 2 / radius)
    edges = np.linspace(-1.2, 1.2, 25)
    inside = np.clip(edges, -1, 1)
    share = (inside * np.sqrt(1 - inside**2) + np.arcsin(inside)) / np.pi
    np.testing.assert_allclose(
        contact.column_means(0.5 + a * edges), load * np.diff(share) / 0.1 / a, atol=0.01 * 2 * load / (np.pi * a)
    )


def test_reference_shares_the_friction_moment_of_a_tall_block_between_its_ends():
    """A beam held at one end and guided at the other, M = F H/2 less a length at the ends: the rise with H is F/2."""
    low, high = (
        block(height, ratio=2.0, largest=0.04).solve_contact(MEAN * L, 0.01).moment() for height in (3 * L, 4 * L)
    )
    assert high - low == pytest.approx(0.01 * MEAN * L * L / 2, rel=0.005)
    assert high == pytest.approx(0.01 * MEAN * L * 2 * L, rel=0.02)


def test_reference_holder_that_turns_freely_leaves_the_whole_moment_to_the_pressure():
    contact = block(ratio=2.0, largest=0.04).solve_contact(MEAN * L, 0.2, arm=H, turning_stiffness=0.0)
    assert contact.moment() == pytest.approx(0.2 * MEAN * L * H, rel=1e-6)
    assert contact.tilt > 0.0


@pytest.mark.parametrize(
    "acting",
    [
        {},
        {"friction": 0.9},
        {"worn_depth": lambda x: 5e-5 * (2.0 * x / L - 1.0) ** 2},
        {"expansion": lambda x, z: 1.6e-4 * (20 + 40 * x / L) * np.exp(-z / 1e-3)},
    ],
    ids=["flat", "sheared", "crowned", "heated"],
)
def test_reference_has_converged(acting):
    """Twice the elements change no column by 3 % of the mean: what the finer mesh errs is less than half of that."""
    coarse, fine = (
        block(**mesh).solve_contact(MEAN * L, **acting).column_means(COLUMNS) / MEAN
        for mesh in ({"ratio": 2.0, "largest": 0.036}, {})
    )
    np.testing.assert_allclose(coarse, fine, atol=0.03)


GRADED = np.cumsum(np.r_[0.0, np.geomspace(1.2, 64.0, 28), np.geomspace(64.0, 2.4, 28)])  # like a run's columns
GRADED *= L / GRADED[-1]
WIDTH, CENTRE = np.diff(GRADED), 0.5 * (GRADED[1:] + GRADED[:-1])
LEVELS = np.r_[0.0, np.geomspace(3e-6, H, 40)]
LEAN = 1.0 - 2.0 * CENTRE / L
TURNING = dict(arm=7e-3, turning_stiffness=1.0 / (0.01 * 0.05))


def worn_edge(x):
    return 3e-4 * np.exp(-x / 3e-3)


def crown(x):
    return 5e-5 * (2.0 * x / L - 1.0) ** 2


def heat(x, z):
    """alpha T: 20 to 60 K along the face, fading within a millimetre."""
    return 1.6e-4 * (20.0 + 40.0 * x / L) * np.exp(-z / 1e-3)


def face_motion(levels, pressure=None, traction=None, strain=None, poisson=0.49):
    """Motion of the columns towards the holder that the package's compliance gives, m; heat moves them back."""
    compliance = face_compliance(GRADED, levels, poisson)
    motion = np.zeros(len(WIDTH))
    if pressure is not None:
        motion += compliance.normal @ pressure / E
    if traction is not None:
        motion += compliance.shear @ traction / E
    if strain is not None:
        fading = -1e-3 * np.diff(np.exp(-levels / 1e-3)) / np.diff(levels)  # mean of exp(-z/1 mm) over every level
        motion -= np.einsum("ijk,j,k->i", compliance.thermal, strain(CENTRE, 0.0), fading)
    return motion


def reference_motion(reference, **acting):
    """Mean motion of every column of the face, m."""
    x, weight = gauss_points(GRADED, 12)
    motion = reference.interpolation(x) @ reference.displace_face(**acting)[:, 1]
    return (weight * motion).reshape(len(WIDTH), -1).sum(axis=1) / WIDTH


@pytest.mark.parametrize(("height", "poisson"), [(H, 0.3), (H, 0.49), (H, 0.499), (0.8 * L, 0.49)])
def test_compliance_agrees_with_the_reference(height, poisson):
    """Motion by waves of pressure, of traction and by heat, each to 1 % of its largest value."""
    parts = np.ceil(WIDTH / (0.02 * L)).astype(int)  # elements of every column
    halves = np.concatenate(
        [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(GRADED[:-1], GRADED[1:], parts, strict=True)]
    )
    reference = ElasticBlock(np.append(halves, L), crowd_at_ends(height, 20), E, poisson)
    levels = LEVELS * height / H
    for waves in (0.0, 1.0, 2.0, 5.0):
        wave = column_values(GRADED, MEAN * np.cos(np.pi * waves * CENTRE / L))
        for kind in ("pressure", "traction"):
            expected = reference_motion(reference, **{"pressure": lambda x: 0.0 * x, kind: wave})
            ours = face_motion(levels, **{kind: wave(CENTRE)}, poisson=poisson)
            np.testing.assert_allclose(ours, expected, atol=0.01 * abs(expected).max(), err_msg=f"{kind} {waves}")
    expected = reference_motion(reference, pressure=lambda x: 0.0 * x, expansion=heat)
    ours = face_motion(levels, strain=heat, poisson=poisson)
    np.testing.assert_allclose(ours, expected, atol=0.01 * abs(expected).max(), err_msg="heat")


def settle_columns(height, friction=0.0, worn_depth=None, expansion=None, arm=0.0, turning_stiffness=np.inf):
    """Pressure of the columns (Pa), approach (m) and tilt (rad) by the package."""
    levels = LEVELS * height / H
    stiffness = foundation_stiffness(L, height, E)
    bed = ElasticFoundation(CENTRE, WIDTH, L, E, stiffness, face_compliance(GRADED, levels, 0.49))
    gap = (0.0 * CENTRE if worn_depth is None else worn_depth(CENTRE)) + face_motion(levels, strain=expansion)
    guided = np.isinf(turning_stiffness)
    holder = HolderSupport(1.0) if guided else HolderSupport(1.0, arm, 2.0 * turning_stiffness / L)
    settled = bed.solve_equilibrium(gap, MEAN, holder, lambda p: friction + 0.0 * p, None)
    return settled.pressure, settled.approach / stiffness, 2.0 * bed.to_pressure_solution(settled).tilt / L


ACTING = {
    "flat": {},
    "sheared": {"friction": 0.9},
    "worn": {"worn_depth": worn_edge},
    "worn and sheared": {"worn_depth": worn_edge, "friction": 0.9},
    "crowned": {"worn_depth": crown},
    "heated": {"expansion": heat},
    "turning": {"friction": 0.3, **TURNING},
    "all": {"friction": 0.9, "worn_depth": worn_edge, "expansion": heat, **TURNING},
}


def press_refined(height, **acting):
    """The reference, once more with finer elements where contact ends."""
    contact = block(height).solve_contact(MEAN * L, **acting)
    if contact.nodal_pressure.min() > 0.0:
        return contact
    return block(height).refine_at_ends(contact).solve_contact(MEAN * L, **acting)


@pytest.mark.parametrize("case", ACTING)
def test_pressure_agrees_with_the_reference(case):
    compare_pressure(H, **ACTING[case])


@pytest.mark.parametrize("case", ["sheared", "worn", "all"])
def test_pressure_of_a_tall_block_agrees_with_the_reference(case):
    compare_pressure(0.8 * L, **ACTING[case])


def compare_pressure(height, **acting):
    """To 2 % of the mean, or 1 % of the local pressure, on every column farther than 1 % of the length from the edges.

    A column in which contact ends is pressed or free as a whole, and errs with its neighbours: their load is compared.
    """
    contact = press_refined(height, **acting)
    pressure, approach, tilt = settle_columns(height, **acting)
    expected = contact.column_means(GRADED)
    assert approach == pytest.approx(contact.approach, abs=0.02 * MEAN * height / E)
    assert tilt * L == pytest.approx(contact.tilt * L, abs=0.02 * MEAN * height / E)
    touching = (expected > 0.0).astype(int)
    ends = [k + d for k in np.flatnonzero(np.diff(touching)) for d in (0, 1)]
    cut = np.setdiff1d(np.arange(len(GRADED)), [k for e in ends for k in (e, e + 1)])
    joint = GRADED[cut]
    ours, reference = (np.add.reduceat(WIDTH * p, cut[:-1]) / np.diff(joint) / MEAN for p in (pressure, expected))
    inner = (joint[:-1] > 0.01 * L) & (joint[1:] < 0.99 * L)
    np.testing.assert_allclose(ours[inner], reference[inner], atol=0.02, rtol=0.01)


# --- friction that follows the pressure, under a soft holder ------------------------------------------------
SOFT = HolderSupport(1.0, 0.55 * L, 0.05)  # the moment of friction all but tips it


def bed_and_softening(seen=None):
    """The bed, and a friction that falls with pressure; it adds to `seen` the least pressure it was asked at."""
    bed = ElasticFoundation(CENTRE, WIDTH, L, E, foundation_stiffness(L, H, E), face_compliance(GRADED, LEVELS, 0.49))

    def friction(p):
        if seen is not None:
            seen.append(float(np.real(p).min()))
        return 0.95 / (1.0 + p / (20.0 * MEAN))

    return bed, friction


def test_friction_is_asked_at_pressures_that_a_road_can_give():
    seen: list[float] = []
    bed, friction = bed_and_softening(seen)
    bed.solve_equilibrium(worn_edge(CENTRE), MEAN, SOFT, friction, None)
    assert min(seen) >= 0.0


def test_bracketed_tilt_is_that_of_newtons_method():
    bed, friction = bed_and_softening()
    newton = bed._settle_by_newton(worn_edge(CENTRE), MEAN, SOFT, friction, None, 1.0)
    bracketed = bed._settle_by_bracketing(worn_edge(CENTRE), MEAN, SOFT, friction, None, 1.0)
    np.testing.assert_allclose(bracketed.pressure, newton.pressure, atol=1e-8 * MEAN)
    assert bracketed.tilt == pytest.approx(newton.tilt, rel=1e-6)  # of moments that all but cancel
    np.testing.assert_allclose(bracketed.jacobian.holding, newton.jacobian.holding, rtol=0.1)
