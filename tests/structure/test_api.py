"""One public face: every command has its Python call, every result shows itself, the docs lead nowhere deeper."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import flashtemp
from flashtemp.cli.commands import COMMAND_NAMES, app
from flashtemp.discovery.verdict import CandidateReport, Cause, ParameterEstimate, Verdict
from flashtemp.display import MAX_TABLE_ROWS, DisplayMixin, DisplayTable
from flashtemp.runs.studies.load_dependence import PROCESS_NAMES, LoadDependence, list_subsets

ROOT = Path(__file__).parents[2]
CALL = {"run": "simulate", "import": "import_recording"}  # the others are called as the command
ELSEWHERE = {  # options of commands whose place in Python is another: (command, option): call
    ("run", "resume"): "resume", ("import", "template"): "recording_template", ("import", "look"): "inspect_files",
    ("spots", "synthetic"): "spots",  # no file
    ("effects", "check"): "check_effect", ("effects", "values"): "check_effect",
    ("friction", "area"): "compute_contact_area",
}  # fmt: skip
RENAMED = {("sweep", "values"): "axes", ("import", "facts"): "facts"}
TITLE = 'a <b>bold</b> & "quoted" title'
SMALL = f"""title = '{TITLE}'
effects = ["friction_softening"]
free = ["friction.mu"]
[friction_softening]
b = 0.006
[block]
height = 0.005
[schedule]
distance = 0.05
repetitions = 2
wait = 1.0
[numerics]
mesh = 0.25
[output]
profiles = 6
fields = 2
pictures = false
"""
TALL, WIDE = 45, 220  # lines and columns of one screen; long remarks wrap


def commands() -> dict[str, inspect.Signature]:
    """Every command of the command line by its name."""
    named = [name for name in COMMAND_NAMES if name != "lab"]  # a page is no call
    return {name: inspect.signature(app[name].default_command) for name in named}


def call_of(command: str):
    return getattr(flashtemp, CALL.get(command, command))


@pytest.mark.parametrize("command", commands())
def test_every_command_is_one_call(command):
    """With all its options, of the same names."""
    assert CALL.get(command, command) in flashtemp.__all__
    known = inspect.signature(call_of(command)).parameters
    for name, option in commands()[command].parameters.items():
        if name in ("json", "overrides") or option.kind is option.POSITIONAL_ONLY:
            continue
        if (command, name) in ELSEWHERE:
            assert callable(getattr(flashtemp, ELSEWHERE[command, name]))
        elif name == "trust":  # what is loaded has been trusted or not
            assert {"trust"} <= {*inspect.signature(flashtemp.load).parameters}
        elif name == "limit":  # what is opened was within it
            assert {"limit"} <= {*inspect.signature(flashtemp.open_campaign).parameters}
        else:
            assert RENAMED.get((command, name), name) in known or name == "files", name


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A small case, its result folder, a synthetic campaign of it and a friction record, beside each other."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "case.toml").write_text(SMALL)
    (folder / "friction.csv").write_text(
        "repetition,mu\n" + "".join(f"{n},{0.9 - 0.1 * 0.6**n + 1e-4 * (-1) ** n}\n" for n in range(1, 9))
    )
    flashtemp.simulate(folder, out=folder / "run")
    flashtemp.twin(folder, hide=[], seed=1, out=folder / "twin", conditions=1, views=["sidewall"], nuisance=0.0)
    text = (folder / "twin" / "campaign.toml").read_text()
    (folder / "twin" / "campaign.toml").write_text('candidates = ["pressure_tilt", "camera_offset"]\n' + text)
    return folder


THEORY = ROOT / "cases" / "tread_block"
CALLS = {  # every public call on something small
    "load": lambda lab: flashtemp.load(lab, {"friction.mu": 0.7}),
    "check": lambda lab: flashtemp.check(lab, {"friction.mu": 0.7}),
    "simulate": lambda lab: flashtemp.simulate(lab, {"schedule.repetitions": 1}),
    "draw": lambda lab: flashtemp.draw(lab / "run"),
    "report": lambda lab: flashtemp.report(lab / "run"),
    "open_fields": lambda lab: flashtemp.open_fields(lab / "run"),
    "sweep": lambda lab: flashtemp.sweep(lab, {"friction.mu": [0.5, 1.0]}, {"schedule.repetitions": 1}, workers=1),
    "converge": lambda lab: flashtemp.converge(lab, {"schedule.repetitions": 1}),
    "repetitions": lambda lab: flashtemp.repetitions(lab / "friction.csv", distance=0.05),
    "wait": lambda lab: flashtemp.wait(lab, below=200.0),
    "sensitivity": lambda lab: flashtemp.sensitivity(lab, ["friction.mu", "contact.pressure"], linear=True),
    "effects": lambda lab: flashtemp.effects("wear"),
    "open_campaign": lambda lab: flashtemp.open_campaign(lab / "twin"),
    "compare": lambda lab: flashtemp.compare(lab / "twin"),
    "plan": lambda lab: flashtemp.plan(lab / "twin", workers=1),
    "twin": lambda lab: flashtemp.twin(
        lab, hide=[], seed=2, out=lab / "other", conditions=1, views=["profile"], nuisance=0.0
    ),
    "import_recording": lambda lab: flashtemp.import_recording(
        next((lab / "twin").glob("*.nc")), view="sidewall", out=lab / "side.nc"
    ),
    "new": lambda lab: flashtemp.new("campaign", out=lab / "begun.toml"),
    "inspect_files": lambda lab: flashtemp.inspect_files(next((lab / "twin").glob("*sidewall.nc"))),
    "friction": lambda lab: flashtemp.friction(THEORY, slowest=1e-3, fastest=1.0),
    "compute_contact_area": lambda lab: flashtemp.compute_contact_area(THEORY),
    "tread": lambda lab: flashtemp.tread(THEORY, {"title": TITLE, "tread.slip": [0.05]}),
    "tyre": lambda lab: flashtemp.tyre(ROOT / "cases" / "tyre", {"title": TITLE, "tyre.angles": [2.0, 4.0], "tyre.loads": [2e3, 4e3]}),
    "spots": lambda lab: flashtemp.spots(cutoff=2e-3, length=0.01, width=0.01, pixel=2e-4, out=lab / "road.npz"),
    "spectrum": lambda lab: flashtemp.spectrum(ROOT / "tests" / "data" / "captif_profile.dat", profile=True),
}  # fmt: skip
SLOW = {
    "loads",
    "discover",
    "view",
    "resume",
    "check_effect",
    "watch",
}  # their commands make the calls in tests of their own
TYPES = {name for name in flashtemp.__all__ if isinstance(getattr(flashtemp, name), type)}


def test_all_calls_are_made():
    assert {*CALLS} | SLOW | TYPES | {"physics", "recording_template"} == {*flashtemp.__all__}


def screen(text: str) -> bool:
    """Whether a text fits on one."""
    lines = text.splitlines()
    return len(lines) <= TALL and max(map(len, lines)) <= WIDE


def opened(html: str) -> ET.Element:
    """The elements of a fragment; it fails where tags are not closed or text is not escaped."""
    return ET.fromstring(html)


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.sample("[!tdp]*", "twin")
def test_a_result_shows_itself(name, lab):
    result = CALLS[name](lab)
    assert isinstance(result, DisplayMixin)
    assert screen(repr(result)) or name == "effects", repr(result)
    assert "array(" not in repr(result)
    found = opened(result._repr_html_())
    assert found.find(".//b") is None
    assert "".join(found.itertext()).strip()


def test_nothing_is_written_without_out(lab):
    """By a call that has its folder to choose."""
    before = {p for p in lab.rglob("*")}
    flashtemp.simulate(lab)
    flashtemp.sweep(lab, {"friction.mu": [0.5, 1.0]}, workers=1)
    assert {p for p in lab.rglob("*")} == before


def test_a_loaded_case_is_as_good_as_its_path(lab):
    loaded = flashtemp.simulate(flashtemp.load(lab), {"friction.mu": 0.7})
    assert loaded.summary["T_max_degC"] == flashtemp.simulate(lab, {"friction.mu": 0.7}).summary["T_max_degC"]


def test_titles_are_escaped(lab):
    run = flashtemp.simulate(lab)
    assert TITLE in repr(run)
    assert "<b>" not in run._repr_html_()
    assert TITLE in "".join(opened(run._repr_html_()).itertext())


def test_loads_show_shares():
    one, flat = np.array([[1.0, 0.8]]), np.ones((1, 2))
    mu = {some: one if "heating" in some else flat for some in list_subsets(PROCESS_NAMES)}
    found = LoadDependence(TITLE, np.array([1e5, 2e5]), np.array([1.0]), PROCESS_NAMES, {}, mu, one, "fixed")
    cells = [cell.text for cell in opened(found._repr_html_()).findall("table/tbody/tr/td")]
    assert cells[:4] == ["1", "1", "0.8", "-20.0 %"]
    assert cells[-1] == "-20.0 %"
    assert screen(repr(found))
    assert TITLE in repr(found)


def test_a_verdict_shows_causes_and_rivals():
    cause = Cause(
        "wear",
        "rubber wears off",
        (ParameterEstimate("wear.rate", 4e-11, 1e-12, (3e-11, 5e-11), "m2/N"),),
        100.0,
        9.0,
        0.9,
    )
    verdict = Verdict(
        TITLE, "named", ("Cause: <i>wear</i>.",), (cause,), rivals=(CandidateReport("flash", 3.0, 0.5, ""),)
    )
    found = opened(verdict._repr_html_())
    text = "".join(found.itertext())
    assert all(word in text for word in (TITLE, "named", "Cause: <i>wear</i>.", "wear.rate", "4e-11", "m2/N", "flash"))
    assert "array(" not in repr(verdict)


def test_long_tables_are_cut_and_parts_unfold():
    sheet = DisplayTable(
        "top", [(n, None) for n in range(MAX_TABLE_ROWS + 5)], parts=[DisplayTable("<deep>", [("x", True)])]
    )
    found = opened(sheet.to_html())
    assert len(found.findall("table/tbody/tr")) == MAX_TABLE_ROWS
    assert "and 5 more" in "".join(found.itertext())
    assert found.find("details/summary").text == "<deep>"
    assert [cell.text for cell in found.findall("details/table/tbody/tr/td")] == ["x", "yes"]


# --- docs --------------------------------------------------------------------------------------------
PAGES = [
    ROOT / "README.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if "made" not in p.parts),
    ROOT / "cases" / "README.md",
]
BLOCKS = [
    (f"{page.name}:{text[: block.start()].count(chr(10)) + 1}", block[1])
    for page in PAGES
    for text in [page.read_text(encoding="utf-8")]
    for block in re.finditer(r"```python\n(.*?)```", text, re.DOTALL)
]
HOMES = {"flashtemp": flashtemp, "flashtemp.physics": flashtemp.physics}


def test_there_is_python_in_the_docs():
    pages = {name.partition(":")[0] for name, _ in BLOCKS}
    assert "README.md" in pages
    assert len(pages) >= 6


@pytest.mark.parametrize(("where", "code"), BLOCKS, ids=[name for name, _ in BLOCKS])
def test_docs_lead_to_the_public_face_only(where, code):
    """Every name of ours is public, with arguments that it takes."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            assert not any(a.name.startswith("flashtemp.") for a in node.names), where
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "flashtemp":
            assert {a.name for a in node.names} <= {*HOMES[node.module].__all__}, where
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "flashtemp":
            assert node.attr in flashtemp.__all__, where
        if isinstance(node, ast.Call) and re.fullmatch(r"flashtemp\.\w+", name := ast.unparse(node.func)):
            call = getattr(flashtemp, name.removeprefix("flashtemp."))
            inspect.signature(call).bind(*node.args, **{k.arg: k.value for k in node.keywords})


