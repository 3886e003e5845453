"""The verdict follows from evidence by one function: every kind, and comparisons that noise alone must not decide."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flashtemp.discovery.criteria import CRITERIA, Criteria, list_criteria
from flashtemp.discovery.decision import AdequacyTest, AlternativeCause, EffectSize, VerdictEvidence, decide
from flashtemp.discovery.diagnostics.effect_size import camera_fraction
from flashtemp.discovery.diagnostics.fit_report import _rejection_reason
from flashtemp.discovery.hypotheses.candidates import CandidateEffect
from flashtemp.discovery.selection.scores import Separability
from flashtemp.physics.effect import find_effect

SEEN = EffectSize(rise_fraction=0.045, change_K=0.1)
QUIET = (AdequacyTest("noise left over", 0.9, 1.0),)
CAUSE = VerdictEvidence(
    is_converged=True, base_certainly_misfits=False, causes=("pressure_tilt",), ln_bayes=58.0,
    ln_bayes_discrepancy=50.0, heldout_gain=43.0, size=SEEN, adequacy=QUIET,
)  # fmt: skip
NOTHING = VerdictEvidence(is_converged=True, base_certainly_misfits=False, adequacy=QUIET)


def test_a_plain_cause_is_named_whatever_an_rms_does():
    """ln Bayes factor 58 and left-out data likelier by 43; an rms that moved in its last digit is no evidence at all."""
    assert decide(CAUSE).kind == "named"
    assert not any("rms" in f for f in VerdictEvidence.__dataclass_fields__)


def test_nothing_missing_is_an_answer():
    found = decide(NOTHING)
    assert found.kind == "none_needed"
    assert found.reasons == ()


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"is_converged": False}, "no_verdict"),
        ({"is_converged": False, "base_certainly_misfits": True}, "unexplained"),
        ({"adequacy": (AdequacyTest("noise left over", 1.2, 1.0),)}, "unexplained"),
        ({"unresolved": {"wear": 30.0}}, "no_verdict"),
        ({"ln_bayes": 7.0, "ln_bayes_discrepancy": 7.0}, "weak"),
        ({"ln_bayes_discrepancy": 6.0}, "weak"),
        ({"heldout_gain": -5.0}, "weak"),
        ({"size": EffectSize(5e-4, change_K=0.01)}, "none_needed"),
        ({"size": EffectSize(8e-4, change_K=0.01, camera_fraction=0.03)}, "named"),
        ({"size": EffectSize(8e-4, change_K=0.01, camera_fraction=8e-4)}, "none_needed"),
        ({"alternatives": (AlternativeCause(frozenset({"edge_pressure"}), 2.0),)}, "group"),
        ({"alternatives": (AlternativeCause(frozenset({"edge_pressure"}), 20.0),)}, "named"),
        ({"is_hint": True, "ln_bayes": 6.0, "ln_bayes_discrepancy": 6.0}, "weak"),
    ],
)
def test_each_rule_has_its_verdict(change, kind):
    assert decide(replace(CAUSE, **change)).kind == kind


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"setup_errors": ("pixel_scale",)}, "named"),
        ({"recording_errors": ("exchanged",)}, "named"),
        ({"contradicted_input": "contact.pressure"}, "held_key"),
        ({"setup_errors": ("block_length",), "setup_alternatives": ("pixel_scale",)}, "group"),
        ({"learned_law": "friction over place", "law_excess_left": 0.4}, "learned"),
        ({"learned_law": "friction over place", "law_excess_left": 0.9}, "unexplained"),
        ({"learned_law": "friction over place", "law_excess_left": 0.4, "heldout_gain": -9.0}, "unexplained"),
    ],
)
def test_what_is_no_effect_has_its_verdict(change, kind):
    assert decide(replace(NOTHING, **change)).kind == kind


def test_a_verdict_that_is_not_certain_says_why():
    reasons = decide(replace(CAUSE, ln_bayes=7.0)).reasons
    assert reasons == ("the ln Bayes factor of pressure_tilt is 7.0; a cause needs 8",)


def test_that_the_fit_converged_and_every_effect_was_judged_are_rules_too():
    passed = [r.name for r in decide(CAUSE).rules if r.passed]
    assert {"the fit converged", "all effects were judged"} <= set(passed)
    assert "all effects were judged" not in [r.name for r in decide(replace(CAUSE, unresolved={"wear": 30.0})).rules]


@pytest.mark.parametrize(("rho", "resembles"), [(0.99, True), (0.3, False)])
def test_a_candidate_resembles_the_cause_only_where_their_sensitivities_correlate(rho, resembles):
    names = ("edge_pressure", "wear", "radiation")
    matrix = np.array([[1.0, rho, 0.1], [rho, 1.0, 0.5], [0.1, 0.5, 1.0]])
    single = Separability(names, matrix, np.ones(3))
    score = SimpleNamespace(effect="wear", reason="", typical_z=30.0)
    words = _rejection_reason(SimpleNamespace(vanished={}), score, single, 50.0, None, ("edge_pressure",))
    assert words.endswith("with edge_pressure in the model it explains nothing more")
    assert words.startswith("its sensitivity resembles that of edge_pressure") == resembles


def test_members_of_a_group_are_the_accepted_and_the_other():
    other = AlternativeCause(frozenset({"edge_pressure", "wear"}), 1.0)
    found = decide(replace(CAUSE, causes=("pressure_tilt", "wear"), ln_bayes=90.0, alternatives=(other,)))
    assert found.kind == "group"
    assert set(found.group) == {"pressure_tilt", "edge_pressure"}


def _candidate(name, strength, optical):
    return CandidateEffect(name, find_effect(name).params(), {strength: 1.0}, {}, optical)


def test_an_error_of_the_camera_is_as_large_as_what_it_shows_however_well_others_imitate_it():
    """A camera reads 1 K too high where pixels are 0 and 10 K warm; calibrated again hardly anything is left of it."""
    offset, tilt = _candidate("camera_offset", "offset", True), _candidate("pressure_tilt", "a", False)
    warm = np.array([[[20.0, 30.0]], [[20.0, 30.0]]])  # frames, rows, columns
    names = ((offset.strength_column("offset"), 0), (tilt.strength_column("a"), 0))
    block = SimpleNamespace(label="a", names=names, C=np.full((4, 1), 20.0))  # 1 K in units of the noise
    data = SimpleNamespace(
        is_compared={"a": np.ones((2, 2), bool)}, sigmas={}, to_kelvin=lambda label, c: 0.05 * c.reshape(2, 2)
    )
    seen = SimpleNamespace(observables={"a": SimpleNamespace(values=warm, inside=np.ones((1, 2), bool))})
    base = SimpleNamespace(predictions=[seen], system=SimpleNamespace(blocks=[block]))

    def fraction(**effects):
        extended = SimpleNamespace(model=SimpleNamespace(effects=effects))
        return camera_fraction(data, base, extended, (offset, tilt))

    assert fraction(camera_offset={"offset": 1.0}) == pytest.approx(1.0 / np.sqrt(50.0))
    assert fraction(camera_offset={"offset": -0.01}) < CRITERIA.visible_fraction * 2.0
    assert fraction(pressure_tilt={"a": 1.0}) == 0.0
    assert fraction(camera_offset={"offset": 1.0}, pressure_tilt={"a": 1.0}) == 0.0


def test_left_out_data_speak_against_a_true_cause_once_in_forty_times_at_most():
    """Of two normal predictions D apart the true one gains D^2/2 +- D: simulated, not derived."""
    rng = np.random.default_rng(5)
    for apart in (0.5, 1.0, 2.0, 4.0, 8.0):
        noise = rng.normal(size=(20_000, 4))
        shift = np.full(4, apart / 2.0)
        gain = 0.5 * (((noise + shift) ** 2).sum(axis=1) - (noise**2).sum(axis=1))
        assert np.mean(gain < CRITERIA.heldout_against) < 1.0 / 40.0 + 0.004


def test_there_are_at_most_forty_numbers_and_each_says_what_it_is():
    rows = list_criteria()
    assert len(rows) == len(Criteria.__dataclass_fields__) <= 40
    for name, value, unit, meaning, reason in rows:
        assert np.isfinite(value), name
        assert unit, name
        assert len(meaning) > 15, name
        assert len(reason) > 5, name
