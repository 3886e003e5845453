"""Camera files that arrive one after the other grow a recording; half-written, damaged and repeated files do no harm."""

from __future__ import annotations

import numpy as np
import pytest

from flashtemp.camera.importing.arriving_files import FolderScanner
from flashtemp.camera.importing.growing_recording import GrowingRecording, RecordingTemplate
from flashtemp.camera.importing.import_request import expand_patterns
from flashtemp.camera.importing.recording_import import import_recording
from flashtemp.errors import BadInput

PATIENCE = 10.0  # s
BY_RATE = "fps = 2.0\nstart = 0.0\n"  # times follow from the order of the files
BY_TABLE = 'times = "times.csv"\n'
NOISE = np.random.default_rng(5).normal(0.0, 0.1, (12, 6, 9))
HALF = 60  # bytes, cut in the middle of a row


def frame(k: int) -> str:
    return "\n".join(";".join(f"{x:.3f}" for x in row) for row in 30.0 + k + NOISE[k]) + "\n"


class Laboratory:
    """A campaign folder with one template and the folder in which its camera files arrive."""

    def __init__(self, folder, timing: str):
        self.folder, self.arrivals, self.now = folder, folder / "incoming", 0.0
        self.arrivals.mkdir()
        (folder / "times.csv").write_text("file,time\n" + "".join(f"img{k}.csv,{0.5 * k}\n" for k in range(12)))
        (folder / "side.toml").write_text(
            'files = ["incoming/img*.csv"]\nout = "side.nc"\nview = "sidewall"\ndownstream = "right"\n'
            f"pixel = [1, 4]\nmm_per_pixel = 0.5\nrepetition = 1\n{timing}"
        )
        template = RecordingTemplate.from_file(folder / "side.toml", self.arrivals)
        assert template is not None
        self.growing = GrowingRecording(template, folder)
        self.scanner = FolderScanner(self.arrivals.resolve())

    def put(self, k: int, text: str | None = None) -> None:
        (self.arrivals / f"img{k}.csv").write_text(frame(k) if text is None else text)

    def look(self, after: float = 1.0) -> list[tuple[str, str]]:
        """One look into the folder, `after` s: (file, state) of what happened."""
        self.now += after
        self.news = self.growing.take_files(*self.scanner.scan_files(), self.now, PATIENCE)
        return [(n.file.name, n.state) for n in self.news]

    def settle(self) -> list[tuple[str, str]]:
        """Two looks: what has been put there since is then complete."""
        return [*self.look(), *self.look()]

    @property
    def frames(self) -> list[int]:
        """Numbers of the frames in the recording."""
        result = self.growing.result
        return [] if result is None else [round(float(np.mean(T)) - 30.0) for T in result.recording.temperature]


@pytest.fixture(params=[BY_RATE, BY_TABLE], ids=["by rate", "by table"])
def lab(request, tmp_path):
    return Laboratory(tmp_path, request.param)


@pytest.fixture
def rated(tmp_path):
    return Laboratory(tmp_path, BY_RATE)


@pytest.fixture
def tabled(tmp_path):
    return Laboratory(tmp_path, BY_TABLE)


def test_files_that_arrive_one_by_one_make_the_recording_of_all(lab):
    for k in (0, 1, 2, 3):
        lab.put(k)
        assert lab.settle() == [(f"img{k}.csv", "imported")]
    names = expand_patterns([str(lab.arrivals / "img*.csv")])
    whole = import_recording(names, lab.growing.template.facts).recording
    grown = lab.growing.result.recording
    for name in ("temperature", "time", "repetition", "u", "v"):
        np.testing.assert_array_equal(getattr(grown, name), getattr(whole, name))
    assert list(lab.growing.result.file_numbers) == [0, 1, 2, 3]


def test_a_file_is_complete_only_when_two_looks_find_it_alike(lab):
    lab.put(0, frame(0)[:HALF])
    assert lab.look() == []
    lab.put(0, frame(0)[: 2 * HALF])
    assert lab.look() == []
    lab.put(0)
    assert lab.look() == []
    assert lab.look() == [("img0.csv", "imported")]
    assert lab.growing.result.recording.temperature.shape == (1, 6, 9)


def test_an_empty_file_is_never_imported_and_reported_once(lab):
    lab.put(0, "")
    assert [news for _ in range(4) for news in lab.look()] == []
    assert lab.look(PATIENCE) == [("img0.csv", "waiting")]
    assert lab.look(PATIENCE) == []
    assert lab.frames == []


def test_a_writer_that_pauses_in_the_middle_of_a_file_does_no_harm(lab):
    lab.put(0)
    lab.put(1, frame(1)[:HALF])
    assert lab.settle() == [("img0.csv", "imported"), ("img1.csv", "waiting")]
    assert lab.frames == [0]
    lab.put(1)
    assert lab.settle() == [("img1.csv", "imported")]
    assert lab.frames == [0, 1]


