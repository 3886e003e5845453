"""The campaign page: every control edits the text alone, checks come as one types, and strangers' files stay closed."""

from __future__ import annotations

import asyncio
import os
import re
import tomllib

import numpy as np
import pytest
from lab.browsing import CASE, page, served
from lab.test_accessibility import check_page
from nicegui import Client
from nicegui.page import page as ui_page

from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput
from flashtemp.lab import campaign_checks, recording_store
from flashtemp.lab.campaign_checks import advise_on_data, check_campaign, list_conditions
from flashtemp.lab.campaign_document import CampaignDocument
from flashtemp.lab.campaign_list import new_campaign_text
from flashtemp.lab.campaign_page import CampaignPage
from flashtemp.lab.dropped_files import store_measurements
from flashtemp.lab.free_keys import CandidateSwitches, list_free_keys, list_known_keys, read_free, suggest_known
from flashtemp.lab.recording_store import RecordingStore
from flashtemp.lab.saving import check_upload_name
from flashtemp.lab.toml_tables import add_entry, change_entry, read_entries, remove_entry, set_top_key
from flashtemp.lab.workspace import list_folder

NAMES = ("side_150kPa_0.1ms.nc", "side_75kPa_0.1ms.nc")
SPEED, PRESSURE = "schedule.speed", "contact.pressure"


def save_recording(path, seed=1, frames=6, view="sidewall"):
    T = 25.0 + np.random.default_rng(seed).normal(0.0, 0.05, (frames, 8, 20))
    time, u, v = np.linspace(0.5, 3.0, frames), np.linspace(0.0, 0.025, 20), np.linspace(0.0, 0.007, 8)
    Recording(view, T, time, np.ones(frames, int), u, v).save(path)


@pytest.fixture
def place(tmp_path):
    """A folder with a case and two recordings whose names state their conditions."""
    (tmp_path / "case.toml").write_text(CASE)
    for seed, name in enumerate(NAMES):
        save_recording(tmp_path / name, seed)
    return tmp_path


def check(place, text):
    return check_campaign(text, place / "campaign.toml", RecordingStore(place))


# --- edits of the text ------------------------------------------------------------------------------------
TEXT = """# of the first week
title = "t"  # short
free = ["friction.mu"]

[[recording]]  # the first
file = "a.nc"  # from camera 1
with = { "contact.pressure" = 1.5e5 }

# the second was better
[[recording]]
file = "b.nc"
[recording.with]
contact.pressure = 1e5
"schedule.speed" = 0.1  # read off the display

[[force]]
file = "mu.csv"
"""


@pytest.mark.parametrize("kept", ["# of the first week", "# from camera 1", "# read off the display", "# the second"])
def test_an_edit_keeps_comments_and_everything_else(kept):
    text = change_entry(TEXT, "recording", 1, {"with": {PRESSURE: 2e5}, "held_out": True})
    text = change_entry(text, "recording", 2, {"with": {PRESSURE: "90 kPa", SPEED: 0.1}})
    text = add_entry(text, "recording", {"file": "c.nc"}, after=1)
    text = remove_entry(text, "force", 1)
    assert kept in text
    raw = tomllib.loads(text)
    assert [e["file"] for e in raw["recording"]] == ["a.nc", "c.nc", "b.nc"]
    assert "force" not in raw
    first, _, second = read_entries(raw, "recording")
    assert first == {"file": "a.nc", "with": {PRESSURE: 2e5}, "held_out": True}
    assert second["with"] == {PRESSURE: "90 kPa", SPEED: 0.1}


def test_an_edit_that_would_lose_something_is_refused():
    inline = 'recording = [{ file = "a.nc" }]\n'
    for edit in (
        lambda: change_entry(inline, "recording", 1, {"held_out": True}),
        lambda: remove_entry(inline, "recording", 1),
        lambda: change_entry(TEXT, "recording", 3, {"held_out": True}),
        lambda: change_entry("a = [", "recording", 1, {}),
        lambda: add_entry(inline, "recording", {"file": "b.nc"}),
    ):
        with pytest.raises(BadInput):
            edit()


def test_an_entry_of_an_unusual_form_is_written_anew():
    text = '[[recording]]\nfile = "a.nc"\n[recording.with]\ncontact . pressure = 1e5\n"schedule.speed" = 0.1\n'
    changed = change_entry(text, "recording", 1, {"with": {SPEED: 0.2}})
    assert read_entries(tomllib.loads(changed), "recording") == [{"file": "a.nc", "with": {SPEED: 0.2}}]


