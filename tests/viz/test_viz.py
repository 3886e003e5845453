"""Pictures show the run's own numbers, with units, for every kind of run."""

import importlib.util
import pickle
import pkgutil
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from scipy.interpolate import RegularGridInterpolator

import flashtemp.viz
from flashtemp.meshes.mesh import centres
from flashtemp.model.case import assemble_case
from flashtemp.model.case_file import KeyLocations
from flashtemp.solver.time_integration import integrate_schedule
from flashtemp.viz import theme, time_axis
from flashtemp.viz.run import animation, budget, field, friction, profile, run_in_maps, space_time, wear_profile

PICTURES = (profile, space_time, field, friction, budget, run_in_maps, wear_profile, animation)
RUNS = {
    "run_in": {"effects": ["track_memory", "friction_softening"], "schedule.repetitions": 9, "schedule.wait": 10.0},
    "one": {},
    "no_wait": {"schedule.repetitions": 2, "effects": ["holder_sink"]},
    "no_friction": {"friction.mu": 0.0, "schedule.repetitions": 2, "schedule.wait": 5.0},
    "long_waits": {"schedule.speed": 1.0, "schedule.repetitions": 3, "schedule.wait": 4000.0, "schedule.lifted": False},
    "finite_alpha": {"contact.alpha": 5000.0},
    "worn": {"effects": ["edge_pressure", "wear"], "wear.rate": 1e-10, "schedule.repetitions": 3, "schedule.wait": 5.0},
}


def simulate(name):
    small = {"numerics.mesh": 0.3, "output.profiles": 8, "output.fields": 2}
    case = assemble_case({}, small | RUNS[name], KeyLocations("x"), Path("."), name)
    return integrate_schedule(case.scene, case.settings, f"{name}, 0.15 MPa")


@pytest.fixture(scope="module")
def runs():
    return {name: simulate(name) for name in RUNS}


def pixels(fig):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3]


def line(ax, colour, width=0.0):
    """The last line of a colour, at least so wide."""
    found = [i for i in ax.lines if to_hex(i.get_color()) == to_hex(colour) and i.get_linewidth() > width]
    return found[-1]


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("picture", PICTURES, ids=lambda m: m.__name__.rsplit(".", 1)[1])
@pytest.mark.sample("*-worn", "profile-no_friction", "field-no_friction")
def test_every_kind_of_run_is_drawn_with_units_and_without_overlaps(runs, picture, name):
    fig = picture.draw(runs[name])
    image = pixels(fig)
    assert (image < 250).any(axis=2).mean() > 0.01
    shown, _, subject = fig.get_suptitle().replace("\n", " ").partition(", ")
    assert len(shown.split()) >= 2, "a title says what is shown"
    assert subject == f"{name}, 0.15 MPa"
    labels = [text for ax in fig.axes for text in (ax.get_xlabel(), ax.get_ylabel()) if text]
    assert len(labels) >= 2
    assert all("(" in text and ")" in text for text in labels), labels
    no_overlaps(fig)


def no_overlaps(fig):
    """Every text lies within the figure and on no other."""
    renderer = fig.canvas.get_renderer()
    texts = [t for ax in fig.axes for t in (ax.xaxis.label, ax.yaxis.label, ax._left_title, ax._right_title, *ax.texts)]
    ticks = [t for ax in fig.axes for axis in (ax.xaxis, ax.yaxis) for t in visible(axis)]
    boxes = [
        (t.get_text(), t.get_window_extent(renderer)) for t in [*texts, *ticks, fig._suptitle, fig._supxlabel] if t
    ]
    boxes = [(text, box) for text, box in boxes if text.strip()]
    for i, (text, box) in enumerate(boxes):
        assert box.x0 > -1, text
        assert box.y0 > -1, text
        assert box.x1 < fig.bbox.x1 + 1, text
        assert box.y1 < fig.bbox.y1 + 1, text
        for other, obstacle in boxes[i + 1 :]:
            assert not box.overlaps(obstacle), (text, other)


