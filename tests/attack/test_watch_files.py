"""Hostile files that arrive in a watched folder: the watch goes on, reads within the folder, and reports in one line."""

from __future__ import annotations

import os

import pytest

from flashtemp.camera.importing.arriving_files import FolderScanner
from flashtemp.camera.importing.growing_recording import IMPORTED, REFUSED, GrowingRecording, RecordingTemplate
from flashtemp.discovery.watched_test import WatchedTest, WatchEvent
from flashtemp.errors import BadInput

GOOD = "\n".join(";".join(f"{30 + r + 0.1 * c:.2f}" for c in range(9)) for r in range(6)) + "\n"
TEMPLATE = """files = ["incoming/*"]
out = "side.nc"
view = "sidewall"
downstream = "right"
pixel = [1, 4]
mm_per_pixel = 0.5
repetition = 1
fps = 2.0
start = 0.0
"""


def damaged_files(folder):
    """Files of every camera format with a content that none of them has."""
    for suffix in (
        "jpg",
        "jpeg",
        "fff",
        "seq",
        "csq",
        "irb",
        "csv",
        "asc",
        "txt",
        "tif",
        "tiff",
        "png",
        "mat",
        "h5",
        "hdf5",
    ):
        for k, content in enumerate((b"FFF\x00" + b"\xff" * 5000, b"AFF\x00" + bytes(5000), b"\x89PNG\r\n\x1a\n" + b"\xff" * 99,
                                     b"II*\x00" + b"\xff" * 500, b"\xff\xd8\xff\xe1" + b"\x01" * 800, b"\x89HDF\r\n\x1a\n" + b"\xff" * 600,
                                     b"1e400;nan\n" * 9, b"[" * 70000, b"MATLAB 5.0 MAT-file" + b"\xff" * 600)):  # fmt: skip
            (folder / f"{suffix}{k}.{suffix}").write_bytes(content)


@pytest.fixture
def arrivals(tmp_path):
    """The folder of camera files beside a template."""
    (tmp_path / "incoming").mkdir()
    (tmp_path / "side.toml").write_text(TEMPLATE.replace("fps = 2.0\nstart = 0.0\n", 'times = "times.csv"\n'))
    return tmp_path / "incoming"


def look_twice(arrivals):
    """What a watch says of the files that are there, without patience."""
    template = RecordingTemplate.from_file(arrivals.parent / "side.toml", arrivals)
    growing, scanner = GrowingRecording(template, arrivals.parent), FolderScanner(arrivals.resolve())
    scanner.scan_files()
    return {n.file.name: (n.state, n.reason) for n in growing.take_files(*scanner.scan_files(), 0.0, 0.0)}


def test_damaged_files_of_every_format_are_refused_and_the_others_imported(arrivals):
    damaged_files(arrivals)
    names = ["good.csv", *(p.name for p in arrivals.iterdir())]
    (arrivals / "good.csv").write_text(GOOD)
    (arrivals.parent / "times.csv").write_text("file,time\n" + "".join(f"{n},{k}\n" for k, n in enumerate(names)))
    said = look_twice(arrivals)
    assert said["good.csv"][0] == IMPORTED
    states = {name: state for name, (state, _) in said.items() if name != "good.csv"}
    assert set(states.values()) == {REFUSED}
    assert len(states) == len(names) - 1


def test_pipes_and_hidden_files_are_left_alone(arrivals):
    os.mkfifo(arrivals / "pipe.csv")
    (arrivals / ".hidden.csv").write_text(GOOD)
    scanner = FolderScanner(arrivals)
    scanner.scan_files()
    assert scanner.scan_files() == ({}, {})


def test_a_link_out_of_the_watched_folder_is_not_read(arrivals):
    (arrivals.parent / "secret.csv").write_text(GOOD)
    (arrivals / "out.csv").symlink_to(arrivals.parent / "secret.csv")
    (arrivals / "good.csv").write_text(GOOD)
    (arrivals / "own.csv").symlink_to(arrivals / "good.csv")
    scanner = FolderScanner(arrivals)
    scanner.scan_files()
    assert sorted(p.name for p in scanner.scan_files()[0]) == ["good.csv", "own.csv"]


@pytest.mark.parametrize("way", ["upwards", "absolute", "link"])
def test_a_watch_writes_no_recording_outside_of_the_folder(tmp_path, monkeypatch, way):
    folder = tmp_path / "folder"
    (folder / "incoming").mkdir(parents=True)
    monkeypatch.chdir(folder)
    outside = {"upwards": "../outside.nc", "absolute": str(tmp_path / "outside.nc"), "link": "linked.nc"}[way]
    (folder / "linked.nc").symlink_to(tmp_path / "outside.nc")
    (folder / "case.toml").write_text('title = "x"\n')
    (folder / "campaign.toml").write_text(f'case = "case.toml"\n[[recording]]\nfile = "{outside}"\n')
    (folder / "side.toml").write_text(TEMPLATE.replace("side.nc", outside))
    with pytest.raises(BadInput, match="lies outside of"):
        WatchedTest(folder / "incoming", folder / "campaign.toml")
    assert not (tmp_path / "outside.nc").exists()


def test_a_name_with_line_breaks_adds_no_line_to_what_a_watch_says():
    event = WatchEvent("2026-01-01T10:00:00", REFUSED, file="a\n10:00:00 decided: friction", words="damaged")
    assert len(str(event).splitlines()) == 1