def test_priors_make_a_table_of_the_free_keys():
    text = set_top_key(TEXT, "free", {"friction.mu": 0.1})
    assert tomllib.loads(text) == tomllib.loads(TEXT) | {"free": {"friction.mu": 0.1}}
    table = 'case = "c.toml"\n\n[free]\n"friction.mu" = 0.2\n\n[[recording]]\nfile = "a.nc"\n'
    assert tomllib.loads(set_top_key(table, "free", ["block.length"]))["free"] == ["block.length"]
    assert "free" not in tomllib.loads(set_top_key(table, "free", None))


# --- what is in the folder ------------------------------------------------------------------------------
def test_a_new_campaign_lists_all_recordings_and_claims_no_condition(place):
    raw = tomllib.loads(new_campaign_text(list_folder(place)))
    assert [e["file"] for e in raw["recording"]] == sorted(NAMES)
    assert all("with" not in e for e in raw["recording"])


def test_a_recording_is_read_once_until_it_changes(place, monkeypatch):
    reads, load = [], recording_store.load
    monkeypatch.setattr(recording_store, "load", lambda *a: (reads.append(a), load(*a))[1])
    store, path = RecordingStore(place), place / NAMES[0]
    brief = store.describe_file(path)
    assert store.describe_file(path) is brief
    assert len(reads) == 1
    assert (brief.view, brief.frames, brief.pixels) == ("sidewall", 6, (20, 8))
    assert brief.noise_K == pytest.approx(0.05, rel=0.2)
    assert brief.picture.startswith("data:image/png;base64,")
    save_recording(path, 5, frames=7)
    assert store.describe_file(path).frames == 7
    monkeypatch.setattr(recording_store, "MAX_SAMPLE_VALUES", 480)
    save_recording(path, 6, frames=9)
    assert store.load_sample(path).frames == 3, "every third of nine"
    assert store.describe_file(path).frames == 9


