"""Compliance of a bonded elastic block: closed forms, an independent finite element solution, reciprocity, the cache."""

from __future__ import annotations

import numpy as np
import pytest

from flashtemp.physics import elastic_block
from flashtemp.physics.elastic_block import face_compliance

LENGTH = 25e-3


@pytest.fixture(autouse=True)
def _own_cache_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    elastic_block._remember_compliance.cache_clear()
    yield
    elastic_block._remember_compliance.cache_clear()


def graded_columns(length: float = LENGTH, count: int = 40, first: float = 30e-6, last: float = 60e-6) -> np.ndarray:
    """Columns as in a run: narrow at both edges, the first narrower than the last."""
    place = np.linspace(-1.0, 1.0, count)
    width = np.exp(-6.0 * place**2) + np.where(place < 0.0, first, last) / (length / count)
    return np.append(0.0, np.cumsum(width)) * (length / width.sum())


def graded_levels(height: float, count: int = 20, first: float = 3e-6) -> np.ndarray:
    return np.append(0.0, np.geomspace(first, height, count))


def press_flat(compliance, areas, friction: float = 0.0, gap=0.0):
    """Pressure over its mean under a block whose face stays flat, bonded everywhere."""
    n = len(areas)
    matrix = np.block(
        [[compliance.normal + friction * compliance.shear, -np.ones((n, 1))], [areas[None], np.zeros((1, 1))]]
    )
    return np.linalg.solve(matrix, np.append(np.broadcast_to(gap, n), areas.sum()))[:n]


def spread_heat(compliance, strain):
    return np.einsum("ijk,jk->i", compliance.thermal, strain)


class TaylorHood:
    """Plane strain with Q2/Q1 elements and a continuous pressure, on even elements: shares nothing but the library."""

    def __init__(self, height, poisson, along, up):
        import skfem
        from scipy.sparse import block_array
        from scipy.sparse.linalg import splu
        from skfem.helpers import ddot, div, sym_grad

        self.mesh = skfem.MeshQuad.init_tensor(np.linspace(0.0, LENGTH, along + 1), np.linspace(0.0, height, up + 1))
        self.basis = skfem.Basis(self.mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
        self.pressure = self.basis.with_element(skfem.ElementQuad1())
        shear = 0.5 / (1.0 + poisson)
        self.lame = 2.0 * shear * poisson / (1.0 - 2.0 * poisson)
        self.bulk = self.lame + 2.0 / 3.0 * shear
        a = skfem.BilinearForm(lambda u, v, w: 2.0 * shear * ddot(sym_grad(u), sym_grad(v))).assemble(self.basis)
        b = skfem.BilinearForm(lambda u, q, w: div(u) * q).assemble(self.basis, self.pressure)
        c = skfem.BilinearForm(lambda p, q, w: p * q / self.lame).assemble(self.pressure)
        self.matrix = block_array([[a, -b.T], [-b, -c]]).tocsc()
        top = self.basis.get_dofs(lambda x: x[1] > height * (1 - 1e-9)).all()
        self.free = np.setdiff1d(np.arange(self.matrix.shape[0]), top)
        self.factor = splu(self.matrix[self.free][:, self.free])

    def load_face(self, direction, start, stop):
        """Unit traction in a direction between two places that are nodes."""
        import skfem

        face = self.mesh.facets_satisfying(
            lambda x: (x[1] < 1e-9) & (start < x[0]) & (x[0] < stop), boundaries_only=True
        )
        basis = skfem.FacetBasis(self.mesh, self.basis.elem, facets=face, intorder=4)
        return skfem.LinearForm(lambda v, w: v[direction]).assemble(basis)

    def load_heat(self, strain):
        """Free linear strain as a function of x and z: it shifts the dilatation that the pressure goes with."""
        import skfem

        shift = skfem.LinearForm(lambda q, w: 3.0 * self.bulk / self.lame * strain(*w.x) * q).assemble(self.pressure)
        return np.append(np.zeros(self.basis.N), -shift)

    def solve(self, load):
        solution = np.zeros(self.matrix.shape[0])
        forces = np.append(load, np.zeros(len(solution) - len(load)))
        solution[self.free] = self.factor.solve(forces[self.free])
        return solution[: self.basis.N]


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49, 0.4999])
def test_uniform_pressure_on_a_wide_layer_is_confined_compression(poisson, monkeypatch):
    """The sides are felt over some H sqrt(K/3G) (film flow to the side against compression), so layers differ in width."""
    monkeypatch.setattr(elastic_block, "PLANE", elastic_block._Grading(1, 2.0, 2.0, 1))
    felt = np.sqrt((2 * (1 + poisson)) / (9 * (1 - 2 * poisson)))
    height = LENGTH / (10 + 24 * felt)
    compliance = face_compliance(np.linspace(0.0, LENGTH, 41), graded_levels(height, 4), poisson)
    confined = height * (1 + poisson) * (1 - 2 * poisson) / (1 - poisson)
    assert compliance.normal.sum(axis=1)[20] == pytest.approx(confined, rel=1e-3)
    assert compliance.shear.sum(axis=1)[20] == pytest.approx(0.0, abs=1e-3 * height)


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_a_tall_block_is_a_bar_under_pressure_and_a_beam_under_traction(poisson):
    """Differences of heights leave out the ends: u grows by H (1-nu^2), the slope by V H^2/(2 E' I), E' = E/(1-nu^2)."""
    x = np.linspace(0.0, LENGTH, 13)
    middle = 0.5 * (x[1:] + x[:-1])
    heights = LENGTH * np.array([3.0, 4.0, 5.0])
    blocks = [face_compliance(x, graded_levels(h, 4), poisson) for h in heights]
    plane = 1.0 - poisson**2
    shortening = [c.normal.sum(axis=1).mean() for c in blocks]
    np.testing.assert_allclose(np.diff(shortening), plane * LENGTH, rtol=1e-3)
    slopes = [np.polyfit(middle, c.shear.sum(axis=1), 1)[0] for c in blocks]
    bending = (
        LENGTH * LENGTH**2 * plane / (LENGTH**3 / 12.0)
    )  # second difference of V H^2/(2 E' I) over steps of LENGTH
    assert np.diff(slopes, 2)[0] == pytest.approx(bending, rel=2e-3)