def test_what_the_docs_show_is_there(lab):
    """Attributes of results that the examples use."""
    run, record = flashtemp.simulate(lab), flashtemp.repetitions(lab / "friction.csv", distance=0.05)
    assert "T_spot" in run.dataset()
    assert record.s_w_interval[0] < record.s_w < record.s_w_interval[1]
    assert flashtemp.open_fields(lab / "run").grids_at(0.0)["block"].n_cells > 0
    swept = flashtemp.sweep(lab, {"friction.mu": [0.5, 1.0]}, workers=1).dataset
    assert swept.T_max_degC.dims == ("friction.mu",)
    seen = flashtemp.compare(lab / "twin").recordings[0]
    assert seen.residual.ndim == 3
    assert seen.rmse_K > 0


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("flashtemp.look", "flashtemp.inspect_files"), ("flashtemp.area", "flashtemp.compute_contact_area"),
        ("flashtemp.viz.field", "flashtemp.viz.run.field"),
        ("flashtemp.physics.effect.find", "flashtemp.physics.effect.find_effect"),
        ("flashtemp.errors.nearest", "flashtemp.errors.suggest_name"),
    ],
)  # fmt: skip
def test_a_name_of_an_earlier_release_works_and_warns_once(old, new, monkeypatch):
    monkeypatch.setattr(flashtemp.errors, "REPORTED_NAMES", set())

    def find(dotted: str):
        parts, found = dotted.split("."), flashtemp
        for part in parts[1:]:
            try:
                found = getattr(found, part)
            except AttributeError:
                found = importlib.import_module(f"{found.__name__}.{part}")
        return found

    with pytest.warns(FutureWarning, match=r"is now \S*" + new.rpartition(".")[2]):
        first = find(old)
    assert first is find(old) is find(new)  # the second time without a warning: warnings are errors here