def visible(axis):
    """Labels of an axis' ticks that are drawn."""
    low, high = sorted(axis.get_view_interval())
    ticks = axis.get_major_ticks()
    return [t for k in ticks if low <= k.get_loc() <= high for t in (k.label1, k.label2) if t.get_visible()]


def test_profile_shows_both_curves_of_the_last_repetition(runs):
    run = runs["run_in"]
    ax = profile.draw(run).axes[0]
    for colour, values in ((theme.SPOT_COLOUR, run.T_spot), (theme.BLOCK_COLOUR, run.T_block)):
        drawn = line(ax, colour, 1.0)
        np.testing.assert_array_equal(drawn.get_ydata(), values[run.last_sliding_index])
        np.testing.assert_array_equal(drawn.get_xdata(), 1e3 * run.x)
    faint = [i for i in ax.lines if i.get_linewidth() < 0.7 and len(i.get_xdata())]
    assert len(faint) == 2 * profile.MAX_EARLIER_CURVES
    np.testing.assert_array_equal(faint[0].get_ydata(), run.T_spot[time_axis.sliding_ends(run)[0]])


def test_profile_shows_the_road_where_it_differs_or_is_asked_for(runs):
    def dashed(fig):
        return [i for i in fig.axes[0].lines if i.get_linestyle() == "--"]

    assert not dashed(profile.draw(runs["one"]))
    assert len(dashed(profile.draw(runs["one"], road=True))) == 1
    run = runs["finite_alpha"]
    np.testing.assert_array_equal(dashed(profile.draw(run))[0].get_ydata(), run.T_road[run.last_sliding_index])
    assert not dashed(profile.draw(run, road=False))


def test_map_keeps_the_mean_over_time_and_the_true_times(runs):
    run = runs["one"]
    ax = next(a for a in space_time.draw(run).axes if any(isinstance(c, QuadMesh) for c in a.collections))
    mesh = ax.collections[0]
    corners, drawn = mesh.get_coordinates(), np.asarray(mesh.get_array())
    time, x = corners[0, :, 0], corners[:, 0, 1]
    assert (time[0], x[0], x[-1]) == (0.0, 0.0, pytest.approx(25.0))
    assert time[-1] == pytest.approx(run.time[-1])
    exact = np.trapezoid(run.T_block, run.time, axis=0) / run.time[-1]
    np.testing.assert_allclose(drawn.mean(axis=1), np.interp(0.5e-3 * (x[1:] + x[:-1]), run.x, exact), rtol=1e-9)
    late = np.searchsorted(time, run.time[-2]) - 1
    np.testing.assert_allclose(drawn[-1, late], run.T_block[-2, -1], atol=0.02)
    assert mesh.norm.vmin == run.T_block.min()
    assert mesh.norm.vmax == run.T_block.max()


def test_map_lines_equal_the_records_and_waits_end_where_sliding_starts(runs):
    run = runs["run_in"]
    ax = space_time.draw(run).axes[0]
    drawn = line(ax, theme.PLACE_COLOURS["trailing edge"]).get_ydata()
    np.testing.assert_array_equal(drawn, run.T_block[:, -1])
    bands = time_axis.repetition_axis(run).waits
    assert len(bands) == 8
    assert bands[0] == (35.0, 45.0)


def test_waits_that_would_fill_the_map_are_compressed(runs):
    run = runs["long_waits"]
    when = time_axis.repetition_axis(run)
    assert when.is_compressed
    assert "compressed" in space_time.draw(run).axes[0].get_xlabel()
    columns = when.column_edges(300)
    assert (columns[0], columns[-1]) == (run.time[0], run.time[-1])
    sliding = (np.diff(columns) < 1.0).mean()
    assert sliding == pytest.approx(1 / (1 + time_axis.COMPRESSED_WAIT_FRACTION), abs=0.02)
    assert not time_axis.repetition_axis(runs["run_in"]).is_compressed


