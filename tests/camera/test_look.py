"""What is in camera files before anything is known of them, and its picture."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import matplotlib.image as mpimg
import numpy as np
import pytest
from matplotlib.colors import to_rgb

import flashtemp
from flashtemp.__main__ import main
from flashtemp.camera.importing.file_preview import HISTOGRAM_BINS, PREVIEW_FRAMES, _FrameSample, _Histogram
from flashtemp.errors import BadInput
from flashtemp.lab.opened_frames import open_frames
from flashtemp.viz.measurement.raw_images import DEAD_PIXEL_COLOUR, OUT_OF_RANGE_COLOUR, draw, encode_png


def images(folder, count=3, rows=20, columns=30):
    """CSV images, each 1 K warmer than the one before; one pixel never has a value."""
    made = []
    for k in range(count):
        T = 20.0 + k + 0.1 * np.arange(columns) + 0.2 * np.arange(rows)[:, None] ** 1.1
        lines = ["\t".join(f"{v:.4f}" for v in row) for row in T]
        cells = lines[3].split("\t")
        cells[4] = "---"
        lines[3] = "\t".join(cells)
        (folder / f"img{k + 1}.csv").write_text("\n".join(lines) + "\n")
        made.append(T)
    return np.stack(made)


def test_everything_in_the_files_is_told_and_nothing_asked(tmp_path):
    T = images(tmp_path)
    seen = flashtemp.inspect_files(tmp_path)
    known = np.ones(T.shape[1:], bool)
    known[3, 4] = False
    np.testing.assert_allclose(seen.images[:, known], T[:, known], atol=6e-5)
    np.testing.assert_allclose(seen.mean, T[:, known].mean(axis=1), atol=1e-4)
    assert seen.span == pytest.approx((T.min(), T[:, known].max()), abs=1e-4)
    assert seen.counts.sum() == 3 * known.sum()
    assert seen.dead.sum() == 1
    assert "not in the file: --fps and --start" in str(seen)
    assert "3 of 30 x 20 pixels" in str(seen)


def test_dead_pixels_and_those_beyond_the_range_are_told_apart(tmp_path):
    """One never has a value; another has none in the second frame alone."""
    images(tmp_path)
    second = tmp_path / "img2.csv"
    lines = [line.split("\t") for line in second.read_text().splitlines()]
    lines[7][9] = "---"
    second.write_text("\n".join("\t".join(cells) for cells in lines) + "\n")
    seen = open_frames(sorted(tmp_path.glob("*.csv")))
    assert seen.preview.dead[3, 4]
    assert not seen.preview.dead[7, 9]
    assert seen.legend == "cyan: 1 dead in every frame; grey: beyond the camera's range, 1 in all frames together"
    low, high = seen.preview.span
    shown = mpimg.imread(io.BytesIO(encode_png(seen.frames[1], low, high, 1, seen.preview.dead)))[..., :3]
    np.testing.assert_allclose(shown[3, 4], to_rgb(DEAD_PIXEL_COLOUR), atol=3e-3)
    np.testing.assert_allclose(shown[7, 9], to_rgb(OUT_OF_RANGE_COLOUR), atol=3e-3)
    assert not open_frames([tmp_path / "img1.csv"]).preview.dead.any(), "one frame cannot tell"


def test_the_command_draws_and_refuses_to_replace(tmp_path, capsys, monkeypatch):
    images(tmp_path, 8)
    monkeypatch.chdir(tmp_path)
    assert main(["import", "img1.csv", "img2.csv", "--look", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["frames"] == 2
    assert told["picture"] == "img1.csv.look.png"
    assert (tmp_path / "img1.csv.look.png").stat().st_size > 10_000
    assert main(["import", "img1.csv", "--look"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["import", "img1.csv", "--look", "--overwrite"]) == 0
    assert main(["import", "img*.csv", "--look", "--out", "all.jpg"]) == 2
    assert "ends in .png" in capsys.readouterr().err


def test_a_bin_holds_as_many_steps_of_the_file_as_any_other():
    for step, wide in ((0.1, 40.0), (0.01, 3.0), (0.5, 300.0)):
        counted = _Histogram()
        for _ in range(2):
            counted.add(20.0 + step * np.arange(round(wide / step)))
        counts, edges = counted.binned_counts()
        assert len(counts) == len(edges) - 1 <= HISTOGRAM_BINS + 1
        assert counts.sum() == 2 * round(wide / step)
        assert len(set(counts[1:-1])) == 1, "no comb"
        assert edges[0] <= 20.0 < edges[1]
        assert edges[-2] < 20.0 + wide <= edges[-1] + step


def test_a_single_frame_is_no_curve_and_a_difference_no_temperature(tmp_path):
    images(tmp_path, 1)
    seen = flashtemp.inspect_files(tmp_path / "img1.csv")
    assert [ax.get_xlabel() for ax in drawn(seen)] == ["column (px)", "temperature (°C)"]
    small = replace(seen, images=0.01 * seen.images, difference=True)
    axes = drawn(small)
    assert axes[1].get_xlabel() == "difference of temperatures (K)"
    low, high = axes[0].images[0].get_clim()
    assert high - low == pytest.approx(np.nanmax(small.images) - np.nanmin(small.images)), "not a whole degree"
    assert "difference: " in str(small)


def test_counts_are_shown_as_they_are(tmp_path):
    """A 16-bit TIFF, and text of numbers that no temperature has: nothing is asked, and nothing called a temperature."""
    counts = (28000 + 10 * np.arange(600).reshape(20, 30)).astype(np.uint16)
    pytest.importorskip("tifffile").imwrite(tmp_path / "a.tiff", counts)
    (tmp_path / "a.csv").write_text("\n".join("\t".join(map(str, row)) for row in counts) + "\n")
    for file in ("a.tiff", "a.csv"):
        seen = flashtemp.inspect_files(tmp_path / file)
        assert seen.unit == "counts"
        np.testing.assert_array_equal(seen.images[0], counts)
        assert "counts: 28000 to 33990" in str(seen)
        assert "--scale and --offset" in str(seen)
        assert drawn(seen)[1].get_xlabel() == "counts of the camera"
        assert seen.counts.sum() == counts.size
    told = flashtemp.inspect_files(tmp_path / "a.tiff", scale=0.01, offset=-273.15)
    assert told.unit == "degC"
    with pytest.raises(BadInput, match="give --scale and --offset"):
        open_frames([tmp_path / "a.tiff"])


def drawn(look):
    """Axes of a picture but for the colour bar."""
    return [ax for ax in draw(look).axes if ax.get_label() != "<colorbar>"]


def test_frames_that_are_kept_are_spread_over_all():
    kept = _FrameSample()
    for first in range(0, 1000, 7):
        kept.add(np.zeros((min(7, 1000 - first), 2, 2)), first)
    shown, pictures = kept.select_frames()
    assert len(shown) == len(pictures) == PREVIEW_FRAMES
    assert shown[0] == 0
    assert shown[-1] > 900
    assert np.diff(shown).max() < 1.5 * np.diff(shown).min()


def test_what_cannot_be_looked_at_is_told(tmp_path):
    with pytest.raises(BadInput, match="no camera files"):
        flashtemp.inspect_files([])
    images(tmp_path, 1)
    (tmp_path / "small").mkdir()
    images(tmp_path / "small", 1, 12, 20)
    with pytest.raises(BadInput, match="20 x 12 pixels, but img1.csv has 30 x 20; give files of one size"):
        flashtemp.inspect_files([tmp_path / "img1.csv", tmp_path / "small" / "img1.csv"])


def test_values_of_dead_pixels_are_not_counted_as_beyond_the_range_too(tmp_path):
    from scipy.io import savemat

    T = 20.0 + np.arange(4 * 12 * 16).reshape(4, 12, 16) / 100.0
    T[:, 3, 5] = np.nan
    T[2, 7, :3] = np.nan
    savemat(tmp_path / "frames.mat", {"temperature": T.transpose(1, 2, 0)})
    seen = flashtemp.inspect_files(tmp_path / "frames.mat", unit="degC")
    assert (int(seen.dead.sum()), seen.outside) == (1, 3)
    facts = {"view": "sidewall", "downstream": "right", "pixel": (2, 9), "mm_per_pixel": 0.5, "fps": 2.0, "start": 0.0}
    told = flashtemp.import_recording(
        tmp_path / "frames.mat", out=tmp_path / "a.nc", unit="degC", repetition=1, dead_pixels="keep", **facts
    )
    assert any(note.startswith("3 values beyond the camera's range") for note in told.notes)
