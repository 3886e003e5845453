"""Results of a stranger on the pages of the web app: nothing outside is read, no page dies, memory stays bounded."""

from __future__ import annotations

import json
import os

import h5py
import numpy as np
import pytest
from nicegui.client import Client
from nicegui.page import page

from flashtemp.__main__ import main
from flashtemp.api.reports import report
from flashtemp.api.simulation import open_fields
from flashtemp.errors import BadInput
from flashtemp.lab import recording_table, result_files, run_data, scene_3d, study_results
from flashtemp.lab.campaign_page import CampaignPage
from flashtemp.lab.charts import bar_options, bar_series, chart_options, line_series
from flashtemp.lab.command_form import CommandForm
from flashtemp.lab.home_page import HomePage
from flashtemp.lab.jobs import JobList
from flashtemp.lab.page_layout import card
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.recording_store import RecordingStore
from flashtemp.lab.result_files import ResultFolder, open_result
from flashtemp.lab.run_data import read_run
from flashtemp.lab.scene_3d import read_fields
from flashtemp.lab.start_button import CommandStarter
from flashtemp.lab.study_results import read_sweep

MARK = "a\u202eb\nc"


def shown_texts(show):
    """All texts and properties of what `show` puts on a page, and the number of elements."""
    with Client(page("/shown"), request=None) as client:
        show()
        elements = list(client.elements.values())
    return " ".join(f"{getattr(e, '_text', '')} {dict(e.props)}" for e in elements), len(elements)


def result_of(folder, **files):
    """A result in `folder` with JSON files."""
    (folder / "r").mkdir()
    for name, content in files.items():
        (folder / "r" / f"{name}.json").write_text(content)
    return ResultFolder(folder, (folder / "r").relative_to(folder), next(iter(files), "run"))


# --- data that lie outside -------------------------------------------------------------------------------------
def write_run(file, values, *, times=5, repetition=None):
    """A run.nc or sweep.nc whose temperatures are stored as `values(group)` does."""
    with h5py.File(file, "w") as out:
        out["time"], out["x"] = np.arange(float(times)), np.arange(3.0)
        for name in ("time", "x"):
            out[name].make_scale(name)
        if repetition is not None:
            out["repetition"] = repetition
            out["repetition"].dims[0].attach_scale(out["time"])
        values(out)
        for name in ("T_block", "T_max_degC"):
            if isinstance(out.get(name, getlink=True), h5py.HardLink):
                for k, scale in enumerate(("time", "x")):
                    out[name].dims[k].attach_scale(out[scale])


def store_outside(outside):
    """Ways to keep temperatures in a file outside of the folder."""
    layout = h5py.VirtualLayout(shape=(5, 3), dtype="f8")
    layout[:] = h5py.VirtualSource(outside, "T", shape=(5, 3))
    return {
        "storage": lambda out, name: out.create_dataset(name, (5, 3), "f8", external=[(str(outside), 0, 120)]),
        "link": lambda out, name: out.__setitem__(name, h5py.ExternalLink(outside, "/T")),
        "virtual": lambda out, name: out.create_virtual_dataset(name, layout),
    }


@pytest.mark.parametrize("way", ["storage", "link", "virtual"])
@pytest.mark.parametrize(("name", "read"), [("run.nc", read_run), ("sweep.nc", read_sweep)])
def test_a_result_shows_no_data_of_a_file_outside_of_the_folder(tmp_path, name, read, way):
    outside, folder = tmp_path / "outside.h5", tmp_path / "folder"
    with h5py.File(outside, "w") as out:
        out["T"] = np.full((5, 3), 4711.0)
    folder.mkdir()
    result = result_of(folder)
    store = store_outside(outside)[way]
    write_run(result.path / name, lambda out: [store(out, n) for n in ("T_block", "T_max_degC")])
    with pytest.raises(BadInput, match="another file"):
        read(result)


def test_a_run_with_its_data_inside_is_read(tmp_path):
    result = result_of(tmp_path)
    write_run(result.path / "run.nc", lambda out: out.__setitem__("T_block", np.full((5, 3), 47.0)))
    assert read_run(result).quantities[0].curves


def write_fields(file, cells=4, **external):
    """A fields.vtkhdf with one time, of which the block has that many cells."""
    with h5py.File(file, "w") as out:
        out["VTKHDF/block/Steps/Values"] = np.zeros(1)
        for body in ("block", "road"):
            out[f"VTKHDF/{body}/Points"] = np.zeros((8, 3))
            out[f"VTKHDF/{body}/NumberOfCells"] = [cells]
            out.create_dataset(
                f"VTKHDF/{body}/CellData/T_degC", (cells,), "f8", chunks=(1000,) if cells > 1000 else None
            )
        if external:
            out.create_dataset("VTKHDF/road/CellData/other", (4,), "f8", **external)


