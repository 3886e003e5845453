"""Estimates, evidence and projections against dense algebra with every column written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from flashtemp.discovery.estimation.linear_gaussian import DataBlock, LinearSystem, whitened_residual
from flashtemp.discovery.parameters import ParameterId, ParameterKind

MU, PHI = ParameterId.of_key("friction.mu"), ParameterId.of_key("contact.spot_fraction")
LEVEL = [ParameterId(ParameterKind.LEVEL, condition=n) for n in (0, 1)]
MODE = ParameterId(ParameterKind.MODE, (1,))
FLUX = [ParameterId(ParameterKind.FLUX, (1,), condition=n) for n in (0, 1)]
SHIFT, MAP = ParameterId(ParameterKind.SHIFT_U, file="a"), ParameterId(ParameterKind.MAP, (1, 0), file="b")
MESH, NOBODY = ParameterId(ParameterKind.MESH, (0,)), ParameterId(ParameterKind.CELL)
PRIORS = {
    MU: (0.3, 0.5), PHI: (-0.2, 0.8), LEVEL[0]: (0.0, 0.2), LEVEL[1]: (0.1, 0.3), SHIFT: (0.4, 1.5),
    MODE: (0.0, 0.7), FLUX[0]: (0.0, 0.4), FLUX[1]: (-0.5, 0.6), MAP: (0.0, 2.0), MESH: (0.2, 0.9),
}  # fmt: skip
LN_TWO_PI = np.log(2 * np.pi)


def block(rng, label, condition, own, shared, aliases, size, held_out=False):
    """`own` columns of its own, `shared` ones with known products, and further names for some of them."""
    C, F = rng.normal(size=(size, len(own))), rng.normal(size=(size, len(shared)))
    C[:, 0] += 2.0 * F[:, 0]  # nothing is orthogonal
    names = [(n, i) for i, n in enumerate([*own, *shared])]
    names += [(alias, [*own, *shared].index(n)) for alias, n in aliases.items()]
    return DataBlock(label, condition, held_out, rng.normal(size=size), C, tuple(names), F, F.T @ F)


@pytest.fixture
def blocks():
    rng = np.random.default_rng(7)
    return [
        block(rng, "a", 0, [MU, PHI, SHIFT], [MODE, MESH], {LEVEL[0]: MU, FLUX[0]: MODE}, 9),
        block(rng, "b", 1, [PHI, MU], [MODE, MAP], {LEVEL[1]: MU, FLUX[1]: MODE}, 14),
        block(rng, "c", 1, [MU], [MODE, MESH], {LEVEL[1]: MU, FLUX[1]: MODE}, 6),
        block(rng, "d", 2, [MU, PHI], [MODE], {FLUX[1]: MODE}, 11, held_out=True),
    ]


def dense(blocks, names):
    """All data under each other (n,), and one column per name (n, k)."""
    rows = []
    for b in blocks:
        whole = np.hstack([b.C, b.F])
        A = np.zeros((b.count, len(names)))
        for name, column in b.names:
            if name in names:
                A[:, names.index(name)] += whole[:, column]
        rows.append(A)
    return np.concatenate([b.r for b in blocks]), np.vstack(rows)


def parts(priors):
    names = list(priors)
    return names, np.array([priors[n][0] for n in names]), np.array([priors[n][1] for n in names])


def density(blocks, priors):
    """ln probability (density) of all data."""
    names, mean, sd = parts(priors)
    r, A = dense(blocks, names)
    return float(multivariate_normal(A @ mean, np.eye(len(r)) + (A * sd**2) @ A.T).logpdf(r))


def posterior(blocks, priors):
    names, mean, sd = parts(priors)
    r, A = dense(blocks, names)
    covariance = np.linalg.inv(A.T @ A + np.diag(sd**-2.0))
    return covariance @ (A.T @ r + mean / sd**2), covariance


def fitted(blocks):
    return [b for b in blocks if not b.held_out]


@pytest.mark.parametrize("left", [(), (MODE, MESH), (LEVEL[0], LEVEL[1], FLUX[0], FLUX[1]), (MU,)])
def test_estimate_and_evidence(blocks, left):
    priors = {n: v for n, v in PRIORS.items() if n not in left}
    found = LinearSystem(blocks).solve(priors)
    d, covariance = posterior(fitted(blocks), priors)
    count = sum(b.count for b in fitted(blocks))
    order = [list(priors).index(n) for n in found.names]
    assert set(found.names) == set(priors)
    assert found.count == count
    np.testing.assert_allclose(found.d, d[order], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found.covariance, covariance[np.ix_(order, order)], rtol=1e-9, atol=1e-12)
    assert found.ln_evidence - 0.5 * count * LN_TWO_PI == pytest.approx(density(fitted(blocks), priors), rel=1e-11)


def test_chi2_is_that_of_data_and_priors_at_the_estimate(blocks):
    names, mean, sd = parts(PRIORS)
    found = LinearSystem(blocks).solve(PRIORS)
    r, A = dense(fitted(blocks), names)
    d = np.array([found[n] for n in names])
    assert found.chi2 == pytest.approx(np.sum((r - A @ d) ** 2) + np.sum(((d - mean) / sd) ** 2), rel=1e-11)


def test_single_precision_columns_are_multiplied_in_double(blocks):
    rough = [replace(b, C=b.C.astype(np.float32), F=b.F.astype(np.float32)) for b in blocks]
    rough = [replace(b, FF=b.F.astype(float).T @ b.F.astype(float)) for b in rough]
    exact = [replace(b, C=b.C.astype(float), F=b.F.astype(float)) for b in rough]
    found, expected = LinearSystem(rough).solve(PRIORS), LinearSystem(exact).solve(PRIORS)
    np.testing.assert_allclose(found.d, expected.d, rtol=1e-6, atol=1e-7)


def test_names_of_one_column_share_its_value(blocks):
    """Two names with priors sd and sd' are one with hypot(sd, sd'), and what each gets follows its variance."""
    [a] = (b for b in blocks if b.label == "a")
    system = LinearSystem([a])
    both = system.solve({MU: (0.3, 0.5), LEVEL[0]: (-0.1, 0.2)})
    one = system.solve({MU: (0.2, np.hypot(0.5, 0.2))})
    assert both.ln_evidence == pytest.approx(one.ln_evidence, rel=1e-12)
    assert both[MU] + both[LEVEL[0]] == pytest.approx(one[MU], rel=1e-10)
    assert (both[MU] - 0.3) / (both[LEVEL[0]] + 0.1) == pytest.approx((0.5 / 0.2) ** 2, rel=1e-9)


def test_shared_columns_give_what_own_ones_give(blocks):
    plain = []
    for b in blocks:
        whole = np.hstack([b.C, b.F])
        plain.append(replace(b, C=whole, F=np.zeros((b.count, 0)), FF=np.zeros((0, 0))))
    own, shared = (LinearSystem(made).solve(PRIORS) for made in (plain, blocks))
    np.testing.assert_allclose(shared.d, own.d, rtol=1e-11, atol=1e-13)
    assert shared.ln_evidence == pytest.approx(own.ln_evidence, rel=1e-12)


def test_a_tight_prior_holds_and_a_wide_one_lets_go(blocks):
    system = LinearSystem(blocks)
    held = system.solve(PRIORS | {PHI: (0.7, 1e-6)})
    assert held[PHI] == pytest.approx(0.7, abs=1e-8)
    assert held.sd(PHI) == pytest.approx(1e-6, rel=1e-3)
    free = [system.solve(PRIORS | {PHI: (mean, 1e4)})[PHI] for mean in (-5.0, 5.0)]
    assert free[0] == pytest.approx(free[1], abs=1e-5)


def test_names_that_no_block_knows_take_no_part(blocks):
    system = LinearSystem(blocks)
    known, more = system.solve(PRIORS), system.solve(PRIORS | {NOBODY: (1.0, 2.0)})
    assert more.names == known.names
    assert more.ln_evidence == known.ln_evidence


def test_what_is_held_out_is_not_seen(blocks):
    loud = [replace(b, r=b.r + 100.0 * b.held_out) for b in blocks]
    seen, again = LinearSystem(blocks).solve(PRIORS), LinearSystem(loud).solve(PRIORS)
    np.testing.assert_array_equal(seen.d, again.d)
    assert seen.ln_evidence == again.ln_evidence


def test_what_only_data_know_that_are_held_out_is_estimated_from_them_alone(blocks):
    """As where their image lies: what is fitted, or shared by all, stays as it was without them."""
    own, view = ParameterId(ParameterKind.SHIFT_U, file="d"), ParameterId(ParameterKind.SCALE, name="profile")
    names = (*blocks[3].names, (own, 0), (view, 1))
    blocks[3] = replace(blocks[3], names=names, r=blocks[3].r + 5.0 * blocks[3].C[:, 0])
    system, priors = LinearSystem(blocks), PRIORS | {own: (0.3, 1.2), view: (0.0, 0.5)}
    plain = system.solve(priors)
    assert plain[own] == pytest.approx(0.3)
    found = system.fit_heldout_nuisances(plain, priors)
    still = {n: (plain[n], 1e-9) for n in plain.names if n != own}
    d, covariance = posterior(blocks[3:], still | {own: priors[own]})
    assert found[own] == pytest.approx(d[-1], rel=1e-9)
    for n in still:
        assert (found[n], found.sd(n)) == (plain[n], plain.sd(n))
    shared = list(still)  # errors of what is shared are in its own, and go together with it
    _, A = dense(blocks[3:], [*shared, own])
    at = [plain.names.index(n) for n in shared]
    own_only = 1.0 / (A[:, -1] @ A[:, -1] + priors[own][1] ** -2)
    follow = -own_only * (A[:, -1] @ A[:, :-1])
    together = follow @ plain.covariance[np.ix_(at, at)]
    assert found.sd(own) == pytest.approx(np.sqrt(own_only + together @ follow), rel=1e-9)
    last = found.names.index(own)
    np.testing.assert_allclose(found.covariance[last, at], together, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.covariance, found.covariance.T)
    assert (found.ln_evidence, found.chi2, found.count) == (plain.ln_evidence, plain.chi2, plain.count)
    assert LinearSystem(blocks[:3]).fit_heldout_nuisances(plain, priors) is plain


@pytest.mark.parametrize("variances", [{}, {"a": 2.0, "b": 1.0, "c": 3.0, "d": 1.5}])
@pytest.mark.parametrize("label", ["a", "b", "c", "d"])
def test_density_of_what_was_left_out_is_a_difference_of_evidences(blocks, label, variances):
    """Also where noise is larger than stated: else a model would predict better by calling its misfit noise."""
    system = LinearSystem(blocks)
    every = system.solve(PRIORS, system.normal_equations(lambda b: True, variances))
    rest = system.solve(PRIORS, system.normal_equations(lambda b: b.label != label, variances))
    sds = {b.label: np.sqrt(variances.get(b.label, 1.0)) for b in blocks}
    scaled = [replace(b, r=b.r / sds[b.label], C=b.C / sds[b.label], F=b.F / sds[b.label]) for b in blocks]
    [out] = (b for b in blocks if b.label == label)
    d, covariance = posterior([b for b in scaled if b.label != label], PRIORS)
    _, A = dense([out], list(PRIORS))
    expected = multivariate_normal(A @ d, sds[label] ** 2 * np.eye(out.count) + A @ covariance @ A.T).logpdf(out.r)
    assert every.ln_evidence - rest.ln_evidence - 0.5 * out.count * LN_TWO_PI == pytest.approx(expected, rel=1e-10)


def test_residual_is_what_the_columns_leave(blocks):
    found = LinearSystem(blocks).solve(PRIORS)
    for b in blocks:
        r, A = dense([b], list(found.names))
        np.testing.assert_allclose(whitened_residual(b, found), r - A @ found.d, rtol=0, atol=1e-12)


def test_products_of_lent_columns_are_those_of_their_data(blocks):
    """One column is anew and two of another block are lent, in another order; all else is as computed from scratch."""
    rng, old = np.random.default_rng(3), LinearSystem(blocks)
    for b in old.blocks:
        F_names = tuple((n, c - b.C.shape[1] + 1) for n, c in b.names if c >= b.C.shape[1])
        new = replace(b, r=rng.normal(size=b.count), C=rng.normal(size=(b.count, 1)), names=((MU, 0), *F_names))
        found = new.with_columns_of(b, lambda p: p != SHIFT)
        assert "gram" in vars(found)
        assert SHIFT not in [n for n, _ in found.names]
        np.testing.assert_allclose(found.gram, replace(found).gram, rtol=1e-12, atol=1e-12)
        assert "gram" not in vars(
            new.with_columns_of(replace(b, F=b.F.copy()), lambda p: True)
        )  # other data: nothing is lent
        assert found.with_residual(b.r).gram is found.gram


def test_projection_is_of_the_data_with_the_nuisances_marginalised(blocks):
    """u = W' V^-1 (r - N mean), I = W' V^-1 W, with V = 1 + N sd^2 N'."""
    wanted = [PHI, MODE]
    nuisance = {n: v for n, v in PRIORS.items() if n not in wanted}
    found = LinearSystem(blocks).project_out(nuisance, wanted)
    names, mean, sd = parts(nuisance)
    r, N = dense(fitted(blocks), names)
    _, W = dense(fitted(blocks), wanted)
    inverse = np.linalg.inv(np.eye(len(r)) + (N * sd**2) @ N.T)
    np.testing.assert_allclose(found.score, W.T @ inverse @ (r - N @ mean), rtol=1e-9)
    np.testing.assert_allclose(found.information, W.T @ inverse @ W, rtol=1e-9)
    np.testing.assert_allclose(found.raw, np.sum(W**2, axis=0), rtol=1e-12)
    assert np.all(np.diag(found.information) < found.raw)