@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.499])
def test_short_waves_move_the_face_as_they_move_a_half_plane(poisson):
    """Johnson, Contact Mechanics, 1985, section 2.8: u = 2 (1-nu^2)/q p cos qx and (1-2 nu)(1+nu)/q t sin qx."""
    waves, per_wave = 8, 16
    x = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, waves * per_wave + 1)
    compliance = face_compliance(x, graded_levels(LENGTH, 4), poisson)
    wave_number = 2.0 * np.pi * waves / LENGTH
    middle = 0.5 * (x[1:] + x[:-1])
    inner = np.abs(middle) < LENGTH / waves  # two waves, far from the sides
    wave, shifted = np.cos(wave_number * middle), np.sin(wave_number * middle)
    mean = np.sinc(1.0 / per_wave)  # a wave averaged over a column, once as pressure and once as motion
    by_pressure = 2.0 * np.mean((compliance.normal @ wave * wave)[inner])
    by_traction = 2.0 * np.mean((compliance.shear @ wave * shifted)[inner])
    assert by_pressure * wave_number == pytest.approx(2.0 * (1 - poisson**2) * mean**2, rel=0.01)
    assert by_traction * wave_number == pytest.approx((1 - 2 * poisson) * (1 + poisson) * mean**2, abs=0.01)