def test_fields_show_no_data_of_a_file_outside_of_the_folder(tmp_path):
    (tmp_path / "secret.bin").write_bytes(bytes(64))
    write_fields(tmp_path / "fields.vtkhdf", external=[(str(tmp_path / "secret.bin"), 0, 32)])
    with pytest.raises(BadInput, match="another file"):
        open_fields(tmp_path)


# --- sizes -----------------------------------------------------------------------------------------------------
def test_fields_of_a_small_file_that_declares_a_huge_size_are_not_read(tmp_path):
    result = result_of(tmp_path)
    write_fields(result.path / "fields.vtkhdf", cells=2 * scene_3d.MAX_FIELD_VALUES)
    with pytest.raises(BadInput, match="too large for this page"):
        read_fields(result, 0.05)


def test_a_run_of_a_small_file_that_declares_a_huge_size_is_not_read(tmp_path):
    result, shape = result_of(tmp_path), (run_data.MAX_PROFILE_BYTES // 8, 3)
    write_run(
        result.path / "run.nc",
        lambda out: out.create_dataset("T_block", shape, "f8", chunks=(1000, 3), fillvalue=1.0),
    )
    with pytest.raises(BadInput, match="MiB of profiles"):
        read_run(result)


@pytest.mark.parametrize("limit", ["MAX_TIMES", "MAX_REPETITIONS"])
def test_a_run_of_too_many_times_or_repetitions_is_not_drawn(tmp_path, monkeypatch, limit):
    monkeypatch.setattr(run_data, limit, 4)
    result = result_of(tmp_path)
    write_run(
        result.path / "run.nc",
        lambda out: out.__setitem__("T_block", np.full((5, 3), 47.0)),
        repetition=np.arange(5.0),
    )
    with pytest.raises(BadInput, match="open it with xarray"):
        read_run(result)


@pytest.mark.parametrize(
    ("command", "show"),
    [
        ("compare", lambda lines: {"warnings": lines}),
        ("sensitivity", lambda lines: {"conclusions": lines, "numbers": {"a": {"words": "a", "value": 1.0}}}),
    ],
)
@pytest.mark.parametrize("lines", ["x" * 5000, ["x"] * 5000], ids=["text", "list"])
def test_a_huge_list_becomes_no_huge_page(tmp_path, command, show, lines):
    content = show(lines)
    result = result_of(tmp_path, **{command: json.dumps(content)})
    starter = CommandStarter(tmp_path, JobList(tmp_path), AllowedPrograms())
    _, n_elements = shown_texts(lambda: study_results.show_study(result, starter))
    assert n_elements < 1000


# --- pages that would die --------------------------------------------------------------------------------------
@pytest.mark.parametrize("value", ["1" + "0" * 400, "1e400", "NaN", "true", '"1"', "[1]"])
def test_the_home_page_stands_whatever_number_a_summary_holds(tmp_path, value):
    result = result_of(tmp_path, summary=f'{{"T_max_degC": {value}, "rise_trailing_K": 1.0}}')
    (result.path / "run.nc").write_bytes(b"")
    text, _ = shown_texts(HomePage(tmp_path, JobList(tmp_path), AllowedPrograms()).show)
    assert "Recent results" in text
    assert "highest" not in text


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("compare", '{"recordings": [{"file": "a.nc", "chi2_per_dof": 9, "rmse_K": %s}]}'),
        ("loads", '{"pressure_Pa": [1, 2], "speed_m_s": [1], "ln_change": [%s]}'),
        ("tread", '{"maximum": {"slip": %s, "friction": 1}}'),
        ("tyre", '{"maxima": [{"model": "brush", "law": "law", "load_N": %s, "mu": 1}], "fall": {"brush": 0.1}}'),
    ],
)
@pytest.mark.parametrize("value", ["1" + "0" * 400, "1e308", "Infinity"])
def test_the_home_page_stands_whatever_number_a_result_holds(tmp_path, name, content, value):
    result_of(tmp_path, **{name: content % value})
    text, _ = shown_texts(HomePage(tmp_path, JobList(tmp_path), AllowedPrograms()).show)
    assert "Recent results" in text