def test_damaged_and_foreign_recordings_are_refused(place, tmp_path_factory):
    store, outside = RecordingStore(place), tmp_path_factory.mktemp("outside") / "a.nc"
    save_recording(outside)
    (place / "damaged.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(200))
    (place / "link.nc").symlink_to(outside)
    os.mkfifo(place / "pipe.nc")
    for name in ("damaged.nc", "link.nc", "pipe.nc", "missing.nc", "../x.nc", str(outside), "a\0b.nc"):
        with pytest.raises(BadInput):
            store.describe_file(place / name)
        assert store.find_brief(place / name) is None


# --- checks -----------------------------------------------------------------------------------------------
def test_a_good_campaign_says_what_it_can_show(place):
    rows = "".join(
        f'[[recording]]\nfile = "{n}"\nwith = {{ "{PRESSURE}" = {p} }}\n' for n, p in zip(NAMES, (1, 2), strict=True)
    )
    found = check(place, f'case = "case.toml"\n{rows}')
    assert found.faults == ()
    assert [c.views for c in list_conditions(found.campaign, found.case)] == [{"sidewall": 1}] * 2
    words = " ".join(sentence for sentence, _ in advise_on_data(found.campaign))
    assert "Each of the 2 conditions is also predicted from the others" in words
    one = check(place, f'case = "case.toml"\n[[recording]]\nfile = "{NAMES[0]}"\n')
    assert advise_on_data(one.campaign)[0][1] == "warning"
    held = check(place, f'case = "case.toml"\n[[recording]]\nfile = "{NAMES[0]}"\nheld_out = true\n')
    assert "Everything is held out" in advise_on_data(held.campaign)[0][0]


def test_every_error_stands_at_its_row_or_key(place):
    (place / "bad.nc").write_bytes(b"no recording")
    text = f"""case = "case.toml"
free = ["friction.mew"]
[[recording]]
file = "missing.nc"
[[recording]]
file = "{NAMES[0]}"
with = {{ "contact.pressure" = "5 m" }}
[[recording]]
file = "bad.nc"
[[force]]
file = "{NAMES[1]}"
sigma = -1
"""
    found = check(place, text)
    assert [bool(found.entry_faults("recording", n)) for n in (1, 2, 3)] == [True] * 3
    assert "5 m" in found.entry_faults("recording", 2)[0]
    assert "sigma" in found.entry_faults("force", 1)[0]
    assert "friction.mu" in found.key_faults("free")[0]
    assert found.other_faults("free") == []
    assert found.case is not None
    assert str(place) not in found.entry_faults("recording", 1)[0]
    assert check(place, 'case = "case.toml"\nfree = 3 3').other_faults()[0].line == 2
    assert [fault.line for fault in found.faults] == [3, 5, 8, 10, 2]


@pytest.mark.parametrize(
    "text",
    ['case = "../case.toml"\n', '[[recording]]\nfile = "../a.nc"\n', '[[force]]\nfile = "/etc/passwd"\n',
     'case = "a\\u0000b"\n', '[[recording]]\nfile = ".hidden/a.nc"\n'],
)  # fmt: skip
def test_a_campaign_that_names_files_outside_is_not_read(place, monkeypatch, text):
    for name in ("parse_campaign", "load"):
        monkeypatch.setattr(campaign_checks, name, lambda *a, **k: pytest.fail("was read"))
    assert check(place, text).faults


def test_effect_files_wait_for_consent(place):
    (place / "own.py").write_text("")
    (place / "case.toml").write_text('effects = ["own.py"]\n' + CASE)
    (place / "campaign.toml").write_text('case = "case.toml"\n')
    opened = CampaignPage(place)
    for text in ('case = "case.toml"\n', '[[recording]]\nwith = { effects = ["own.py"] }\n'):
        opened.document = CampaignDocument(place, "campaign.toml", text)
        assert opened._find_programs(text, place / "campaign.toml") == [place / "own.py"]
    opened.allowed.allow([place / "own.py"])
    assert opened._find_programs(text, place / "campaign.toml") == []


# --- keys ---------------------------------------------------------------------------------------------------
def test_every_offered_key_is_accepted(place):
    case = check(place, 'case = "case.toml"\n').case
    free, known = list_free_keys(case), list_known_keys(case)
    assert {"friction.mu", "contact.spot_fraction"} <= free.keys()
    assert {"materials.asphalt.conductivity", "sidewall.emissivity", "ambient.temperature"} <= known.keys()
    text = f'case = "case.toml"\n[[recording]]\nfile = "{NAMES[0]}"\n'
    assert check(place, set_top_key(text, "free", list(free))).faults == ()
    stated = {k: suggest_known(key) for k, key in known.items()}
    assert check(place, set_top_key(set_top_key(text, "free", []), "known", stated)).faults == ()
    assert read_free({}, case) == dict.fromkeys(case.free)


def test_candidates_are_those_that_discover_tries(place):
    found = check(place, f'case = "case.toml"\n[[recording]]\nfile = "{NAMES[0]}"\n')
    reasons = found.candidates
    assert reasons["edge_pressure"] == ""
    assert reasons["sheared_block"].startswith("resembles edge_pressure")
    text = set_top_key(f'case = "case.toml"\n[[recording]]\nfile = "{NAMES[0]}"\n', "candidates", list(reasons))
    assert check(place, text).faults == ()


def test_candidates_that_are_shown_edit_nothing(place):
    found, edits = check(place, 'case = "case.toml"\n'), []
    document = CampaignDocument(place, "campaign.toml", 'case = "case.toml"\n')
    document.changed = lambda: edits.append(document.text)
    with Client(ui_page("/"), request=None):
        switches = CandidateSwitches(document, lambda words: None)
        switches.show()
        switches.update_check(found)
        assert edits == []
        next(iter(switches.switches.values())).set_value(False)
    assert len(edits) == 1


# --- dropped files ----------------------------------------------------------------------------------------
class Dropped:
    """A file that a browser sends."""

    def __init__(self, name, data=b"x"):
        self.name, self.data = name, data

    async def iterate(self):
        yield self.data


def store_dropped(place, *files):
    return asyncio.run(store_measurements(place, files, RecordingStore(place)))


GRID = "\n".join(";".join(f"{20 + 0.1 * r + c:.2f}" for c in range(30)) for r in range(20)).encode()


@pytest.mark.parametrize(
    ("name", "data", "kind", "words"),
    [
        ("frame.csv", GRID, "camera file", "30 × 20 px, 20.0 to 50.9 °C"),
        ("times.csv", b"file,time\nframe.csv,1\n", "times of frames", "columns file and time"),
        ("cell.csv", b"time,mu\n0,1\n1,1.1\n2,1.1\n", "load-cell trace", "columns time, mu"),
        ("log.csv", b"time (s),T1 (degC),T2 (degC)\n0,20,21\n1,21,22\n2,22,23\n", "table of temperatures", "T1 (degC)"),
        ("plain.txt", b"0 1\n1 1.1\n2 1.1\n", "table", "2 columns without names"),
        ("own.toml", b'files = ["frame.csv"]\n', "recording template", ""),
        ("notes.txt", b"hello\n", "not recognised", "no rows of numbers"),
        ("bad.nc", b"x", "not recognised", "cannot be read"),
    ],
)  # fmt: skip
def test_a_dropped_file_is_recognised_by_its_content(tmp_path, name, data, kind, words):
    [found] = store_dropped(tmp_path, Dropped(name, data))
    assert found.kind == kind
    assert words in found.words
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_a_series_of_camera_exports_stays_together_and_its_load_cell_does_not(tmp_path):
    files = [Dropped("f1.csv", GRID), Dropped("f2.csv", GRID), Dropped("cell.csv", b"time,mu\n0,1\n1,1.1\n2,1.1\n")]
    store_dropped(tmp_path, *files)
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.csv")) == [
        "camera/f1.csv", "camera/f2.csv", "cell.csv",
    ]  # fmt: skip


