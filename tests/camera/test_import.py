"""Camera files become a recording: place, time, repetition, masks, template, command line, what is asked for."""

from __future__ import annotations

import json
import re
import tomllib

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.camera import recording
from flashtemp.camera.importing import import_options, pixel_masks, recording_import, rectification
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.camera.importing.import_request import expand_patterns
from flashtemp.camera.radiometry import ObjectParameters, PlanckCalibration, recompute_temperature
from flashtemp.errors import BadInput

ROWS, COLUMNS, PITCH = 30, 50, 0.5  # mm per pixel
HERE = ImportOptions(
    view="sidewall", downstream="right", pixel=(5.0, 24.0), mm_per_pixel=PITCH, start=0.0, repetition=1
)


def field(u, v, t=0.0):
    """Temperature, degC, at u, v in mm: smooth, without any symmetry."""
    return 30.0 + t + 20.0 * np.exp(-(((u - 12.0) / 9.0) ** 2) - ((v - 3.0) / 7.0) ** 2) + 0.2 * u


def seen(M, t=0.0, shape=(ROWS, COLUMNS)):
    """The image (rows, columns) that a camera with the map M (m) takes of the field."""
    columns, rows = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    at = rectification.apply_homography(M, np.column_stack([columns.ravel(), rows.ravel()])).reshape(*shape, 2)
    return field(1e3 * at[..., 0], 1e3 * at[..., 1], t)


def straight(turn=("right", "up"), pixel=(5.0, 24.0)):
    return rectification.map_from_scale(rectification.image_axes(*turn), pixel, (0.0, 0.0), (PITCH, PITCH))


def write(path, image, clock=""):
    lines = [f"Date: {clock}"] if clock else []
    path.write_text("\n".join([*lines, *("\t".join(f"{x:.4f}" for x in row) for row in image)]))
    return path


@pytest.fixture
def image(tmp_path):
    return write(tmp_path / "a.csv", seen(straight()))


def made(names, **said):
    return recording_import.import_recording(list(names), ImportOptions(**said).merged_over(HERE)).recording


def off(r, t=0.0) -> float:
    """Largest difference from the field where both are known, K."""
    wanted = field(1e3 * r.u, 1e3 * r.v[:, None], t)
    return float(np.nanmax(np.abs(r.temperature - wanted)))


def test_an_image_that_lies_beside_the_block_is_refused(image):
    for pixel, said in (((500.0, 24.0), "u = -250 to"), ((5.0, -90.0), "v = -59")):
        with pytest.raises(BadInput, match=f"{said}.*no pixel is on it; give --pixel"):
            made([image], pixel=pixel, block=(25.0, 7.0))
    assert made([image], block=(25.0, 7.0)).frames == 1


TURNS = [(d, u) for d in ("left", "right") for u in ("up", "down")] + [
    (d, u) for d in ("up", "down") for u in ("left", "right")
]


@pytest.mark.parametrize("turn", TURNS, ids="-".join)
def test_every_orientation(tmp_path, turn):
    path = write(tmp_path / "a.csv", seen(straight(turn, (20.0, 12.0))))
    r = made([path], downstream=turn[0], up=turn[1], pixel=(20.0, 12.0))
    assert off(r) < 1e-4
    assert r.pitch == pytest.approx((5e-4, 5e-4))
    assert np.count_nonzero(np.isnan(r.temperature)) == 0


def test_leading_edge_is_where_it_was_marked(image):
    r = made([image])
    assert (r.u[5], r.v[ROWS - 1 - 24]) == pytest.approx((0, 0), abs=1e-15)
    assert made([image], at=(10.0, 2.0)).u[5] == pytest.approx(0.010)


def test_second_point(image):
    r = made([image], mm_per_pixel=None, second=(45.0, 24.0, 20.0, 0.0))
    assert off(r) < 1e-4
    with pytest.raises(BadInput, match=r"second.*180 degrees.*give"):
        made([image], second=(45.0, 24.0, -20.0, 0.0))
    with pytest.raises(BadInput, match="second.*first point"):
        made([image], second=(5.0, 24.0, 20.0, 0.0))