def test_field_shows_ends_of_repetitions_and_the_wait(runs):
    run = runs["run_in"]
    frames = field.select_moments(run)
    at = run.frames[list(frames)]
    assert len(frames) == 3
    assert run.time[at[0]] == 35.0
    assert not run.sliding[at[1]]
    assert at[2] == run.last_sliding_index
    assert len(field.select_moments(runs["one"])) == 1
    assert len(field.select_moments(runs["no_wait"])) == 2


def test_field_is_to_scale_above_and_shows_the_cells(runs):
    run = runs["one"]
    above, below = field.draw(run).axes[:2]
    assert above.get_aspect() == 1.0
    assert below.get_yscale() == "function"
    frame = run.field[next(iter(field.select_moments(run)))]
    m = run.mesh
    z_block, z_road = m.z_centre[m.block[0]], m.z_centre[m.road[0]]
    bodies = ((frame[m.road], m.x_centre, z_road), (frame[m.block], run.x, z_block))
    for mesh, (cells, x, z) in zip((c for c in above.collections if isinstance(c, QuadMesh)), bodies, strict=True):
        corners = 1e-3 * mesh.get_coordinates()
        centres = 0.25 * (corners[1:, 1:] + corners[:-1, 1:] + corners[1:, :-1] + corners[:-1, :-1])
        centres[..., 0] = np.clip(centres[..., 0], x[0], x[-1])
        centres[..., 1] = np.clip(centres[..., 1], z[0], z[-1])
        expected = RegularGridInterpolator((x, z), cells.astype(float))(centres)
        np.testing.assert_allclose(np.asarray(mesh.get_array()), expected, atol=1e-4)


def test_friction_shows_every_repetition_and_its_mean(runs):
    run = runs["run_in"]
    fig = friction.draw(run)
    within, mean = fig.axes[:2]
    assert len(within.lines) == 9
    second = run.sliding & (run.repetition == 2)
    np.testing.assert_array_equal(within.lines[1].get_ydata(), run.friction[second])
    assert 0.0 < within.lines[1].get_xdata()[0] < 0.1
    assert within.lines[1].get_xdata()[-1] == pytest.approx(3.5)
    np.testing.assert_array_equal(mean.lines[0].get_ydata(), run.friction_per_repetition)
    assert len(friction.draw(runs["one"]).axes) == 1


def test_budget_stacks_to_the_friction_heat_and_prints_the_imbalance(runs):
    run = runs["no_wait"]
    fig = budget.draw(run)
    over, last = fig.axes
    np.testing.assert_allclose(over.lines[-1].get_ydata(), run.width * run.energy["friction"])
    top = over.collections[-1].get_paths()[0].vertices[:, 1].max()
    assert top == pytest.approx(run.width * run.energy["friction"][-1], rel=1e-3)
    bars = {t.get_text(): p.get_width() for t, p in zip(last.get_yticklabels(), last.patches, strict=True)}
    for name, words in budget.PART_LABELS.items():
        assert bars[words] == pytest.approx(100 * run.budget[name] / run.budget["friction"])
    assert sum(bars.values()) == pytest.approx(100.0, abs=0.1)
    assert f"{run.energy_imbalance:.1e}" in fig.get_supxlabel()


def test_budget_draws_losses_below_zero(runs):
    run = runs["no_wait"]
    gained = {**run.energy, "air": np.linspace(0.0, 500.0, len(run.time))}
    warmed = type(run)(**{k: getattr(run, k) for k in run.__dataclass_fields__} | {"energy": gained})
    fig = budget.draw(warmed)
    pixels(fig)
    assert fig.axes[0].get_ylim()[0] < -500.0 * run.width < 0
    assert fig.axes[1].get_xlim()[0] < 0


def centres_of(image):
    """Centres in m of the columns and rows of an image drawn in mm."""
    left, right, bottom, top = 1e-3 * np.array(image.get_extent())
    rows, columns = image.get_array().shape
    return centres(np.linspace(left, right, columns + 1)), centres(np.linspace(bottom, top, rows + 1))