@pytest.mark.parametrize("poisson", [0.3, 0.4999])
def test_it_agrees_with_taylor_hood_elements(poisson):
    """Pressure and traction on one column and random heat, against another mixed method on an even mesh."""
    height, columns = 7e-3, 20
    x, z = np.linspace(0.0, LENGTH, columns + 1), np.linspace(0.0, height, 8)
    compliance = face_compliance(x, z, poisson)
    other = TaylorHood(height, poisson, 4 * columns, 14)
    up = np.array([other.load_face(1, a, b) for a, b in zip(x[:-1], x[1:], strict=True)]) / np.diff(x)[:, None]
    strain = np.random.default_rng(5).normal(size=(columns, 7))

    def cells(xs, zs):
        return strain[np.searchsorted(x, xs) - 1, np.searchsorted(z, zs) - 1]

    for own, load in (
        (compliance.normal[:, 6], other.load_face(1, x[6], x[7])),
        (compliance.normal[:, 0], other.load_face(1, x[0], x[1])),
        (compliance.shear[:, 6], other.load_face(0, x[6], x[7])),
        (-spread_heat(compliance, strain), other.load_heat(cells)),
    ):
        np.testing.assert_allclose(own, up @ other.solve(load), atol=0.01 * np.abs(own).max())


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_heat_swells_a_free_block_and_a_wide_layer_by_closed_forms(poisson, monkeypatch):
    monkeypatch.setattr(elastic_block, "PLANE", elastic_block._Grading(1, 2.0, 2.0, 3))
    x = np.linspace(0.0, LENGTH, 13)
    tall = [face_compliance(x, graded_levels(h, 6), poisson) for h in (3.0 * LENGTH, 4.0 * LENGTH)]
    free = [spread_heat(c, np.ones((12, 6))).mean() for c in tall]
    assert np.diff(free)[0] == pytest.approx((1 + poisson) * LENGTH, rel=1e-3)
    height = LENGTH / (20 if poisson < 0.4 else 100)  # the sides are felt further where the rubber cannot yield
    layer = face_compliance(np.linspace(0.0, LENGTH, 41), graded_levels(height, 6), poisson)
    expected = (1 + poisson) / (1 - poisson) * height
    assert spread_heat(layer, np.ones((40, 6)))[20] == pytest.approx(expected, rel=2e-3)


def test_the_work_of_two_pressures_on_each_other_is_the_same_and_of_one_on_itself_positive():
    x = graded_columns()
    compliance = face_compliance(x, graded_levels(7e-3), 0.49)
    work = np.diff(x)[:, None] * compliance.normal
    np.testing.assert_allclose(work, work.T, atol=1e-14 * work.max())
    assert np.linalg.eigvalsh(work).min() > 0.0


def test_the_mirrored_block_moves_as_the_mirror_shows():
    x, z = graded_columns(), graded_levels(7e-3)
    one, other = face_compliance(x, z, 0.49), face_compliance((LENGTH - x)[::-1], z, 0.49)
    np.testing.assert_allclose(other.normal[::-1, ::-1], one.normal, atol=1e-9 * one.normal.max())
    np.testing.assert_allclose(other.shear[::-1, ::-1], -one.shear, atol=1e-9 * one.shear.max())
    np.testing.assert_allclose(other.thermal[::-1, ::-1], one.thermal, atol=1e-9 * np.abs(one.thermal).max())


def press_on_elements(x, poisson, *grading):
    compliance = elastic_block._compute_compliance(
        [x], np.array([0.0, 7e-3]), poisson, elastic_block._Grading(*grading)
    )
    return press_flat(compliance, np.diff(x), friction=0.5)


ABRUPT = np.array([0.0, 30e-6, *np.linspace(1e-3, 24e-3, 12), LENGTH - 60e-6, LENGTH])


@pytest.mark.parametrize("x", [graded_columns(count=24), ABRUPT], ids=["graded", "abrupt"])
@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_halved_elements_change_the_pressure_by_less_than_one_percent(x, poisson):
    """Of the mean pressure, or of the pressure itself where it is larger: it has no bound at the leading edge."""
    finer = press_on_elements(x, poisson, 4, 2.0, 1.15, 24)
    pressure = press_on_elements(x, poisson, *elastic_block.PLANE)
    assert np.all(np.abs(pressure - finer) < 0.01 * np.maximum(np.abs(finer), 1.0))


@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.4999])
def test_the_error_halves_at_least_with_the_elements(poisson):
    """First order: corners at the holder bound the rate, however near to incompressible the rubber is."""
    x = np.linspace(0.0, LENGTH, 11)
    pressures = [press_on_elements(x, poisson, k, 2.0, 4.0 ** (1.0 / k), 3 * k) for k in (1, 2, 4, 8)]
    errors = [np.abs(p - pressures[-1]).max() for p in pressures[:-1]]
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.5 * errors[1]


def test_friction_drags_the_pressure_towards_the_leading_edge():
    x = np.linspace(0.0, LENGTH, 21)
    pressure = press_flat(face_compliance(x, graded_levels(7e-3), 0.49), np.diff(x), friction=0.5)
    assert pressure[1] > 1.5 * pressure[-2]