def test_projection_and_estimate_agree(blocks):
    """With a prior N(0, s^2) on what is wanted, its estimate is (I + s^-2)^-1 u."""
    system = LinearSystem(blocks)
    nuisance = {n: v for n, v in PRIORS.items() if n != PHI}
    projection = system.project_out(nuisance, [PHI])
    [u], [[info]] = projection.score, projection.information
    found = system.solve(nuisance | {PHI: (0.0, 0.8)})
    assert found[PHI] == pytest.approx(u / (info + 0.8**-2), rel=1e-10)
    assert found.sd(PHI) == pytest.approx((info + 0.8**-2) ** -0.5, rel=1e-10)
    gain = 0.5 * u**2 / (info + 0.8**-2) - 0.5 * np.log(1 + 0.8**2 * info)
    assert found.ln_evidence - system.solve(nuisance).ln_evidence == pytest.approx(gain, rel=1e-9)


def test_all_blocks_left_out_gives_the_prior(blocks):
    system = LinearSystem(blocks)
    found = system.solve(PRIORS, system.normal_equations(lambda b: False))
    names, mean, sd = parts(PRIORS)
    order = [names.index(n) for n in found.names]
    np.testing.assert_allclose(found.d, mean[order], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), sd[order], rtol=1e-12)
    assert found.ln_evidence == pytest.approx(0.0, abs=1e-12)
    assert found.count == 0