def test_second_point_of_a_tilted_image(tmp_path):
    slope = np.radians(6.0)
    M = 1e-3 * PITCH * np.array([[np.cos(slope), -np.sin(slope)], [-np.sin(slope), -np.cos(slope)]])
    M = np.block([[M, -(M @ [[5.0], [24.0]])], [np.zeros((1, 2)), np.ones((1, 1))]])
    path = write(tmp_path / "a.csv", seen(M))
    u, v = 1e3 * rectification.apply_homography(M, np.array([[45.0, 15.0]]))[0]
    r = made([path], mm_per_pixel=None, second=(45.0, 15.0, u, v))
    assert off(r) < 0.05
    assert 0.3 < np.isfinite(r.temperature).mean() < 1


SLANTED = 1e-3 * np.array([[0.5, 0.04, -3.5], [-0.03, -0.5, 12.2], [0.0, 0.0, 1e3]])
SLANTED = np.array([[1, 0, 0], [0, 1, 0], [2.0, -1.5, 1.0]]) @ SLANTED


def points(M, pixels=((4, 26), (46, 25), (44, 4), (6, 3))):
    places = 1e3 * rectification.apply_homography(M, np.array(pixels, float))
    return tuple((*map(float, p), *map(float, at)) for p, at in zip(pixels, places, strict=True))


def test_four_points_of_a_slanted_view(tmp_path):
    path = write(tmp_path / "a.csv", seen(SLANTED))
    r = made([path], point=points(SLANTED), mm_per_pixel=None, crop=(0.0, 18.0, 1.0, 9.0))
    assert off(r) < 0.05
    assert np.isfinite(r.temperature).all()
    assert r.v[0] == pytest.approx(1e-3)
    finer = made([path], point=points(SLANTED), mm_per_pixel=0.25, crop=(0.0, 18.0, 1.0, 9.0))
    assert finer.pitch == pytest.approx((2.5e-4, 2.5e-4))
    assert off(finer) < 0.05


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (points(SLANTED)[:3], "at least four"),
        (tuple((c, 5.0, c * 0.5, 1.0) for c in (1.0, 5.0, 9.0, 12.0)), "line"),
        ((*points(SLANTED), (20.0, 10.0, 90.0, 90.0)), "px off"),
    ],
)
def test_points_that_fit_no_plane(image, given, says):
    with pytest.raises(BadInput, match=says):
        made([image], point=given)


def test_a_dead_pixel_does_not_spread_far(tmp_path):
    picture = seen(SLANTED)
    picture[12, 20] = 200.0
    path = write(tmp_path / "a.csv", picture)
    r = made([path], point=points(SLANTED), mm_per_pixel=None, crop=(0.0, 18.0, 1.0, 9.0))
    assert 1 <= np.isnan(r.temperature).sum() <= 9
    assert off(r) < 0.3


def test_crop(image):
    r = made([image], crop=(0.0, 10.0, 1.0, 5.0))
    assert (r.u[0], r.u[-1], r.v[0], r.v[-1]) == pytest.approx((0, 0.010, 0.001, 0.005))
    assert off(r) < 1e-4
    with pytest.raises(BadInput, match=r"crop.*spans.*-2\.5, 22"):
        made([image], crop=(50.0, 60.0, 0.0, 1.0))


def test_masks(tmp_path, image):
    mask = np.zeros((ROWS, COLUMNS))
    mask[3, 7] = 1
    r = made([image], mask_box=((0, 0, 4, 2),), mask=write(tmp_path / "mask.csv", mask))
    lost = np.isnan(r.temperature[0])[::-1]
    assert lost.sum() == 16
    assert lost[:3, :5].all()
    assert lost[3, 7]
    with pytest.raises(BadInput, match="mask-box.*50 x 30"):
        made([image], mask_box=((0, 0, 50, 2),))
    with pytest.raises(BadInput, match="mask.*shape"):
        made([image], mask=write(tmp_path / "small.csv", mask[:9, :9]))