def test_a_first_file_cut_between_two_rows_is_replaced_when_it_is_whole(lab):
    lab.put(0, "\n".join(frame(0).splitlines()[:3]) + "\n")
    lab.settle()
    lab.put(0)
    lab.put(1)
    assert ("img0.csv", "imported") in lab.settle()
    assert lab.growing.result.recording.temperature.shape == (2, 6, 9)


def test_a_damaged_file_is_refused_once_after_the_patience_and_taken_when_repaired(lab):
    lab.put(0)
    lab.put(1, "no numbers\n")
    assert lab.settle() == [("img0.csv", "imported"), ("img1.csv", "waiting")]
    assert lab.look(0.5 * PATIENCE) == []
    assert lab.look(0.6 * PATIENCE) == [("img1.csv", "refused")]
    assert "no matrix of numbers" in lab.news[0].reason
    assert "\n" not in lab.news[0].reason
    assert lab.look(PATIENCE) == []
    lab.put(1)
    assert lab.settle() == [("img1.csv", "imported")]
    assert lab.frames == [0, 1]


def test_times_from_the_order_of_files_wait_for_a_damaged_one(rated):
    for k in (0, 2):
        rated.put(k)
    rated.put(1, "no numbers\n")
    rated.settle()
    assert rated.frames == [0]
    rated.put(1)
    rated.settle()
    assert rated.frames == [0, 1, 2]
    assert list(rated.growing.result.recording.time) == [0.0, 0.5, 1.0]


def test_times_from_a_table_do_not_wait_for_a_damaged_file(tabled):
    for k in (0, 2):
        tabled.put(k)
    tabled.put(1, "no numbers\n")
    tabled.settle()
    assert tabled.frames == [0, 2]
    assert list(tabled.growing.result.recording.time) == [0.0, 1.0]


def test_a_file_without_a_time_is_taken_once_the_table_has_it(tabled):
    table = tabled.folder / "times.csv"
    table.write_text("file,time\nimg0.csv,0\n")
    tabled.put(0)
    tabled.put(1)
    assert tabled.settle() == [("img0.csv", "imported"), ("img1.csv", "waiting")]
    assert tabled.look(2 * PATIENCE) == [("img1.csv", "refused")]
    table.write_text("file,time\nimg0.csv,0\nimg1.csv,0.5\n")
    assert tabled.look() == [("img1.csv", "imported")]


def test_a_file_that_arrives_late_takes_its_place(rated):
    for k in (0, 2):
        rated.put(k)
    rated.settle()
    rated.put(1)
    assert rated.settle() == [("img1.csv", "imported")]
    assert rated.frames == [0, 1, 2]


def test_a_copy_of_a_file_is_left_out(lab):
    lab.put(0)
    lab.put(1, frame(0))
    assert lab.settle() == [("img0.csv", "imported"), ("img1.csv", "repeated")]
    assert lab.frames == [0]
    assert lab.look() == []
    lab.put(1)
    assert lab.settle() == [("img1.csv", "imported")]
    assert lab.frames == [0, 1]


def test_a_file_written_again_with_the_same_content_is_no_news(lab):
    lab.put(0)
    lab.settle()
    file = lab.arrivals / "img0.csv"
    file.unlink()
    lab.put(0)
    assert lab.settle() == []
    assert lab.frames == [0]


def test_frames_stay_when_their_file_leaves_the_folder(lab):
    lab.put(0)
    lab.settle()
    (lab.arrivals / "img0.csv").unlink()
    lab.put(1)
    assert lab.settle() == [("img1.csv", "imported")]
    assert lab.frames == [0, 1]


def test_hidden_and_foreign_files_are_not_looked_at(lab):
    (lab.arrivals / ".img0.csv").write_text(frame(0))
    (lab.arrivals / "notes.csv").write_text("no numbers\n")
    (lab.arrivals / "img0.toml").write_text("")
    assert lab.settle() == []


def test_patterns_are_relative_to_the_template_or_to_the_arrivals(lab):
    arrivals = lab.arrivals.resolve()
    assert lab.growing.template.accepts_file(arrivals / "img7.csv")
    assert not lab.growing.template.accepts_file(arrivals / "deep" / "img7.csv")
    assert not lab.growing.template.accepts_file(arrivals / "img7.txt")
    (lab.folder / "other.toml").write_text('files = ["img*.csv"]\nout = "other.nc"\n')
    other = RecordingTemplate.from_file(lab.folder / "other.toml", lab.arrivals)
    assert other.accepts_file(arrivals / "img7.csv")
    assert RecordingTemplate.from_file(lab.folder / "times.csv", lab.arrivals) is None


def test_a_folder_that_is_gone_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="No such file or directory; give the folder"):
        FolderScanner(tmp_path / "none").scan_files()