# --- names of columns ----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        (MU, "friction.mu"),
        (ParameterId.of_effect("pressure_tilt", "a"), "pressure_tilt.a"),
        (ParameterId.of_effect("heat_depth", "share", 2), "heat_depth.share@2"),
        (ParameterId(ParameterKind.SHIFT_V).with_scope(3, "wall.nc"), "shift_v|wall.nc"),
        (ParameterId(ParameterKind.MAP, (1, 0)).with_scope(3, "wall.nc"), "map:1:0|wall.nc"),
        (ParameterId(ParameterKind.SCATTER, (2,)).with_scope(3, "wall.nc"), "scatter:2|3"),
        (ParameterId(ParameterKind.MODE, (4,)).with_scope(3, "wall.nc"), "mode:4"),
        (ParameterId(ParameterKind.CELL).with_scope(3, "mu.csv"), "cell"),
        (LEVEL[0], "level|0"),
    ],
)
def test_a_parameter_is_written_where_it_acts(parameter, text):
    assert str(parameter) == text
    assert parameter.is_shared == ("|" not in text)


def test_parameters_are_told_apart_and_sorted():
    """Each of its parts makes another one; equal parts are the same key of a dict."""
    one = ParameterId(ParameterKind.FLUX, (2,), condition=1)
    assert {one: 1}[ParameterId(ParameterKind.FLUX, (2,), condition=1)] == 1
    others = [
        replace(one, **{k: v})
        for k, v in {"kind": ParameterKind.TREND, "index": (3,), "file": "a", "condition": 2}.items()
    ]
    assert len({one, *others}) == 5
    assert sorted([others[1], one]) == [one, others[1]]