def test_dropped_files_get_new_names_and_camera_files_a_folder(place):
    files = [Dropped(NAMES[0]), Dropped("mu.csv"), Dropped("T1.jpg"), Dropped("T2.jpg")]
    found = store_dropped(place, *files)
    assert [str(file.path.relative_to(place)) for file in found if file.kind == "camera file"] == [
        "camera/T1.jpg", "camera/T2.jpg",
    ]  # fmt: skip
    assert (place / NAMES[0].replace(".nc", "-2.nc")).is_file()
    assert (place / "mu.csv").is_file()
    for name in ("../a.nc", ".a.nc", "a.py", "b/a.nc", "a.nc\n", ""):
        before = sorted(place.rglob("*"))
        with pytest.raises(BadInput):
            store_dropped(place, Dropped("good.nc"), Dropped(name))
        assert sorted(place.rglob("*")) == before
    with pytest.raises(BadInput):
        check_upload_name("a.nc")  # the camera page takes no recordings


# --- in the browser ---------------------------------------------------------------------------------------
def test_from_recordings_to_a_campaign(browser, place):
    with served(place) as (address, _), page(browser, address) as seen:
        seen.set_default_timeout(90_000)
        seen.goto(address.split("/?")[0] + "/campaign")
        seen.get_by_role("button", name="New campaign").click()
        seen.get_by_text("One condition:").wait_for()
        seen.get_by_text("Conditions read from the file names").wait_for()
        check_page(seen)
        cell = seen.get_by_label(f"{PRESSURE} of {NAMES[1]}")
        assert cell.input_value() == ""
        seen.get_by_role("button", name="Use them").click()
        seen.get_by_text("Each of the 2 conditions").wait_for()
        assert cell.input_value() == "75"
        seen.get_by_role("cell", name="contact.pressure 75 kPa, schedule.speed 0.1 m/s").wait_for()
        cell.fill("5 m")
        cell.press("Tab")
        seen.get_by_text("is not a quantity in Pa").wait_for()
        cell.fill("80000 Pa")
        cell.press("Tab")
        seen.wait_for_function("cell => cell.value === '80'", arg=cell.element_handle())
        cell.fill("85")
        cell.press("Tab")
        seen.get_by_role("switch", name=f"hold {NAMES[0]} out of the fit").click()
        seen.get_by_text("1 measurement held out").wait_for()
        prior = seen.get_by_label("prior of friction.mu")
        prior.fill("0.2")
        prior.press("Tab")
        seen.get_by_text("Show the text").click()
        seen.locator(".cm-content").get_by_text("0.2").first.wait_for()
        seen.locator(".cm-content").press("Control+Home")
        pasted = 'known = { "ambient.temperature" = "0.3 K" }'
        seen.keyboard.insert_text(f"{pasted}\n")
        assert seen.locator(".cm-line").first.inner_text() == pasted
        seen.get_by_label("uncertainty of ambient.temperature").wait_for()
        seen.get_by_role("button", name="Save").click()
        seen.get_by_text("saved", exact=True).wait_for()
        seen.get_by_role("button", name="Compare").click()
        seen.wait_for_url(re.compile("/runs.job=.*-compare"))
    raw = tomllib.loads((place / "campaign.toml").read_text())
    assert raw["free"] == {"friction.mu": 0.2}
    assert raw["known"] == {"ambient.temperature": "0.3 K"}
    first, second = sorted(raw["recording"], key=lambda e: NAMES.index(e["file"]))
    assert first["held_out"] is True
    assert second["with"] == {PRESSURE: "85 kPa", SPEED: "0.1 m/s"}