@pytest.mark.parametrize(
    ("x", "z", "poisson", "word"),
    [
        ([0.0], [0.0, 1.0], 0.3, "x_edges"),
        ([0.0, 0.0], [0.0, 1.0], 0.3, "x_edges"),
        ([0.0, 1.0], [1.0, 0.0], 0.3, "z_edges"),
        ([0.0, 1.0], [0.0, float("nan")], 0.3, "z_edges"),
        ([0.0, float("inf")], [0.0, 1.0], 0.3, "x_edges"),
        ([0.0, 1.0], [0.0, 1.0], 0.5, "poisson"),
        ([0.0, 1.0], [0.0, 1.0], float("nan"), "poisson"),
    ],
)
def test_impossible_input_is_refused_by_its_name(x, z, poisson, word):
    with pytest.raises(ValueError, match=word):
        face_compliance(np.array(x), np.array(z), poisson)


@pytest.fixture
def coarse(monkeypatch):
    """Fewer elements in space, for what holds on any grid or asks for percents only."""
    monkeypatch.setattr(elastic_block, "SPACE", elastic_block._Grading(1, 9.0, 3.0, 2))


@pytest.mark.usefixtures("coarse")
def test_a_tall_block_in_space_is_a_bar_a_beam_and_swells_freely():
    """As in the plane, but with E for E/(1-nu^2) and alpha for (1+nu) alpha: the sides along y are free."""
    x, y = np.linspace(0.0, LENGTH, 5), np.linspace(0.0, LENGTH, 3)
    blocks = [face_compliance(x, np.linspace(0.0, h, 4), 0.49, y) for h in LENGTH * np.array([2.0, 3.0, 4.0])]
    np.testing.assert_allclose(np.diff([c.normal.sum(axis=1).mean() for c in blocks]), LENGTH, rtol=5e-3)
    np.testing.assert_allclose(np.diff([spread_heat(c, np.ones((8, 3))).mean() for c in blocks]), LENGTH, rtol=5e-3)
    middle = np.repeat(0.5 * (x[1:] + x[:-1]), 2)
    slopes = [np.polyfit(middle, c.shear.sum(axis=1), 1)[0] for c in blocks]
    assert np.diff(slopes, 2)[0] == pytest.approx(12.0, rel=0.02)  # V h^2/(E I) = 12 for a square step h = LENGTH