def panels(run):
    """Axes of the maps in the order in which they are read, down the columns."""
    found = [(ax.get_subplotspec(), ax) for ax in run_in_maps.draw(run).axes if ax.images]
    return [ax for _, ax in sorted(found, key=lambda pair: (pair[0].colspan.start, pair[0].rowspan.start))]


def test_maps_show_the_fields_at_the_end_of_every_repetition(runs):
    run, m = runs["run_in"], runs["run_in"].mesh
    shown, z_block, seen = panels(run), m.z_centre[m.block[0]], []
    assert [ax.get_title(loc="left") for ax in shown] == [f"repetition {r}" for r in range(1, 10)]
    for ax, k in zip(shown, time_axis.sliding_ends(run), strict=True):
        cells = run.field[np.flatnonzero(run.frames == k)[0]].astype(float)
        (x, z), drawn = centres_of(ax.images[0]), [np.asarray(i.get_array()) for i in ax.images]
        grid = np.meshgrid(np.clip(z, z_block[0], z_block[-1]), np.clip(x, run.x[0], run.x[-1]), indexing="ij")
        side = RegularGridInterpolator((z_block, run.x), cells[m.block].T)(np.stack(grid, axis=-1))
        np.testing.assert_allclose(drawn[0], side, atol=1e-4)
        np.testing.assert_allclose(drawn[1][0], np.interp(x, run.x, run.T_spot[k]))
        behind = run.T_wake[k]
        wake = np.interp(centres_of(ax.images[2])[0], m.x_centre[m.last :], behind)
        np.testing.assert_allclose(drawn[2][0], wake, rtol=1e-6)
        hottest = ax.lines[0].get_xdata()[0]
        assert hottest == 1e3 * run.x[np.argmax(run.T_spot[k])]
        assert ax.get_title(loc="right") == f"hottest {run.T_spot[k].max():.1f} {theme.CELSIUS} at {hottest:.1f} mm"
        seen += [*cells[m.block].ravel(), *run.T_spot[k], *behind]
    assert {(i.norm.vmin, i.norm.vmax) for ax in shown for i in ax.images} == {(min(seen), max(seen))}


def test_maps_keep_first_and_last_of_many_and_leave_white_where_nothing_touches(runs, monkeypatch):
    monkeypatch.setattr(run_in_maps, "MAX_PANELS", 3)
    assert [ax.get_title(loc="left") for ax in panels(runs["run_in"])] == [f"repetition {r}" for r in (1, 5, 9)]
    run = runs["worn"]
    lost = run.x > 0.02
    image = panels(replace(run, pressure=np.where(lost, 0.0, run.pressure)))[-1].images[1]
    edge = run.mesh.x[run.mesh.first : run.mesh.last][lost][0]
    np.testing.assert_array_equal(np.ma.getmaskarray(image.get_array())[0], centres_of(image)[0] > edge)
    assert not panels(runs["no_friction"])[0].lines  # no place is the hottest


def test_worn_shows_face_and_pressure_before_and_after_or_is_skipped(runs):
    run = runs["worn"]
    face, press = wear_profile.draw(run).axes
    for k, height, pressure in zip([0, *time_axis.sliding_ends(run)], face.lines, press.lines, strict=True):
        np.testing.assert_array_equal(height.get_ydata(), -1e6 * run.worn[k])
        np.testing.assert_array_equal(pressure.get_ydata(), 1e-6 * run.pressure[k])
    assert run.worn[-1].min() > 0
    assert theme.format_decimal(1e9 * run.worn_volume, 3) in face.get_title(loc="left")
    fresh = replace(run, worn=0.0 * run.worn)
    assert wear_profile.applies(run)
    assert wear_profile.applies(fresh)  # its pressure changed shape
    grown = np.outer(np.linspace(1.0, 3.0, len(run.time)) * run.sliding, run.pressure[0])
    assert not wear_profile.applies(replace(fresh, pressure=grown))
    assert run_in_maps.applies(runs["no_wait"])
    assert not wear_profile.applies(runs["no_wait"])