@pytest.mark.long  # text is edited above, and test_case_page.py asks about unsaved changes
def test_the_text_is_kept_marked_and_asked_for(browser, place):
    """A new campaign: errors at their line, what is typed while they are marked stays, the address names the file."""
    with served(place) as (address, _), page(browser, address) as seen:
        seen.set_default_timeout(60_000)
        seen.goto(address.split("/?")[0] + "/campaign?new=1")
        seen.get_by_text("not saved yet").wait_for()
        seen.get_by_text("Show the text").click()
        text = seen.locator(".cm-content")
        text.click()  # waits until the fold is open: a hidden editor takes no keys
        text.press("Control+End")
        written = '[[force]]\nfile = "missing.csv"\nsigma = -1.0 # of the load cell, as its data sheet says\n'
        seen.keyboard.type(written, delay=30)  # with a check between the letters
        seen.locator(".cm-line.ft-fault-line", has_text="[[force]]").wait_for()
        assert text.inner_text().replace("\n\n", "\n").rstrip().endswith(written.rstrip())
        seen.get_by_text("unsaved changes").wait_for()
        assert seen.evaluate("!!window.onbeforeunload")
        seen.get_by_role("button", name="Save").click()
        seen.get_by_text("saved", exact=True).wait_for()
        seen.wait_for_url("**/campaign?open=campaign.toml")
        assert not seen.evaluate("!!window.onbeforeunload")
        seen.reload()
        seen.get_by_text("Show the text").click()
        seen.locator(".cm-content").get_by_text("missing.csv").wait_for()
    assert (place / "campaign.toml").read_text().rstrip().endswith(written.rstrip())


@pytest.mark.long  # above, dropped files are stored; test_dropped_files.py drops some in a browser
def test_dropped_recordings_join_and_camera_files_lead_on(browser, place, tmp_path_factory):
    away = tmp_path_factory.mktemp("away")
    save_recording(away / "dropped.nc", 9)
    (away / "T1.csv.jpg").write_bytes(b"x")
    (place / "campaign.toml").write_text(f'case = "case.toml"\n[[recording]]\nfile = "{NAMES[0]}"\n')
    with served(place) as (address, _), page(browser, address, 800) as seen:
        seen.set_default_timeout(90_000)
        seen.goto(address.split("/?")[0] + "/campaign?open=campaign.toml")
        seen.get_by_text("1 recording of the folder not in the campaign").wait_for()
        held = seen.get_by_role("switch", name=f"hold {NAMES[0]} out of the fit")
        held.wait_for()
        assert held.bounding_box()["x"] < 800, "no column is out of sight on a narrow page"
        seen.locator("input[type=file]").set_input_files(away / "dropped.nc")
        seen.get_by_label(f"{PRESSURE} of dropped.nc").wait_for()
        seen.locator("input[type=file]").set_input_files(place / NAMES[0])  # dropped again
        seen.get_by_text(f"{NAMES[0]}: recording, sidewall, 6 frames").wait_for()
        assert sorted(p.name for p in place.glob("*.nc")) == sorted([*NAMES, "dropped.nc"])
        assert seen.get_by_label(f"{PRESSURE} of {NAMES[0]}").count() == 1
        seen.locator("input[type=file]").set_input_files(away / "T1.csv.jpg")
        seen.get_by_text("T1.csv.jpg: camera file, cannot be read").wait_for()
        seen.locator("input[type=file]").set_input_files({"name": "f.csv", "mimeType": "text/csv", "buffer": GRID})
        seen.get_by_text("f.csv: camera file, 30 × 20 px").wait_for()
        seen.get_by_role("button", name="Open them on the camera page").click()
        seen.wait_for_url("**/camera?open=f.csv")
        assert (place / "T1.csv.jpg").is_file()


@pytest.mark.long  # test_effect_files_wait_for_consent is its part
def test_an_effect_file_runs_only_after_a_click(browser, place):
    (place / "own.py").write_text(f"open({str(place / 'ran')!r}, 'w')\n")
    (place / "case.toml").write_text('effects = ["own.py"]\n' + CASE)
    (place / "campaign.toml").write_text(f'case = "case.toml"\n[[recording]]\nfile = "{NAMES[0]}"\n')
    with served(place) as (address, _), page(browser, address) as seen:
        seen.set_default_timeout(90_000)
        seen.goto(address.split("/?")[0] + "/campaign?open=campaign.toml")
        seen.get_by_text("not checked yet", exact=True).wait_for()
        seen.get_by_text("6 frames").first.wait_for()
        assert not (place / "ran").exists()
        seen.get_by_role("button", name="Run it to check the campaign").click()
        seen.get_by_text("own.py").first.wait_for()
        seen.wait_for_function("() => !document.body.innerText.includes('not checked yet')")
        for _ in range(100):
            if (place / "ran").exists():
                break
            seen.wait_for_timeout(200)
        assert (place / "ran").exists()
