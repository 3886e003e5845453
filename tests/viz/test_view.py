"""The view in space: pictures without a screen, with and without VTK's windows."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.image import imread

from flashtemp.__main__ import main
from flashtemp.api.simulation import simulate
from flashtemp.model.case import load_case
from flashtemp.runs.results.vtk import open_fields
from flashtemp.viz.run import view_3d, vtk_window

SMALL = {
    "numerics.mesh": 0.4, "schedule.distance": 0.05, "output.profiles": 4, "output.fields": 2, "output.pictures": False,
}  # fmt: skip


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A result in 2D and one in 3D that leans to y > 0."""
    out = {}
    for name, given in (
        ("flat", {}),
        ("wide", {"numerics.across": 20, "effects": ["pressure_roll"], "pressure_roll.a": 0.8}),
    ):
        file = tmp_path_factory.mktemp(name) / "case.toml"
        file.write_text(f'title = "{name} block"\n')
        out[name] = file.parent / "out"
        simulate(load_case(file, SMALL | given), out=out[name])
    return out


@pytest.mark.parametrize("name", ["flat", "wide"])
@pytest.mark.sample("flat")
def test_screenshot_shows_something(folders, name, tmp_path, capsys, monkeypatch):
    for key in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(key, raising=False)
    file = tmp_path / "seen.png"
    assert main(["view", str(folders[name]), "--screenshot", str(file), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    picture = imread(file)[..., :3]
    assert picture.shape[0] > 300
    colours = len(np.unique((picture * 15).astype(int).reshape(-1, 3), axis=0))
    assert colours > 25, "block and road in many colours on white"
    assert (picture.min(axis=2) > 0.99).mean() > 0.2
    assert told["vtk"] in (True, False)


def test_without_a_window_matplotlib_draws_and_says_what_is_missing(folders, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(vtk_window, "prepare_off_screen", lambda: False)
    file = tmp_path / "plain.png"
    assert main(["view", str(folders["wide"]), "--screenshot", str(file)]) == 0
    assert "libegl1" in capsys.readouterr().err
    assert imread(file).std() > 0.05


def test_a_window_that_ends_the_process_is_survived(monkeypatch):
    monkeypatch.setattr(vtk_window, "TRIAL_CODE", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    assert vtk_window.prepare_off_screen() is False


def test_vtk_is_not_imported_before_its_window_is_chosen():
    code = (
        "import sys, flashtemp.viz.run.vtk_window, flashtemp.viz.run.view_3d\n"
        "print(any(m.startswith('vtk') for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"


def test_parts_are_the_field(folders):
    """Edges in mm, temperatures in place: the warmer side is y > 0, and 2D is drawn out to its width."""
    x, y, z, T = view_3d.read_bodies(open_fields(folders["wide"]), 1.0)["block"]
    assert T.shape == (len(x) - 1, len(y) - 1, len(z) - 1)
    assert (y[0], y[-1]) == pytest.approx((-25.0, 25.0))
    assert T[T.shape[0] // 2, -1, 0] > T[T.shape[0] // 2, 0, 0] + 1.0
    assert T[..., 0].max() > T[..., -1].max() + 1.0
    _, y, z, T = view_3d.read_bodies(open_fields(folders["flat"]), 1.0)["road"]
    assert y.tolist() == [-25.0, 25.0]
    assert -1.5 * view_3d.ROAD_SHOWN_MM < z[0] < -2.0
    assert z[-1] == 0.0
    assert T.shape[2] == len(z) - 1


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--time", "99", "--screenshot", "a.png"], "--time"),
        (["--screenshot", "nowhere/a.png"], "a folder that exists"),
        (["--screenshot", "a.gif"], ".png"),
        ([], "no screen is available"),
    ],
)
def test_bad_wishes_are_told_in_one_line(folders, more, says, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(vtk_window, "has_screen", lambda: False)
    assert main(["view", str(folders["flat"]), *more]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said


def test_a_folder_without_fields(tmp_path, capsys):
    assert main(["view", str(tmp_path)]) == 2
    assert "no fields.vtkhdf" in capsys.readouterr().err


@pytest.fixture(scope="module")
def opened(folders):
    """The window of the wide block, with its slider and its plane, drawn where nobody looks."""
    if not vtk_window.prepare_off_screen():
        pytest.skip("VTK finds no window here")
    import pyvista

    class Hidden(pyvista.Plotter):
        def __init__(self, **given):
            super().__init__(**given | {"off_screen": True, "window_size": [300, 180]})

    fields = open_fields(folders["wide"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pyvista, "Plotter", Hidden)
        plot = view_3d.make_plotter(fields, float(fields.times[0]), off=False)
    yield plot, fields
    plot.close()


def test_in_the_window_the_section_faces_the_eye(opened):
    plot, _ = opened
    _, _, near, far, _, _ = plot.widgets.plane_clipped_meshes[0].bounds
    eye = plot.camera.position[1]
    assert abs(near) < 1e-6 < far, "one half is left"
    assert eye < near, "what lies between the eye and the section is cut away"


def test_the_window_says_what_and_when(opened):
    plot, fields = opened
    assert "wide block" in plot.title
    slider = plot.widgets.slider_widgets[0].GetRepresentation()
    assert (slider.GetMinimumValue(), slider.GetMaximumValue()) == pytest.approx((fields.times[0], fields.times[-1]))
    assert slider.GetTitleText() == "time (s)"
    marks, _ = view_3d.colour_bar_ticks(*view_3d.temperature_limits(fields, float(fields.times[0])))
    assert plot.scalar_bar.GetNumberOfLabels() == len(marks)
    assert plot.scalar_bar.GetLookupTable().GetTableRange() == pytest.approx((marks[0], marks[-1]))
    shown = [actor.GetText(vtk_corner) for actor in plot.actors.values() if hasattr(actor, "GetText")
             for vtk_corner in range(8)]  # fmt: skip
    assert view_3d.KEY_HELP in shown


def test_arrow_keys_step_through_the_kept_fields(opened):
    plot, fields = opened
    cold = np.asarray(plot.screenshot(return_img=True), float)
    plot.iren.interactor.SetKeySym("Right")
    plot.iren.interactor.InvokeEvent("KeyPressEvent")
    assert plot.widgets.slider_widgets[0].GetRepresentation().GetValue() == pytest.approx(fields.times[1])
    warm = np.asarray(plot.screenshot(return_img=True), float)
    section = np.s_[int(0.45 * len(cold)) : int(0.60 * len(cold)), 100:180]  # of the block, and the road before it
    assert warm[section].mean() > cold[section].mean() + 10, "it warms"


@pytest.mark.parametrize(("low", "high"), [(20.0, 47.6), (20.0, 21.0), (19.94, 20.9), (-10.3, 214.0), (35.0, 583.0)])
def test_the_colour_bar_has_round_numbers_from_end_to_end(low, high):
    marks, form = view_3d.colour_bar_ticks(low, high)
    step = marks[1] - marks[0]
    assert 4 <= len(marks) <= 8
    assert marks[0] <= low
    assert marks[-1] >= high
    assert high - low > (len(marks) - 3) * step, "no more colours than are needed"
    np.testing.assert_allclose(np.diff(marks), step)
    np.testing.assert_allclose([float(form % m) for m in marks], marks, atol=1e-9)
    assert np.any(np.isclose(step / 10.0 ** np.floor(np.log10(step) + 1e-9), [1, 2, 2.5, 5]))