def test_dead_pixels_are_found_and_edges_kept():
    """A block's edge, a hot spot, a bright line and noise pass; single pixels and pairs that stick do not."""
    chance = np.random.default_rng(3)
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    T = (
        field(u / 6, v / 6)
        - 25.0 * (v > 80)
        + 15.0 * ((np.abs(v - u / 2) < 1) & (u > 20))
        + 0.05 * chance.standard_normal(u.shape)
    )
    assert pixel_masks.find_dead_pixels(T[None]).sum() == 0
    lone = np.zeros(T.shape, bool)
    lone[10:40:12, 90:150:9] = True
    lone[20, 120:122] = True
    found = pixel_masks.find_dead_pixels(np.where(lone, T + 4.0 * (-1) ** u, T)[None])
    assert np.array_equal(found, lone)


def test_dead_pixels_can_be_kept(tmp_path):
    picture = seen(straight())
    picture[12, 20] = 90.0
    path = write(tmp_path / "a.csv", picture)
    assert np.isnan(made([path]).temperature).sum() == 1
    assert np.isnan(made([path], dead_pixels="keep").temperature).sum() == 0


def series(tmp_path, clocks=("12:00:03.0", "12:00:03.5", "12:00:05.0")):
    return [
        write(tmp_path / f"i{k}.csv", seen(straight(), t=k), f"2024-05-31 {c}" if c else "")
        for k, c in enumerate(clocks)
    ]


def test_time_stamps(tmp_path):
    names = series(tmp_path)
    assert made(names, start=2.0).time == pytest.approx([2.0, 2.5, 4.0])
    zero = recording_import.import_recording(
        names, ImportOptions(**{**vars(HERE), "start": None, "zero": "2024-05-31T12:00:01"})
    ).recording
    assert zero.time == pytest.approx([2.0, 2.5, 4.0])
    assert made(names, fps=10.0).time == pytest.approx([0.0, 0.1, 0.2])
    back = made(names[::-1], start=2.0)
    assert back.time == pytest.approx([2.0, 2.5, 4.0])
    assert back.temperature[2].mean() - back.temperature[0].mean() == pytest.approx(2.0)
    assert made(names, every=2, fps=10.0).time == pytest.approx([0.0, 0.2])


def test_repetitions(tmp_path):
    names = series(tmp_path)
    assert made(names, repetition=3).repetition.tolist() == [3, 3, 3]
    free = ImportOptions(**{**vars(HERE), "repetition": None})
    starts = recording_import.import_recording(names, ImportOptions(starts=(0.0, 0.5, 1.8)).merged_over(free)).recording
    assert starts.repetition.tolist() == [1, 2, 3]
    case = tmp_path / "case.toml"
    case.write_text("[schedule]\nspeed = 0.1\ndistance = 0.1\nrepetitions = 3\nwait = 0.2\n")
    result = recording_import.import_recording(names, ImportOptions(case=case).merged_over(free))
    assert result.recording.repetition.tolist() == [1, 1, 2]
    assert result.block[0] > 0.01


def test_times_of_a_file(tmp_path):
    names, times = series(tmp_path, ("", "", "")), tmp_path / "t.csv"
    times.write_text("file,time,repetition\ni0.csv,1.5,1\ni1.csv,2.5,1\ni2.csv,12,2\n")
    r = recording_import.import_recording(
        names, ImportOptions(**{**vars(HERE), "start": None, "repetition": None, "times": times})
    ).recording
    assert (r.time.tolist(), r.repetition.tolist()) == ([1.5, 2.5, 12.0], [1, 1, 2])
    for bad, says in (
        ("file,time\ni0.csv,1\n", "0 rows for i1.csv"),
        ("name,time\ni0.csv,1\n", "columns file and time"),
        ("file,time\ni0.csv,soon\n", "t.csv:2: time 'soon'"),
        ("\n", "no text|columns"),
    ):
        times.write_text(bad)
        with pytest.raises(BadInput, match=says):
            made(names, times=times)
    with pytest.raises(BadInput, match="no such file"):
        made(names, times=tmp_path / "none.csv")