def test_the_time_of_a_file_may_lie_beyond_the_calendar(tmp_path, monkeypatch):
    result = result_of(tmp_path, verdict="{}")
    state = os.stat(result.path / "verdict.json")
    far = os.stat_result((*state[:8], 2**62, 2**62))
    monkeypatch.setattr(result_files.Path, "stat", lambda *args, **more: far)
    assert result_files.describe_age(result, ["verdict.json"]) == ""


# --- direction marks and line breaks ---------------------------------------------------------------------------
def test_no_chart_or_card_shows_control_characters_of_a_file():
    lines = chart_options([line_series(MARK, [0.0], [1.0])], MARK, MARK)
    bars = bar_options([bar_series(MARK, [MARK], [1.0])], [MARK], MARK)
    text, _ = shown_texts(lambda: card("title", MARK).__enter__())
    for shown in (json.dumps(lines, ensure_ascii=False), json.dumps(bars, ensure_ascii=False), text):
        assert "\u202e" not in shown
        assert "a\\u202eb" in shown.replace("\\\\", "\\")


def test_a_result_is_opened_by_a_plain_name_only(tmp_path):
    with pytest.raises(BadInput):
        open_result(tmp_path, "..")


# --- reports as PDF --------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "content",
    [
        b"<div>" * 3000,
        b"\xff\xfe\x00",
        b"<table><tr><td colspan=100000000 rowspan=100000000>x</table>",
        b"<style>@page{size:1e9cm} p{font-size:1e30px;margin:1e38cm}</style><p>x",
        b'<p style="columns:1000000000;width:calc(1px/0)">x',
    ],
    ids=["deep", "undecodable", "spans", "sizes", "columns"],
)
def test_a_report_that_cannot_be_laid_out_is_refused_in_words(tmp_path, content):
    pytest.importorskip("weasyprint")
    (tmp_path / "report.html").write_bytes(content)
    (tmp_path / "report.pdf").write_bytes(b"old")
    with pytest.raises(BadInput, match="print it from a browser"):
        report(tmp_path, pdf=True)
    assert (tmp_path / "report.pdf").read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report.html", "report.pdf"]


def test_a_report_that_takes_for_ever_is_given_up_in_one_line(tmp_path, monkeypatch, capsys):
    pytest.importorskip("weasyprint")
    rows = "<tr>" + "<td><table><tr><td>x</table>" * 60
    (tmp_path / "report.html").write_text("<table>" + rows * 3000 + "</table>")
    monkeypatch.setattr("flashtemp.viz.html.pdf.write_pdf.__defaults__", (3.0,))
    assert main(["report", str(tmp_path), "--pdf"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[-1].endswith("report.html: not laid out within 3 s; print it from a browser")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_a_report_that_is_a_link_out_of_its_folder_is_not_read(tmp_path):
    pytest.importorskip("weasyprint")
    (tmp_path / "result").mkdir()
    (tmp_path / "secret.html").write_text("<h1>secret")
    (tmp_path / "result" / "report.html").symlink_to(tmp_path / "secret.html")
    with pytest.raises(BadInput, match="is a link"):
        report(tmp_path / "result", pdf=True)


# --- cases and campaigns ---------------------------------------------------------------------------------------
def test_a_campaign_of_thousands_of_recordings_becomes_no_huge_page(tmp_path):
    row = '[[recording]]\nfile = "a.nc"\n[recording.with]\n'
    keys = "".join(f'"load.key{k}" = 1\n' for k in range(100))
    (tmp_path / "campaign.toml").write_text('case = "case.toml"\n' + row + keys + row * 400)
    shown = CampaignPage(tmp_path, AllowedPrograms(), RecordingStore(tmp_path))
    text, _ = shown_texts(lambda: shown.show("campaign.toml"))
    assert len(shown.table.rows) == recording_table.MAX_ROWS
    assert len(shown.table.rows[0].fields) < recording_table.MAX_COLUMNS + 10
    assert "and 201 more" in text


def test_lists_of_files_show_no_control_characters(tmp_path):
    (tmp_path / f"{MARK}.toml").write_text("[block]\n")
    (tmp_path / "campaign.toml").write_text('case = "case.toml"\n[[recording]]\nfile = "a.nc"\n')

    def show():
        CommandForm(tmp_path).show("run", "")
        CampaignPage(tmp_path, AllowedPrograms(), RecordingStore(tmp_path)).show("campaign.toml")

    with Client(page("/shown"), request=None) as client:
        show()
        labels = [o["label"] for e in client.elements.values() for o in e.props.get("options", []) if "label" in o]
    assert [label for label in labels if label.endswith(".toml")] == ["a\\u202eb\\nc.toml"] * 2
    assert all(label.isprintable() for label in labels)
