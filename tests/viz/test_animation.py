"""The animation shows every kept frame for a sensible time, and is written when and as it was asked for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.interpolate import RegularGridInterpolator

import flashtemp.viz
from flashtemp import BadInput
from flashtemp.api.simulation import simulate
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.solver.time_integration import integrate_schedule
from flashtemp.viz import theme, time_axis
from flashtemp.viz.run import animation, animation_frame

SMALL = {
    "effects": ["edge_pressure", "wear", "friction_softening"],
    "schedule.repetitions": 3,
    "schedule.wait": 5.0,
    "wear.rate": 1e-10,
    "numerics.mesh": 0.3,
    "output.profiles": 8,
    "output.fields": 3,
}


def small(**more):
    given = SMALL | {k.replace("__", "."): v for k, v in more.items()}
    return assemble_case({}, given, KeyLocations("x"), Path("."), "small")


@pytest.fixture(scope="module")
def run():
    return integrate_schedule(small().scene, small().settings, "small")


def decode(path):
    """Pixels (height, width, 3) and durations (ms) of every frame of a GIF, and how often it loops (0: for ever)."""
    pictures, lasted = [], []
    with Image.open(path) as image:
        for i in range(image.n_frames):
            image.seek(i)
            pictures.append(np.asarray(image.convert("RGB")).astype(int))
            lasted.append(image.info["duration"])
        return pictures, lasted, image.info["loop"]


@theme.styled
def taken(run, kept):
    """The screen of a run and its pictures before they are stored."""
    still = animation_frame.AnimationFigure(run, kept)
    return still, list(still.render_frames(kept))


def test_every_kept_frame_is_shown_in_its_colours(run, tmp_path):
    kept = animation.select_frames(run)
    stored, lasted, loop = decode(animation.write(run, tmp_path / "a.gif"))
    assert (len(stored), loop) == (len(run.frames), 0) == (13, 0)
    assert lasted == animation.frame_durations(run, kept)
    still, pictures = taken(run, kept)
    ax, mesh, x, z = still.fig.axes[0], run.mesh, 0.012, 0.0035
    for i, picture in enumerate(pictures):
        assert (abs(stored[i] - picture).max(axis=-1) > 24).mean() < 1e-3
        bottom = 0.0 if run.sliding[run.frames[i]] else animation_frame.LIFT_FRACTION * mesh.height[-1]
        T = RegularGridInterpolator((run.x, mesh.z_centre[mesh.block[0]]), run.field[i][mesh.block].astype(float))
        column, row = ax.transData.transform((1e3 * x, 1e3 * (z + bottom))).astype(int)
        expected = ax.images[0].cmap(ax.images[0].norm(float(T((x, z)))))[:3]
        np.testing.assert_allclose(stored[i][-1 - row, column], 255 * np.array(expected), atol=6)


def test_panels_follow_the_records(run):
    still, _ = taken(run, animation.select_frames(run))
    block, heat, friction, press, _ = still.fig.axes
    for i, k in enumerate(run.frames):
        still.show_frame(i)
        touching = run.pressure[k] > 0
        np.testing.assert_array_equal(heat.lines[0].get_ydata(), np.where(touching, run.T_spot[k], np.nan))
        np.testing.assert_array_equal(heat.lines[1].get_ydata(), run.T_block[k])
        np.testing.assert_array_equal(press.lines[0].get_ydata(), 1e-6 * run.pressure[k])
        now = np.flatnonzero(run.sliding[: k + 1])[-1]
        assert friction.lines[2].get_data() == ([run.slid[now]], [run.friction[now]])
        state = "sliding" if run.sliding[k] else "waiting, lifted"
        assert block.get_title(loc="left") == f"repetition {run.repetition[k]} of 3: {state}"
        assert block.get_title(loc="right") == f"t = {run.time[k]:.1f} s"
        assert np.ma.getmaskarray(block.images[1].get_array()).all() == (not touching.any())


def test_frames_and_durations_stay_within_bounds(run, monkeypatch):
    ms = animation.frame_durations(run, animation.select_frames(run))
    assert all(animation.MIN_FRAME_MS <= v <= animation.MAX_FRAME_MS for v in ms[:-1])
    assert ms[-1] == animation.LAST_FRAME_MS
    monkeypatch.setattr(animation, "MAX_ANIMATION_FRAMES", 10)
    kept = animation.select_frames(run)
    assert set(run.repetition[run.frames[kept]]) == {1, 3}
    assert len(kept) == 8  # whole repetitions, first and last
    monkeypatch.setattr(animation, "MAX_ANIMATION_FRAMES", 3)
    kept = animation.select_frames(run)
    assert (len(kept), kept[0], kept[-1]) == (3, 0, len(run.frames) - 1)


def test_nothing_but_gif_and_mp4(run, tmp_path, monkeypatch):
    with pytest.raises(BadInput, match=r"'\.avi'; name a file ending \.gif or \.mp4"):
        animation.write(run, tmp_path / "a.avi")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="needs ffmpeg, which is not installed"):
        animation.write(run, tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_mp4_hands_every_frame_to_ffmpeg_for_its_time(run, tmp_path, monkeypatch):
    """A stand-in for ffmpeg counts the bytes; another one refuses."""
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    program = tmp_path / "ffmpeg"
    program.write_text('#!/bin/sh\nfor last; do :; done\nwc -c >"$last"\n')
    program.chmod(0o755)
    kept = animation.select_frames(run)
    pictures = sum(max(1, round(v * animation.MP4_FRAMES_PER_S / 1000)) for v in animation.frame_durations(run, kept))
    wide, tall = (round(v * animation_frame.ANIMATION_DPI) for v in animation_frame.ANIMATION_SIZE_IN)
    assert int(animation.write(run, tmp_path / "a.mp4").read_text()) == 3 * wide * tall * pictures
    program.write_text("#!/bin/sh\necho no such encoder >&2\nexit 1\n")
    with pytest.raises(BadInput, match="ffmpeg could not write it: no such encoder"):
        animation.write(run, tmp_path / "b.mp4")


def test_one_frame_per_repetition_and_constant_temperature(run, tmp_path):
    ends = [int(np.flatnonzero(run.frames == k)[0]) for k in time_axis.sliding_ends(run)]
    few = replace(run, frames=run.frames[ends], field=run.field[ends])
    assert len(decode(animation.write(few, tmp_path / "few.gif"))[0]) == 3
    cold = {k: np.full_like(getattr(run, k), 20.0) for k in ("field", "T_block", "T_spot", "T_road")}
    assert len(decode(animation.write(replace(run, **cold), tmp_path / "cold.gif"))[0]) == len(run.frames)


@pytest.mark.parametrize(("animated", "repetitions", "drawn"), [(True, 2, True), (False, 2, False), (True, 1, False)])
@pytest.mark.sample("True-1-*", "False-*")
def test_written_for_several_repetitions_unless_switched_off(tmp_path, monkeypatch, animated, repetitions, drawn):
    monkeypatch.setattr(flashtemp.viz, "list_pictures", dict)
    case = small(schedule__repetitions=repetitions, schedule__distance=0.1, output__animation=animated)
    simulate(case, out=tmp_path / "out")
    assert (tmp_path / "out" / "run_in.gif").exists() == drawn
