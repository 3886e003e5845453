"""Pictures of measured against computed show the comparison's own numbers, in shared colours, with honest bands."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb

from flashtemp.camera.recording import Recording
from flashtemp.comparison.campaign import Campaign, LoadCellEntry, RecordingEntry
from flashtemp.comparison.compare import Comparison, ForceComparison, RecordingComparison
from flashtemp.comparison.noise import NoiseLevels, lag1_autocorrelation, largest_structured_residual
from flashtemp.comparison.noise_whitening import whiten_residual
from flashtemp.viz import theme
from flashtemp.viz.measurement import comparison as draw
from flashtemp.viz.measurement import residual_plots

TIME = np.array([1.0, 2.0, 4.0, 8.0, 9.0, 11.0])
REPETITION = np.array([1, 1, 1, 1, 2, 2])
DEAD = (2, 3)  # v, u
RUN = SimpleNamespace(
    direction=None,
    time=np.array([0.0, 2.0, 4.0, 4.5, 8.0, 8.1, 11.0]),
    sliding=np.array([True, True, True, False, False, True, True]),
    repetition=np.array([1, 1, 1, 1, 1, 2, 2]),
    energy_imbalance=1e-15,
)  # slides 0 to 4 s, waits to 8 s, slides to 11 s


def seeing(view="sidewall", level=None, extra=0.0, file="side.nc", seed=1, **given):
    """A comparison made by hand: noise, one dead pixel, an outer column not compared, `extra` K in the fifth frame."""
    level = level or NoiseLevels(0.05, 0.02, ("pattern",))
    nv = {"sidewall": 9, "wake": 14, "profile": 1}[view]
    rng, shape = np.random.default_rng(seed), (len(TIME), nv, 20)
    u = 1e-3 * np.arange(20) + (0.0265 if view == "wake" else 0.0005)
    v = 1e-3 * (np.arange(nv) - (nv // 2 if view == "wake" else 0))
    predicted = 20.0 + TIME[:, None, None] + np.exp(-u / 0.01) * np.ones(shape)
    off = level.white * rng.normal(size=shape) + level.pattern * rng.normal(size=shape[1:])
    off[4, : min(nv, 5), 8:14] += extra
    measured = predicted + off
    measured[:, DEAD[0] % nv, DEAD[1]] = np.nan
    recording = Recording(view, measured, TIME, REPETITION, u, v if view != "profile" else np.zeros(1))
    residual = measured - predicted
    residual[:, :, 0] = np.nan
    sigmas = whiten_residual(residual, level)
    good = np.isfinite(residual)
    return RecordingComparison(
        view=RecordingEntry(file, recording, given, 0.05),
        predicted=predicted,
        residual=residual,
        sigmas=sigmas,
        noise=level,
        shift=(0.1, -0.2),
        shift_refused=None,
        shift_error=(0.01, 0.02),
        rmse_K=float(np.sqrt(np.mean(residual[good] ** 2))),
        bias_K=float(np.mean(residual[good])),
        chi2_per_dof=float(np.mean(sigmas[good] ** 2)),
        pixels=int(good.sum()),
        largest=largest_structured_residual(residual, level, recording),
        correlation={name: lag1_autocorrelation(sigmas, axis) for axis, name in ((2, "u"), (1, "v"), (0, "time"))},
    )


def pulling(bias=0.0, file="mu.csv"):
    """A load-cell trace by hand: it reads through a wait from 4 to 8 s, where nothing is compared."""
    time = np.linspace(0.0, 11.0, 111)
    predicted = 0.9 - 0.01 * np.sqrt(time)
    off = np.where((time > 4.05) & (time < 7.95), np.nan, bias + 0.005 * np.random.default_rng(2).normal(size=111))
    mu = np.where(np.isfinite(off), predicted + off, 0.0)
    return ForceComparison(
        LoadCellEntry(file, tuple(time), tuple(mu), {}, 0.005), predicted, off, 0.005, float(np.sqrt(np.nanmean(off**2))),
        float(np.nanmean(off)), float(np.nanmean((off / 0.005) ** 2)), {"time": (0.01, 0.1)},
    )  # fmt: skip


def comparison(seeings, pullings, title="two loads", runs=()):
    views, forces = tuple(s.view for s in seeings), tuple(p.force for p in pullings)
    campaign = Campaign(title, Path("case.toml"), (), views, forces, Path("."))
    return Comparison(campaign, tuple(seeings), tuple(pullings), tuple(runs))


def render(fig):
    """Draw a figure, every text inside it; the pixels (rows, columns, 3)."""
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    renderer = canvas.get_renderer()
    texts = [t for ax in fig.axes for t in (ax.xaxis.label, ax.yaxis.label, ax._left_title, *ax.texts)]
    for text in [*texts, fig._suptitle, fig._supxlabel]:
        if text and text.get_text():
            box = text.get_window_extent(renderer)
            assert min(box.x0, box.y0) > -2, text
            assert max(box.x1 - fig.bbox.x1, box.y1 - fig.bbox.y1) < 2, text
    return np.asarray(canvas.buffer_rgba())[..., :3]


def rows(fig, count):
    """Axes of the images, (rows, measured, computed, difference, sigma)."""
    return np.array([ax for ax in fig.axes if ax.images and ax.get_aspect() == 1.0]).reshape(count, 4)


def dots(ax, colour):
    found = [i for i in ax.lines if i.get_marker() == "o" and to_hex(i.get_color()) == to_hex(colour)]
    return np.concatenate([i.get_xydata() for i in found])


def band(ax):
    """x and half width of the band of noise."""
    vertices = ax.collections[0].get_paths()[0].vertices
    x = np.unique(vertices[:, 0])
    upper = np.array([vertices[vertices[:, 0] == i, 1].max() for i in x])
    np.testing.assert_allclose(upper, [-vertices[vertices[:, 0] == i, 1].min() for i in x])
    return x, upper


# --- images -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("view", ["sidewall", "wake"])
def test_images_are_those_of_the_comparison_and_masked_where_nothing_is_compared(view):
    s = seeing(view, extra=1.0)
    fig = draw.draw_images(s, RUN)
    shown = [2, 4, 5]  # end of sliding of both repetitions, and the largest difference
    assert list(draw.choose_frames(s, RUN)) == shown
    for k, axes in zip(shown, rows(fig, 3), strict=True):
        wanted = s.view.recording.temperature[k], s.predicted[k], s.residual[k], s.sigma_residual[k]
        hidden = np.isnan(s.residual[k])
        assert hidden[DEAD]
        assert hidden[:, 0].all()
        for ax, values in zip(axes, wanted, strict=True):
            drawn = ax.images[0].get_array()
            np.testing.assert_array_equal(np.ma.getmaskarray(drawn), hidden)
            np.testing.assert_array_equal(drawn.compressed(), values[~hidden])
            pitch, rec = 0.5, s.view.recording
            wanted_mm = [
                1e3 * rec.u[0] - pitch,
                1e3 * rec.u[-1] + pitch,
                1e3 * rec.v[0] - pitch,
                1e3 * rec.v[-1] + pitch,
            ]
            np.testing.assert_allclose(ax.images[0].get_extent(), wanted_mm)
            assert ax.images[0].origin == "lower"
    render(fig)
    assert rows(fig, 3)[0, 0].get_ylabel() == ("z (mm)" if view == "sidewall" else "y (mm)")


def test_measured_and_computed_share_colours_and_differences_are_centred():
    s = seeing(extra=1.0)
    shown = rows(draw.draw_images(s, RUN), 3)
    heat = {(ax.images[0].norm.vmin, ax.images[0].norm.vmax, ax.images[0].cmap.name) for ax in shown[:, :2].ravel()}
    assert len(heat) == 1
    low, high, _ = heat.pop()
    assert low <= np.nanmin(s.predicted[[2, 4, 5]][:, :, 1:])
    assert high >= np.nanmax(s.predicted[[2, 4, 5]][:, :, 1:])
    kelvin = {(ax.images[0].norm.vmin, ax.images[0].norm.vmax) for ax in shown[:, 2]}
    (limits,) = kelvin
    assert -limits[0] == limits[1] >= abs(s.largest.K)
    assert {(ax.images[0].norm.vmin, ax.images[0].norm.vmax) for ax in shown[:, 3]} == {
        (-draw.MAX_COLOUR_SIGMA, draw.MAX_COLOUR_SIGMA)
    }


def test_a_wild_pixel_does_not_take_the_colours():
    s = seeing("wake")
    wild = s.view.recording.temperature.copy()
    wild[5, 7, 7] = 500.0
    wild = replace(s, view=replace(s.view, recording=replace(s.view.recording, temperature=wild)))
    assert rows(draw.draw_images(wild, RUN), len(draw.choose_frames(wild, RUN)))[0, 0].images[0].norm.vmax < 40.0


def test_dead_pixels_are_grey_on_the_page():
    s = seeing()
    fig = draw.draw_images(s, RUN)
    page = render(fig)
    r = s.view.recording
    for ax in rows(fig, len(draw.choose_frames(s, RUN))).ravel():
        column, row = ax.transData.transform((1e3 * r.u[DEAD[1]], 1e3 * r.v[DEAD[0]]))
        colour = page[len(page) - 1 - round(row), round(column)] / 255
        np.testing.assert_allclose(colour, to_rgb(draw.MASKED_COLOUR), atol=0.01)


def test_the_square_marks_the_largest_difference_in_its_frame_only():
    s = seeing(extra=1.0)
    shown = rows(draw.draw_images(s, RUN), 3)
    assert [[len(ax.patches) for ax in line] for line in shown] == [[0] * 4, [0, 0, 1, 1], [0] * 4]
    square = shown[1, 2].patches[0]
    middle = square.get_x() + square.get_width() / 2, square.get_y() + square.get_height() / 2
    np.testing.assert_allclose(middle, (1e3 * s.largest.u, 1e3 * s.largest.v))
    assert square.get_width() == pytest.approx(5.0)


def test_without_the_run_the_hottest_frames_are_shown():
    s = seeing(extra=1.0)
    assert list(draw.choose_frames(s)) == [3, 4, 5]  # 8 s is a wait, but nobody says so
    assert draw.choose_frames(replace(s, largest=None)) == {3: "hottest frame", 5: "hottest frame"}
    assert draw.choose_frames(s, RUN)[2] == "last frame of sliding"


def test_a_profile_is_drawn_as_lines_with_the_noise_of_one_pixel():
    s = seeing("profile", extra=1.0)
    fig = draw.draw_images(s, RUN)
    render(fig)
    above, below = np.array(fig.axes).reshape(2, 3)
    for k, curves, off in zip((2, 4, 5), above, below, strict=True):
        measured, computed = (i.get_ydata() for i in curves.lines)
        np.testing.assert_array_equal(computed, s.predicted[k, 0])
        good = np.isfinite(s.residual[k, 0])
        np.testing.assert_array_equal(measured[good], s.view.recording.temperature[k, 0][good])
        assert np.isnan(measured[~good]).all()
        np.testing.assert_allclose(band(off)[1], 2.0 * np.hypot(0.05, 0.02))
    assert {ax.get_ylim() for ax in below} == {below[0].get_ylim()}
    assert below[0].get_ylim()[1] > np.nanmax(s.residual)


# --- means and their bands --------------------------------------------------------------------------
@pytest.mark.parametrize("kept", [0, 1, 2, None])
def test_the_standard_error_of_a_mean_is_that_of_simulated_noise(kept):
    rng, level = np.random.default_rng(0), NoiseLevels(0.05, 0.04)
    gone = rng.random((6, 4, 5)) < 0.2
    means = []
    for _ in range(1500):
        noise = level.white * rng.normal(size=(6, 4, 5)) + level.pattern * rng.normal(size=(4, 5))
        values, error = residual_plots.mean_residual(np.where(gone, np.nan, noise), level, kept)
        means.append(values)
    np.testing.assert_allclose(np.std(means, axis=0), error, rtol=0.08)


def test_means_are_drawn_with_twice_their_error_and_red_beyond():
    s = seeing("wake", NoiseLevels(0.05, 0.0), extra=1.0)
    fig = draw.draw_mean_residuals(s, RUN)
    render(fig)
    x, z, time, repetition = fig.axes
    for ax, kept, at in ((x, 2, 1e3 * s.view.recording.u), (z, 1, 1e3 * s.view.recording.v), (time, 0, TIME)):
        others = tuple(a for a in range(3) if a != kept)
        n = np.isfinite(s.residual).sum(axis=others)
        values, some = np.nansum(s.residual, axis=others) / np.maximum(n, 1), n > 0
        edge, half = band(ax)
        np.testing.assert_allclose(edge[1:-1], at[some])
        np.testing.assert_allclose(half[1:-1], 2 * 0.05 / np.sqrt(n[some]))
        out = some & (np.abs(values) > 2 * 0.05 / np.sqrt(np.maximum(n, 1)))
        np.testing.assert_allclose(dots(ax, residual_plots.BEYOND_COLOUR), np.stack([at[out], values[out]], axis=1))
        assert f"{out.sum()} of {some.sum()} beyond noise" in ax.get_title(loc="left")
    second = s.residual[4:]
    assert dots(repetition, residual_plots.BEYOND_COLOUR)[-1].tolist() == pytest.approx([2, np.nanmean(second)])
    np.testing.assert_allclose(band(repetition)[1][-1], 2 * 0.05 / np.sqrt(np.isfinite(second).sum()))


def test_white_noise_stays_in_the_band():
    inside = []
    for seed in range(6):
        fig = draw.draw_mean_residuals(seeing("wake", NoiseLevels(0.05, 0.03), seed=seed))
        inside += [
            (len(dots(ax, residual_plots.BEYOND_COLOUR)), len(dots(ax, theme.AMBIENT_COLOUR))) for ax in fig.axes[:2]
        ]
    out, within = np.sum(inside, axis=0)
    assert 0.01 < out / (out + within) < 0.12


def test_waits_are_shaded_and_a_profile_has_no_second_direction():
    fig = draw.draw_mean_residuals(seeing("profile"), RUN)
    render(fig)
    assert len(fig.axes) == 3
    wait = fig.axes[1].patches[0]
    assert (wait.get_x(), wait.get_x() + wait.get_width()) == (4.0, 8.0)
    labels = [ax.get_xlabel() for ax in fig.axes] + [fig.get_supylabel()]
    assert all("(" in text and ")" in text for text in labels), labels
    assert not draw.draw_mean_residuals(seeing("profile")).axes[1].patches


# --- friction and overview --------------------------------------------------------------------------
def test_friction_is_drawn_over_the_time_slid_without_waits():
    p = pulling(bias=0.02)
    fig = draw.draw_friction(p)
    render(fig)
    above, below = fig.axes
    on = np.isfinite(p.residual)
    seen = dots(above, residual_plots.MEASURED_COLOUR)
    np.testing.assert_array_equal(seen[:, 1], np.array(p.force.mu)[on])
    np.testing.assert_allclose(np.diff(seen[:, 0]), 0.1)
    computed = [i.get_ydata() for i in above.lines if to_hex(i.get_color()) == to_hex(residual_plots.COMPUTED_COLOUR)]
    assert len(computed) == 2  # one piece per repetition
    np.testing.assert_array_equal(np.concatenate(computed), p.predicted[on])
    red, grey = dots(below, residual_plots.BEYOND_COLOUR), dots(below, theme.AMBIENT_COLOUR)
    assert len(red) == (np.abs(p.residual[on]) > 0.01).sum()
    assert len(red) + len(grey) == on.sum()
    assert below.patches[0].get_height() == pytest.approx(0.02)


def test_overview_holds_every_number():
    s, p = [seeing(extra=1.0), seeing("wake", file="wake.nc")], [pulling(0.02)]
    s[1] = replace(s[1], view=replace(s[1].view, held_out=True))
    fig = draw.draw_summary(comparison(s, p))
    render(fig)
    left, right, low_left, _ = fig.axes
    drawn = {i.get_label(): i.get_xdata() for i in left.lines}
    assert drawn["RMSE"].tolist() == [i.rmse_K for i in s]
    assert drawn["bias"].tolist() == [i.bias_K for i in s]
    assert drawn["noise of one value"] == pytest.approx([np.hypot(0.05, 0.02)] * 2)
    assert [t.get_text() for t in left.get_yticklabels()] == ["side.nc", "wake.nc (held out)"]
    assert right.lines[-1].get_xdata().tolist() == [i.chi2_per_dof for i in s]
    assert {i.get_label(): i.get_xdata() for i in low_left.lines}["RMSE"].tolist() == [p[0].rmse]
    assert len(draw.draw_summary(comparison([], p)).axes) == 2
    assert "(K)" in draw.draw_summary(comparison(s, [])).axes[0].get_xlabel()


def test_odd_names_and_empty_comparisons_are_drawn():
    s = seeing(file="price_$5_$x^.nc", **{"contact.pressure": 1.5e5, "schedule.speed": "speed.csv"})
    assert "contact pressure 0.15 MPa, speed speed.csv" in draw.draw_images(s)._suptitle.get_text()
    render(draw.draw_mean_residuals(s))
    nothing = np.full_like(s.residual, np.nan)
    empty = replace(s, residual=nothing, sigmas=nothing, largest=None)
    render(draw.draw_images(empty))
    render(draw.draw_mean_residuals(empty))
    p = pulling()
    render(draw.draw_friction(replace(p, residual=np.full_like(p.residual, np.nan))))