def test_emissivity_of_exported_temperatures(image):
    old = ObjectParameters(emissivity=0.95, reflected=20.0)
    with pytest.raises(BadInput, match="--was.emissivity and --was.reflected"):
        made([image], emissivity=0.9)
    r = made([image], emissivity=0.9, was={"emissivity": 0.95, "reflected": 20.0}, band=3000.0)
    wanted = recompute_temperature(
        seen(straight()), old, old.with_values({"emissivity": 0.9}), PlanckCalibration(1.0, 1.0, 3000.0)
    )
    assert r.temperature[0, ::-1] == pytest.approx(wanted, abs=1e-3)
    assert r.emissivity == 0.9
    with pytest.raises(BadInput, match="planck.*no counts"):
        made([image], planck=(1.0, 1.0, 1400.0, 1.0, 0.0))
    with pytest.raises(BadInput, match="was.emisivity.*did you mean 'emissivity'"):
        made([image], was={"emisivity": 0.9})


def test_profile_averages_radiance(image):
    r = made([image], view="profile", crop=(0.0, 20.0, 0.0, 2.0))
    assert r.temperature.shape == (1, 1, 41)
    mean = field(1e3 * r.u, np.arange(0, 2.1, 0.5)[:, None]).mean(axis=0)
    assert r.temperature[0, 0] == pytest.approx(mean, abs=0.05)


def test_files_must_be_alike(tmp_path, image):
    other = write(tmp_path / "b.csv", np.full((5, 8), 20.0))
    with pytest.raises(BadInput, match=r"b\.csv: 8 x 5 pixels, but a\.csv has 50 x 30"):
        made([image, other])
    mixed = tmp_path / "c.csv"
    mixed.write_text("[Settings]\nTempUnit=C\n[Data]\n" + "\n".join(";".join(["20.5"] * COLUMNS) for _ in range(ROWS)))
    with pytest.raises(BadInput, match=r"c\.csv: IRBIS ASCII, but a\.csv is text matrix"):
        made([image, mixed])


def test_files_of_two_units_are_told(tmp_path, image):
    """Kelvin has to be said, and then a file in degC is 273 K too cold."""
    kelvin = write(tmp_path / "kelvin.csv", seen(straight()) + 273.15)
    for names in ([image, kelvin], [kelvin, image]):
        with pytest.raises(BadInput, match=r"a\.csv: unit: values of .* in K would be -2.* degC; correct --unit"):
            made(names, unit="K")
    assert made([kelvin, kelvin], unit="K", fps=1.0).frames == 2


def test_camera_facts_reach_the_recording(image):
    r = made([image], netd=0.05, psf_sigma=0.7, exposure=0.01, fps=25.0, registration_sigma=0.4, fixed_pattern=0.03)
    assert (r.netd_K, r.psf_sigma_px, r.exposure_s, r.fps) == (0.05, 0.7, 0.01, 25.0)
    assert (r.registration_sigma_px, r.fixed_pattern_K) == (0.4, 0.03)


def test_recording_of_recordings(tmp_path, image):
    """A recording can be cut and timed anew without saying again where its pixels lie."""
    made([image]).save(tmp_path / "r.nc")
    r = recording_import.import_recording(
        [tmp_path / "r.nc"], ImportOptions(crop=(0.0, 5.0, 0.0, 5.0), start=7.0)
    ).recording
    assert (r.time[0], r.view, r.u[-1]) == (7.0, "sidewall", pytest.approx(0.005))
    assert off(r) < 1e-4


# ---- the command

WORDS = [
    "--view", "sidewall", "--downstream", "right", "--pixel", "5", "24", "--mm-per-pixel", "0.5", "--start", "-1.5",
    "--repetition", "1",
]  # fmt: skip