def test_other_residuals_on_the_same_columns_are_a_system_of_their_own(blocks):
    rng = np.random.default_rng(11)
    residuals = {b.label: rng.normal(size=b.count) for b in blocks}
    anew = LinearSystem([replace(b, r=residuals[b.label]) for b in blocks])
    first = LinearSystem(blocks)
    before = first.solve(PRIORS)
    moved, expected = first.with_residuals(residuals).solve(PRIORS), anew.solve(PRIORS)
    np.testing.assert_allclose(moved.d, expected.d, rtol=1e-12)
    assert moved.ln_evidence == pytest.approx(expected.ln_evidence, rel=1e-12)
    np.testing.assert_array_equal(first.solve(PRIORS).d, before.d)


def test_equations_add_up_over_blocks(blocks):
    """Those of all fitted blocks are the sum of those of each."""
    system = LinearSystem(blocks)
    whole, parts = (
        system.normal_equations(),
        [system.normal_equations(lambda b, own=b: b is own) for b in fitted(blocks)],
    )
    np.testing.assert_allclose(whole.matrix, sum(p.matrix for p in parts), rtol=1e-12)
    np.testing.assert_allclose(whole.right, sum(p.right for p in parts), rtol=1e-12)
    assert (whole.count, whole.square) == (sum(p.count for p in parts), pytest.approx(sum(p.square for p in parts)))