@pytest.mark.usefixtures("coarse")
def test_the_middle_of_a_broad_block_in_space_is_in_plane_strain():
    x, z, count = np.linspace(0.0, LENGTH, 7), np.linspace(0.0, 7e-3, 5), 7
    y = 7e-3 * np.array([-6.0, -4.0, -2.0, -0.5, 0.5, 2.0, 4.0, 6.0])
    plane, space = face_compliance(x, z, 0.45), face_compliance(x, z, 0.45, y)
    for name in ("normal", "shear"):  # by what is uniform along y
        own = getattr(space, name).reshape(6, count, 6, count).sum(axis=3)[:, count // 2]
        np.testing.assert_allclose(own, getattr(plane, name), atol=0.02 * np.abs(getattr(plane, name)).max())
    strain = np.outer(np.linspace(1.0, 2.0, 6), np.exp(-z[:-1] / 2e-3))
    swelling = spread_heat(plane, strain)
    own = spread_heat(space, np.repeat(strain, count, axis=0)).reshape(6, count)[:, count // 2]
    np.testing.assert_allclose(own, swelling, atol=0.02 * swelling.max())


@pytest.mark.usefixtures("coarse")
def test_loads_on_the_other_half_follow_from_symmetry():
    """A breadth that is symmetric but for one part in a million is solved column by column."""
    x, y, z = np.linspace(0.0, LENGTH, 4), np.array([0.0, 4e-3, 8e-3, 16e-3, 20e-3, 24e-3]), np.linspace(0.0, 7e-3, 3)
    y[3] = 24e-3 - y[2]
    one = face_compliance(x, z, 0.49, y)
    y[3] *= 1 + 1e-6
    other = face_compliance(x, z, 0.49, y)
    for name in ("normal", "shear", "thermal"):
        np.testing.assert_allclose(
            getattr(one, name), getattr(other, name), atol=1e-4 * np.abs(getattr(one, name)).max()
        )


def test_halved_elements_in_space_change_the_pressure_by_less_than_three_percent():
    x, y = graded_columns(count=8, first=1e-3, last=1e-3), np.array([0.0, 2e-3, 8e-3, 14e-3, 16e-3])
    areas = np.outer(np.diff(x), np.diff(y)).ravel()
    pressures = []
    for grading in (elastic_block.SPACE, elastic_block._Grading(2, 3.0, 1.5, 4)):
        compliance = elastic_block._compute_compliance([x, y], np.array([0.0, 7e-3]), 0.49, grading)
        pressures.append(press_flat(compliance, areas, friction=0.5).reshape(8, 4))
    inner = (slice(1, -1), slice(1, -1))
    np.testing.assert_allclose(pressures[0][inner], pressures[1][inner], atol=0.03)


@pytest.mark.usefixtures("coarse")
def test_in_space_work_is_reciprocal_and_both_sides_are_alike():
    x, y = np.linspace(0.0, LENGTH, 7), np.array([0.0, 2e-3, 8e-3, 14e-3, 16e-3])
    compliance = face_compliance(x, np.linspace(0.0, 7e-3, 4), 0.49, y)
    work = np.outer(np.diff(x), np.diff(y)).ravel()[:, None] * compliance.normal
    np.testing.assert_allclose(work, work.T, atol=1e-14 * work.max())
    assert np.linalg.eigvalsh(work).min() > 0.0
    normal, shear = (a.reshape(6, 4, 6, 4) for a in (compliance.normal, compliance.shear))
    np.testing.assert_allclose(normal[:, ::-1, :, ::-1], normal, atol=1e-9 * normal.max())
    np.testing.assert_allclose(shear[:, ::-1, :, ::-1], shear, atol=1e-9 * shear.max())
    np.testing.assert_allclose(shear[::-1, :, ::-1], -shear, atol=1e-9 * shear.max())


@pytest.mark.usefixtures("coarse")
def test_a_block_in_space_is_read_from_the_cache_and_a_damaged_file_is_replaced(tmp_path, monkeypatch):
    given = (np.linspace(0.0, LENGTH, 4), np.linspace(0.0, 7e-3, 3), 0.49, np.linspace(0.0, 2e-2, 3))
    solve, calls = elastic_block._Block.solve, []
    monkeypatch.setattr(elastic_block._Block, "solve", lambda *a: calls.append(1) or solve(*a))

    def compute():
        elastic_block._remember_compliance.cache_clear()
        return face_compliance(*given)

    first = compute()
    (file,) = (tmp_path / "flashtemp").iterdir()
    again = compute()
    assert len(calls) == 1
    np.testing.assert_array_equal(again.normal, first.normal)
    np.testing.assert_array_equal(again.thermal, first.thermal)
    whole = file.read_bytes()
    for damaged in (b"", whole[:-700], whole[:400] + b"\0\1\2\3" + whole[404:]):
        file.write_bytes(damaged)
        calls.clear()
        np.testing.assert_array_equal(compute().normal, first.normal)
        assert calls == [1]
        assert file.read_bytes() == whole


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("has_home", [True, False])
def test_a_cache_folder_that_cannot_be_written_costs_only_time(has_home, tmp_path, monkeypatch):
    if has_home:
        (tmp_path / "flashtemp").write_text("a file where the folder would be")
    else:
        monkeypatch.setenv("XDG_CACHE_HOME", "relative")
        monkeypatch.delenv("LOCALAPPDATA", raising=False)
        monkeypatch.setattr(elastic_block.os.path, "expanduser", lambda path: path)  # as where there is no home folder
        monkeypatch.chdir(tmp_path)
    x = np.linspace(0.0, LENGTH, 4)
    assert np.isfinite(face_compliance(x, np.linspace(0.0, 7e-3, 3), 0.49, np.linspace(0.0, 2e-2, 3)).normal).all()


@pytest.mark.usefixtures("coarse")
def test_heat_in_space_is_left_out_where_it_would_fill_the_memory(monkeypatch):
    monkeypatch.setattr(elastic_block, "MOST_THERMAL_BYTES", 6 * 6 * 2 * 8 - 1)
    x = np.linspace(0.0, LENGTH, 4)
    assert face_compliance(x, np.linspace(0.0, 7e-3, 3), 0.49, np.linspace(0.0, 2e-2, 3)).thermal is None