def test_command(tmp_path, image, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["import", "a.csv", "--out", "r.nc", *WORDS, "--block", "20", "10", "--json"]) == 0
    out, err = capsys.readouterr()
    answer = json.loads(out)
    assert answer["time_s"] == [-1.5, -1.5]
    assert answer["pixels"] == [ROWS, COLUMNS]
    assert "text matrix" in err
    assert off(recording.load("r.nc")) < 1e-4
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "r.nc", "r.png"]
    assert main(["import", "a.csv", "--out", "r.nc", *WORDS]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main(["import", "*.csv", "--out", "r.nc", *WORDS, "--overwrite", "--mask-box", "0", "0", "1", "1"]) == 0
    out, _ = capsys.readouterr()
    assert out.startswith("Recording 'sidewall' of 1 frame,")


def test_options_take_units(tmp_path, image, capsys, monkeypatch):
    """Separate, joined by "=" and negative; several numbers of one option, some plain."""
    monkeypatch.chdir(tmp_path)
    plain = ["--start", "-1.5", "--mm-per-pixel", "0.5", "--block", "20", "10", "--netd", "0.03", "--exposure", "0.01"]
    units = [
        "--start=-1500ms",
        "--mm-per-pixel",
        "500 um",
        "--block",
        "2 cm",
        "10",
        "--netd",
        "30mK",
        "--exposure=10 ms",
    ]
    rest = ["--view", "sidewall", "--downstream", "right", "--up", "up", "--pixel", "5", "24", "--repetition", "1"]
    for out, words in (("a.nc", plain), ("b.nc", units)):
        assert main(["import", "a.csv", "--out", out, *rest, *words]) == 0
    one, other = recording.load("a.nc"), recording.load("b.nc")
    np.testing.assert_array_equal(one.temperature, other.temperature)
    assert one.u.tolist() == other.u.tolist()
    assert (one.time.tolist(), one.netd_K) == (other.time.tolist(), other.netd_K) == ([-1.5], 0.03)


def test_everything_missing_is_asked_for_at_once(tmp_path, image, capsys):
    assert main(["import", str(image), "--out", str(tmp_path / "r.nc")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert [line.split(":")[0] for line in lines] == ["view", "downstream", "start", "repetition"]
    for name in ("--view", "--downstream", "--pixel", "--mm-per-pixel", "--start", "--repetition"):
        assert name in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv"]
    assert main(["import", str(image)]) == 2
    assert capsys.readouterr().err.splitlines() == ["out: missing; give --out RECORDING.nc", *lines]


def test_files_are_taken_by_the_numbers_in_their_names_as_a_shell_does_not():
    shell = ["b/T 1.csv", "b/T 10.csv", "b/T 2.csv", "a/T 1.csv", "a/T 10.csv", "a/T 9.csv"]
    by_number = ["b/T 1.csv", "b/T 2.csv", "b/T 10.csv", "a/T 1.csv", "a/T 9.csv", "a/T 10.csv"]
    assert [p.as_posix() for p in expand_patterns(shell)] == by_number, "folders stay as they were given"


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ([], "out: missing; give --out"),
        (["--out", "r.txt"], "ends in .nc"),
        (["--out", "none/r.nc"], "no folder"),
        (["--out", "r.nc", "--repetition", "0"], "repetition: 0; give"),
        (
            ["--out", "r.nc", "--emissivity", "1.4", "--was.emissivity", "0.9", "--was.reflected", "9"],
            "emissivity: 1.4; give",
        ),
        (["--out", "r.nc", "--fps", "0"], "fps: 0; give"),
        (["--out", "r.nc", "--mm-per-pixel", "-1"], "mm_per_pixel: -1; give"),
        (["--out", "r.nc", "--mm-per-pixel", "2 s"], "mm_per_pixel: '2 s' is not a quantity in mm"),
        (["--out", "r.nc", "--downstream", "up"], "--up left or right"),
        (["--out", "r.nc", "--downstrem", "up"], "--downstrem"),
        (["--out", "r.nc", "--zero", "noon", "--start", "0", "--psf-sigma", "-1"], "psf_sigma_px: -1; give"),
    ],
)
def test_one_line_that_helps(tmp_path, image, capsys, monkeypatch, more, says):
    monkeypatch.chdir(tmp_path)
    words = [w for w in WORDS]
    for name in ("--repetition", "--mm-per-pixel", "--start"):
        if name in more:
            at = words.index(name)
            del words[at : at + 2]
    words = words[:2] + words[4:] if any(m.startswith("--downstr") for m in more) else words
    assert main(["import", "a.csv", *words, *more]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    [line] = err.splitlines()
    assert re.search(says, line)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv"]


def test_no_files(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for names, says in ((["none.csv"], "no such file"), (["*.jpg"], "no camera files"), ([], "no camera files")):
        assert main(["import", *names, "--out", "r.nc", *WORDS]) == 2
        assert says in capsys.readouterr().err


def test_template_is_complete_and_readable(tmp_path, capsys):
    assert main(["import", "--template"]) == 0
    text = capsys.readouterr().out
    raw = tomllib.loads(re.sub(r"^# (?=\w+ = )", "", text, flags=re.MULTILINE))
    assert set(raw) == {*vars(ImportOptions()), "files", "out"}
    path = tmp_path / "all.toml"
    path.write_text(re.sub(r"^# (?=\w+ = )", "", text, flags=re.MULTILINE))
    _, _, facts = import_options.load_template(path)
    assert facts.pixel == (12.0, 200.0)
    assert facts.mask == tmp_path / "mask.csv"
    assert facts.was == {"emissivity": 0.95, "reflected": 20.0}
    assert None not in vars(facts).values()


def test_a_folder_becomes_a_recording_by_its_template(tmp_path, capsys):
    for k in (1, 2, 10):
        write(tmp_path / f"img{k}.csv", seen(straight(), t=k))
    (tmp_path / "recording.toml").write_text(
        'files = ["img*.csv"]\nout = "side.nc"\nview = "sidewall"\ndownstream = "right"\npixel = [5, 24]\n'
        "mm_per_pixel = 0.5\nfps = 10\nstart = 1.0\nrepetition = 2\n"
    )
    assert main(["import", str(tmp_path / "recording.toml"), "--start", "3"]) == 0
    r = recording.load(tmp_path / "side.nc")
    assert r.time == pytest.approx([3.0, 3.1, 3.2])
    assert np.diff(r.temperature.mean(axis=(1, 2))) == pytest.approx([1.0, 8.0], abs=1e-3)
    assert r.repetition.tolist() == [2, 2, 2]
    capsys.readouterr()


def test_faults_of_a_template_all_at_once(tmp_path, capsys):
    path = tmp_path / "recording.toml"
    path.write_text(
        'vieww = "sidewall"\npixel = [5]\nmm_per_pixel = "small"\nunit = "C"\nstarts = []\nmask = 3\nwas = 1\nevery = 1.5\n'
    )
    assert main(["import", str(path)]) == 2
    err = capsys.readouterr().err
    for says in ("files: missing", "did you mean 'view'", "list of 2 numbers", "'small'; give a number", "degC, K, mK",
                 "one or more", "3; give text", "was: 1", "1.5; give a whole"):  # fmt: skip
        assert says in err
    assert len(err.splitlines()) == 9
    path.write_text("files = [\n")
    assert main(["import", str(path)]) == 2
    assert "not valid TOML" in capsys.readouterr().err


@pytest.mark.parametrize("view", ["sidewall", "wake"])
def test_registration_picture_shows_block_and_image(image, view):
    from flashtemp.viz.measurement.registration import draw

    r = made([image], view=view)
    ax = draw(r, (0.020, 0.010)).axes[0]
    assert ax.get_xlim()[1] >= 20.0
    assert ax.get_images()[0].get_extent() == pytest.approx((-2.75, 22.25, -2.75, 12.25))
    if view == "sidewall":
        box = ax.patches[0]
        assert (box.get_x(), box.get_y(), box.get_width(), box.get_height()) == (0, 0, 20.0, 10.0)
