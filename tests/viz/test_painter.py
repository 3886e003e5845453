"""Pictures drawn by two processes are those that one draws, whatever becomes of the second."""

from __future__ import annotations

import os
import threading
import time

import pytest

import flashtemp
import flashtemp.viz
from flashtemp.runs.results import processes
from flashtemp.viz import drawing_process

SMALL = {
    "block.height": 0.005, "road.depth": 0.01, "schedule.distance": 0.05, "schedule.repetitions": 2,
    "schedule.wait": 1.0, "numerics.mesh": 0.3, "output.profiles": 6, "output.fields": 3,
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def few():
    """Four pictures are enough."""
    with pytest.MonkeyPatch.context() as patch:
        pictures = {k: flashtemp.viz.list_pictures()[k] for k in ("profile", "friction", "budget")}
        patch.setattr(flashtemp.viz, "list_pictures", lambda: pictures)
        patch.setattr(flashtemp.viz, "list_animations", lambda: {"animation": "run_in"})
        yield


@pytest.fixture(scope="module")
def run():
    return flashtemp.simulate("cases/run_in", SMALL)


@pytest.fixture(scope="module")
def alone(run, tmp_path_factory):
    """What one process draws: {name: bytes}."""
    folder = tmp_path_factory.mktemp("alone")
    _, missing = flashtemp.viz.draw_each(run, folder)
    assert not missing
    return contents(folder)


@pytest.fixture
def two(monkeypatch):
    """A painter whose second process is awake from the first step of a march on."""
    monkeypatch.setattr(drawing_process, "SECOND_PROCESS_AFTER_S", -1.0)
    monkeypatch.setattr(processes, "cores", lambda: 2)
    with drawing_process.PictureDrawer(True) as both:
        both.wrap_watch(None)(None, 1.0)
        yield both


@pytest.fixture
def mine(monkeypatch):
    """What this process draws."""
    drawn, seen = flashtemp.viz.draw_picture, []

    def told(run, folder, picture):
        answer = drawn(run, folder, picture)
        seen.append(picture)
        return answer

    monkeypatch.setattr(flashtemp.viz, "draw_picture", told)
    return seen


def contents(folder) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_both_draw_what_one_draws_to_the_byte(run, alone, two, mine, tmp_path, monkeypatch):
    drawn = flashtemp.viz.draw_picture
    monkeypatch.setattr(flashtemp.viz, "draw_picture", lambda *asked: (drawn(*asked), time.sleep(1.0))[0])
    assert two.draw_pictures(run, tmp_path, True) == {}
    assert contents(tmp_path) == alone
    assert 0 < len(mine) < len(flashtemp.viz.requested_pictures())
    assert len(set(mine)) == len(mine)
    assert not hasattr(os, "getpgid") or os.getpgid(two._second.pid) != os.getpgid(0)  # it does not hear Ctrl-C


@pytest.mark.parametrize("late", [False, pytest.param(True, marks=pytest.mark.long)])
def test_one_draws_all_where_the_second_is_killed(run, alone, two, mine, tmp_path, monkeypatch, late):
    """Before it is asked, or with the last picture in its hands: whatever it left behind is drawn once more."""
    second, tell, drawn = two._second, drawing_process._send_object, flashtemp.viz.draw_picture
    others, asked = len(flashtemp.viz.requested_pictures()) - 1, threading.Event()

    def struck(stream, what):
        if isinstance(what, flashtemp.viz.PictureRequest):
            asked.set()
            while len(mine) < others:
                time.sleep(0.1)
            time.sleep(0.5)  # this process has seen that none is left
            second.kill()
            second.wait()
        tell(stream, what)

    if late:
        monkeypatch.setattr(drawing_process, "_send_object", struck)
        monkeypatch.setattr(flashtemp.viz, "draw_picture", lambda *what: (asked.wait(), drawn(*what))[1])
    else:
        second.kill()
    assert two.draw_pictures(run, tmp_path, True) == {}
    assert alone.items() <= contents(tmp_path).items()
    assert len(mine) == len(flashtemp.viz.requested_pictures())


@pytest.fixture
def asked(monkeypatch):
    """An event: the second process has been asked for a picture."""
    event, tell = threading.Event(), drawing_process._send_object

    def told(stream, what):
        tell(stream, what)
        if isinstance(what, flashtemp.viz.PictureRequest):
            event.set()

    monkeypatch.setattr(drawing_process, "_send_object", told)
    return event


def test_what_the_second_cannot_draw_is_told(run, two, asked, tmp_path, monkeypatch):
    (tmp_path / "run_in.gif").mkdir()  # no file can take this name
    monkeypatch.setattr(flashtemp.viz, "draw_picture", lambda *what: (asked.wait(), ([], {}))[1])
    missing = two.draw_pictures(run, tmp_path, True)
    assert missing.keys() == {"run_in.gif"}
    assert "run_in.gif" in missing["run_in.gif"]


def test_an_interrupt_leaves_nobody_who_draws_into_a_folder_that_gets_another_name(
    run, two, asked, tmp_path, monkeypatch
):
    def stopped(run, folder, picture):
        asked.wait()
        raise KeyboardInterrupt

    monkeypatch.setattr(flashtemp.viz, "draw_picture", stopped)
    with pytest.raises(KeyboardInterrupt):
        two.draw_pictures(run, tmp_path, True)
    assert contents(tmp_path).keys() == {"run_in.gif"}  # the picture that it was at is whole
    two.__exit__()
    assert two._second.poll() is not None


def test_no_second_process_for_a_short_march_or_where_there_is_no_core_for_it(monkeypatch):
    begun = []
    monkeypatch.setattr(drawing_process, "_start_process", lambda: begun.append(True))
    for several, cores, after in ((True, 2, 1e6), (True, 1, -1.0), (False, 2, -1.0)):
        monkeypatch.setattr(processes, "cores", lambda cores=cores: cores)
        monkeypatch.setattr(drawing_process, "SECOND_PROCESS_AFTER_S", after)
        drawing_process.PictureDrawer(several).wrap_watch(None)(None, 1.0)
    assert not begun


def test_a_second_process_that_cannot_load_is_done_without(run, alone, monkeypatch, tmp_path):
    monkeypatch.setattr(drawing_process, "SECOND_PROCESS_AFTER_S", -1.0)
    monkeypatch.setattr(processes, "cores", lambda: 2)
    monkeypatch.setattr(drawing_process, "__name__", "flashtemp.nowhere")
    with drawing_process.PictureDrawer(True) as both:
        both.wrap_watch(None)(None, 1.0)
        both._second.wait()
        assert both.draw_pictures(run, tmp_path, True) == {}
    assert contents(tmp_path) == alone