@pytest.mark.parametrize(("name", "more"), [("one", []), ("worn", ["run_in", "worn"])])
@pytest.mark.sample("one-*")
def test_draw_all_writes_what_applies_and_leaves_matplotlib_alone(runs, tmp_path, name, more):
    import matplotlib

    before = dict(matplotlib.rcParams)
    written = flashtemp.viz.draw_all(runs[name], tmp_path)
    assert sorted(p.stem for p in written) == sorted(["profile", "map", "field", "friction", "budget", *more])
    assert sorted(written) == sorted(tmp_path.iterdir())
    assert all(p.read_bytes().startswith(b"\x89PNG") and p.stat().st_size > 5000 for p in written)
    assert dict(matplotlib.rcParams) == before


def test_a_module_that_declares_a_picture_is_drawn(runs, tmp_path, monkeypatch):
    """One new file and nothing else; one that cannot be imported costs its own picture."""
    added = tmp_path / "package"
    added.mkdir()
    (added / "heat_over_time.py").write_text(
        "from matplotlib.figure import Figure\n"
        'PICTURE = "heat"\n'
        "def applies(run): return run.energy['friction'].any()\n"
        "def draw(run): return Figure()\n"
    )
    (added / "broken_module.py").write_text('import no_such_library\nPICTURE = "broken"\n')
    (added / "helper.py").write_text("raise RuntimeError('a module without a picture is not imported')\n")
    monkeypatch.setattr(flashtemp.viz.run, "__path__", [str(added)])
    found = flashtemp.viz.find_pictures("PICTURE")
    assert found == {"broken_module": "broken", "heat_over_time": "heat"}
    assert not {f"flashtemp.viz.run.{module}" for module in found} & set(sys.modules)
    monkeypatch.setattr(flashtemp.viz, "list_pictures", lambda: found)
    for name in found:
        monkeypatch.setitem(sys.modules, f"flashtemp.viz.run.{name}", None)  # put back afterwards
        del sys.modules[f"flashtemp.viz.run.{name}"]
    (out := tmp_path / "out").mkdir()
    files, missing = flashtemp.viz.draw_each(runs["one"], out, animated=False)
    assert files == [out / "heat.png"]
    assert missing.keys() == {"broken.png"}
    assert "no_such_library" in missing["broken.png"]
    assert flashtemp.viz.draw_each(runs["no_friction"], out, animated=False)[0] == []


def test_pictures_are_not_searched_at_import(monkeypatch):
    spec = importlib.util.spec_from_file_location("flashtemp.viz", flashtemp.viz.__file__)
    monkeypatch.setattr(pkgutil, "iter_modules", lambda path: pytest.fail("searched at import"))
    spec.loader.exec_module(importlib.util.module_from_spec(spec))


def test_pictures_of_a_run_are_found_in_their_modules():
    names = ["profile", "map", "field", "friction", "budget", "run_in", "worn", "width", "spots"]
    assert sorted(flashtemp.viz.list_pictures().values()) == sorted(names)
    assert sorted(flashtemp.viz.list_animations().values()) == ["run_in", "spots"]


def test_a_second_copy_is_refused(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(flashtemp.viz.__file__).parents[1]))
    with pytest.raises(ImportError, match=r"import flashtemp\.viz, not viz"):
        import_module("viz")


@pytest.mark.long
def test_pictures_do_without_pyplot_and_importing_viz_without_matplotlib(runs, tmp_path):
    (tmp_path / "run").write_bytes(pickle.dumps(runs["worn"]))
    code = (
        "import flashtemp.viz, pathlib, pickle, sys\n"
        "assert 'matplotlib' not in sys.modules\n"
        "run = pickle.loads(pathlib.Path('run').read_bytes())\n"
        "flashtemp.viz.draw_all(run, '.')\n"
        "flashtemp.viz.animate(run, '.')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
