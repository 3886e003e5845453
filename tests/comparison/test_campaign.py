"""campaign.toml and what it names: read whole, or refused in one line for every fault."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from flashtemp.__main__ import main
from flashtemp.camera.recording import Recording, load
from flashtemp.comparison import campaign, compare
from flashtemp.comparison.condition_remarks import remark_on_conditions
from flashtemp.discovery import engine
from flashtemp.errors import BadInput

HEAD = 'case = "case.toml"\n'
VIEW = '[[recording]]\nfile = "a.nc"\n'
FORCE = '[[force]]\nfile = "mu.csv"\n'


def small(**told):
    given = {
        "temperature": np.full((2, 3, 4), 25.0), "time": np.array([1.0, 2.0]), "repetition": np.array([1, 1]),
        "u": np.arange(4) * 1e-3, "v": np.arange(3) * 1e-3,
    } | told  # fmt: skip
    return Recording(given.pop("view", "sidewall"), **given)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "case.toml").write_text('effects = ["pressure_tilt"]\n')
    small(emissivity=0.95).save(tmp_path / "a.nc")
    (tmp_path / "mu.csv").write_text("time_s,mu\n0,0.9\n1,0.8\n")
    return tmp_path


def refused(folder, text) -> list[str]:
    (folder / "campaign.toml").write_text(text)
    with pytest.raises(BadInput) as fault:
        campaign.load(folder)
    assert all(str(folder) in line for line in fault.value.lines)
    return list(fault.value.lines)


def test_a_campaign_is_read(folder):
    (folder / "campaign.toml").write_text(
        'title = "t"\n' + HEAD + 'free = ["friction.mu", "pressure_tilt.a"]\n' + VIEW
        + 'with = { "contact.pressure" = 2e5 }\nsigma_K = 0.04\nheld_out = true\n'
        + '[[force]]\nfile = "mu.csv"\nsigma = 0.01\n'
    )  # fmt: skip
    found = campaign.load(folder)
    assert (found.title, found.free) == ("t", ("friction.mu", "pressure_tilt.a"))
    [view], [force] = found.views, found.forces
    assert (view.given, view.sigma_K, view.held_out) == ({"contact.pressure": 2e5}, 0.04, True)
    assert (force.time, force.mu, force.sigma) == ((0.0, 1.0), (0.9, 0.8), 0.01)
    assert found.load(view.given)["contact.pressure"] == 2e5
    assert "a.nc" in str(found)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD, "no [[recording]] and no [[force]]"),
        ('case = "nix.toml"\n' + VIEW, "no file 'nix.toml'"),
        (HEAD + "titel = 1\n" + VIEW, "did you mean 'title'"),
        (HEAD + VIEW + "sigma = 1\n", "did you mean 'sigma_K'"),
        (HEAD + VIEW + "sigma_K = -1\n", "sigma_K: -1; give a number > 0"),
        (
            HEAD + VIEW + 'with = { "contact.presure" = 1 }\n',
            "recording 1: contact.presure (with): unknown key; did you mean 'contact.pressure'",
        ),
        (HEAD + VIEW + 'held_out = "yes"\n', "give true or false"),
        (HEAD + '[[recording]]\nfile = "b.nc"\n', "no file 'b.nc'"),
        (HEAD + '[[recording]]\nfile = "mu.csv"\n', "campaign.toml:2: recording 1: file: 'mu.csv' is a table, not a"),
        (HEAD + '[[recording]]\nfile = "mu.csv"\n', "list friction over time as [[force]]"),
        (
            HEAD + '[[recording]]\nfile = "mu.csv"\nwith = { friction.nu = 1 }\n',
            "toml:2: recording 1: friction.nu (with)",
        ),
        (HEAD + VIEW + 'sigma_K = "50 mm"\n', "sigma_K: '50 mm' is not a quantity in K"),
        (HEAD + VIEW + 'sigma_K = "fine"\n', 'give a number > 0 in K, such as "50 mK"'),
        (HEAD + FORCE + 'sigma = "1 K"\n', "force 1: sigma: '1 K' is not a quantity without a unit"),
        (HEAD + VIEW + 'camera = "microbolometer"\n', "did you mean 'uncooled'?"),
        (HEAD + VIEW + 'camera = "warm"\n', 'recording 1: camera: \'warm\'; give "uncooled" or "cooled"'),
        (HEAD + '[[force]]\nfile = "a.nc"\n', "not text"),
        (HEAD + 'free = ["friction.nu"]\n' + VIEW, "did you mean 'friction.mu'"),
        (HEAD + "recording = 3\n", "write [[recording]]"),
        (HEAD + "candidates = 3\n" + VIEW, "give a list of names in quotes"),
        (HEAD + 'free = "friction.mu"\n' + VIEW, "give a list of names in quotes"),
        (HEAD + 'candidates = ["weer"]\n' + VIEW, "did you mean 'wear'"),
        (HEAD + 'candidates = ["./dust.py"]\n' + VIEW, "list a file of your own in the candidates of the case"),
        (HEAD + VIEW + '[[recording]]\nfile = "b.nc"\n', "campaign.toml:4: recording 2: file"),
        (
            HEAD + VIEW + VIEW,
            "recording 2: file: 'a.nc' holds the same measurement as recording 1, 'a.nc'; list it once",
        ),
        (HEAD + VIEW + "held_out = true\n" + VIEW + 'with = { "contact.pressure" = 2e5 }\n', "the same measurement"),
        (HEAD + VIEW + VIEW.replace("a.nc", "./a.nc"), "the same measurement"),
        (HEAD + FORCE + FORCE, "force 2: file: 'mu.csv' holds the same measurement as force 1, 'mu.csv'"),
        (HEAD + 'free = ["numerics.mesh"]\n' + VIEW, "'numerics.mesh' belongs to the computation"),
        (HEAD + 'free = ["numerics.rtol"]\n' + VIEW, "'numerics.rtol' belongs to the computation"),
        (HEAD + 'free = ["output.fields"]\n' + VIEW, "'output.fields' is not a physical parameter"),
        (HEAD + 'free = ["block.material"]\n' + VIEW, "'block.material' is not a physical parameter"),
        (HEAD + 'free = ["schedule.repetitions"]\n' + VIEW, "'schedule.repetitions' is not a physical parameter"),
        (HEAD + 'free = ["schedule.lifted"]\n' + VIEW, "'schedule.lifted' is not a physical parameter"),
        (HEAD + "free = { numerics.mesh = 0.1 }\n" + VIEW, "'numerics.mesh' belongs to the computation"),
        (HEAD + 'free = ["friction.mu", "friction.mu"]\n' + VIEW, "'friction.mu' is listed twice"),
        (HEAD + 'free = { "friction.mu" = 0.1, friction = { mu = 0.2 } }\n' + VIEW, "'friction.mu' is listed twice"),
        (HEAD + 'candidates = ["wear", "wear"]\n' + VIEW, "effect 'wear' is listed twice"),
        (HEAD + VIEW + 'with = { effects = ["wear", "wear"] }\n', "effect 'wear' is listed twice"),
        (HEAD + VIEW + 'with = { "free" = ["friction.mu"] }\n', "with: 'free' holds for all; write it at the top"),
        (HEAD + VIEW + "with = { contact.pressur = 2e5 }\n", "did you mean 'contact.pressure'"),
        ("case = \n", "not valid TOML"),
    ],
)
def test_faults_are_named_in_one_line_each(folder, text, said):
    lines = refused(folder, text)
    assert len(lines) == 1
    assert said in lines[0]


def test_stated_noise_may_have_a_unit(folder):
    (folder / "points.csv").write_text("0,20\n1,21\n")
    points = '[[recording]]\nfile = "points.csv"\npoints = [{ x = 0.01, z = 0.002 }]\nsigma_K = "0.2 degC"\n'
    (folder / "campaign.toml").write_text(HEAD + VIEW + 'sigma_K = "50 mK"\n' + points + FORCE + 'sigma = "2 %"\n')
    found = campaign.load(folder)
    assert [view.sigma_K for view in found.views] == [0.05, 0.2]
    assert found.forces[0].sigma == 0.02


def test_stated_noise_far_above_that_of_the_frames_is_refused(folder):
    """50 for 50 mK; what is merely large, or cannot be checked in frames without noise, is accepted."""
    noise = np.random.default_rng(3).normal(0.0, 0.05, (9, 12, 12))
    small(
        temperature=25.0 + noise, time=np.arange(9.0), repetition=np.ones(9, int), u=np.arange(12) * 1e-3,
        v=np.arange(12) * 1e-3,
    ).save(folder / "noisy.nc")  # fmt: skip
    noisy = HEAD + VIEW.replace("a.nc", "noisy.nc")
    [line] = refused(folder, noisy + "sigma_K = 50\n")
    assert "campaign.toml:2: recording 1: sigma_K: 50 K, but the frames show a noise of 0.04" in line
    assert 'write "50 mK" if mK is meant' in line
    for text in (noisy + "sigma_K = 1\n", noisy + 'sigma_K = "50 mK"\n', HEAD + VIEW + "sigma_K = 50\n"):
        (folder / "campaign.toml").write_text(text)
        assert campaign.load(folder).views[0].sigma_K in (1.0, 0.05, 50.0)


@pytest.mark.parametrize("how", ["copy", "hard link", "symbolic link", "saved anew"])
def test_a_measurement_under_another_name_counts_once(folder, how):
    if how == "copy":
        shutil.copyfile(folder / "a.nc", folder / "b.nc")
    elif how == "hard link":
        (folder / "b.nc").hardlink_to(folder / "a.nc")
    elif how == "symbolic link":
        (folder / "b.nc").symlink_to("a.nc")
    else:
        replace(load(folder / "a.nc"), source="again", emissivity=0.9).save(folder / "b.nc")
    [line] = refused(folder, HEAD + VIEW + VIEW.replace("a.nc", "b.nc"))
    assert "recording 2: file: 'b.nc' holds the same measurement as recording 1, 'a.nc'" in line


def test_a_copied_trace_counts_once_and_a_typed_constant_twice(folder):
    shutil.copyfile(folder / "mu.csv", folder / "copy.csv")
    assert "same measurement" in refused(folder, HEAD + FORCE + FORCE.replace("mu.csv", "copy.csv"))[0]
    for name in ("one.csv", "two.csv"):
        (folder / name).write_text("time_s,mu\n0,0.8\n1,0.8\n")
    files = [FORCE.replace("mu.csv", name) for name in ("one.csv", "two.csv")]
    (folder / "campaign.toml").write_text(HEAD + files[0] + files[1] + 'with = { "contact.pressure" = 2e5 }\n')
    assert len(campaign.load(folder).forces) == 2


def test_two_columns_of_one_table_are_two_measurements(folder):
    (folder / "t.csv").write_text("time_s,T1,T2\n0,20,20\n1,21,23\n")
    entry = '[[recording]]\nfile = "t.csv"\npoints = [{ z = 0.002 }, { z = 0.004 }]\n'
    (folder / "campaign.toml").write_text(HEAD + entry + VIEW)
    assert len(campaign.load(folder).views) == 2
    assert "same measurement" in refused(folder, HEAD + entry + entry)[0]


def test_a_condition_is_one_however_it_is_written(folder):
    """With a unit, as a whole number, as a table in a table; other keys of that table stay."""
    (folder / "case.toml").write_text("[contact]\nspot_fraction = 0.5\n")
    ways = [
        '"contact.pressure" = 2e5',
        '"contact.pressure" = "0.2 MPa"',
        '"contact.pressure" = 200000',
        "contact.pressure = 2e5",
    ]
    text = HEAD
    for n, way in enumerate(ways):
        small(time=np.array([1.0, 2.0 + n])).save(folder / f"{n}.nc")
        text += f'[[recording]]\nfile = "{n}.nc"\nwith = {{ {way} }}\n'
    (folder / "campaign.toml").write_text(text)
    found = campaign.load(folder)
    [condition] = found.conditions
    assert condition.given == {"contact.pressure": 2e5}
    assert {found.load(view.given)["contact.spot_fraction"] for view in found.views} == {0.5}


def test_all_faults_are_told_at_once(folder):
    assert len(refused(folder, HEAD + VIEW + 'sigma_K = 0\n[[recording]]\nfile = "b.nc"\n[[force]]\nfile = "c"\n')) == 3


def test_a_case_is_no_campaign(tmp_path, capsys):
    file = tmp_path / "mine.toml"
    file.write_text("[schedule]\nspeed = 0.2\n")
    assert main(["discover", str(file)]) == 2
    assert 'this is a case, not a campaign; give a campaign.toml with case = "mine.toml"' in capsys.readouterr().err


def test_a_missing_campaign_is_bad_input(tmp_path, capsys):
    assert main(["compare", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "no campaign.toml in it" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


# --- recordings -------------------------------------------------------------------------------------
def test_a_recording_comes_back_as_it_was(tmp_path):
    made = small(emissivity=0.94, netd_K=0.05, fps=30.0, source="bench")
    made.temperature[0, 1, 2] = np.nan
    made.save(tmp_path / "r.nc")
    back = load(tmp_path / "r.nc")
    np.testing.assert_array_equal(back.temperature, made.temperature)
    assert (back.emissivity, back.netd_K, back.fps, back.source) == (0.94, 0.05, 30.0, "bench")
    assert back.psf_sigma_px is None
    flat = small(view="profile", temperature=np.full((2, 1, 4), 30.0), v=np.zeros(1))
    flat.save(tmp_path / "p.nc")
    assert load(tmp_path / "p.nc").temperature.shape == (2, 1, 4)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"view": "above"}, "sidewall, wake, profile"),
        ({"u": np.arange(5.0)}, "shape (2, 3, 4)"),
        ({"u": -np.arange(4.0)}, "must increase"),
        ({"time": np.array([2.0, 1.0])}, "in order of time"),
        ({"time": np.array([1.0, np.nan])}, "not finite"),
        ({"repetition": np.array([0, 1])}, "counted from 1"),
        ({"temperature": np.full((2, 3, 4), np.nan)}, "no pixel holds a number"),
        ({"emissivity": 1.2}, "emissivity: 1.2; give 0.05 to 1"),
    ],
)
def test_what_is_no_recording_is_refused(told, said):
    with pytest.raises(BadInput, match=said.replace("(", r"\(").replace(")", r"\)")):
        small(**told)


def test_a_recording_imported_again_keeps_what_it_knows(folder):
    small(emissivity=0.95, reflected_degC=20.0, psf_sigma_px=0.7, registration_sigma_px=0.2, netd_K=0.05).save(
        folder / "a.nc"
    )
    assert main(["import", str(folder / "a.nc"), "--out", str(folder / "b.nc")]) == 0
    first, second = load(folder / "a.nc"), load(folder / "b.nc")
    for name in ("emissivity", "reflected_degC", "psf_sigma_px", "registration_sigma_px", "netd_K"):
        assert getattr(first, name) == pytest.approx(getattr(second, name)), name


def test_a_damaged_recording_is_bad_input(folder):
    data = (folder / "a.nc").read_bytes()
    for cut in (0, 100, len(data) // 2, len(data) - 10):
        (folder / "cut.nc").write_bytes(data[:cut])
        with pytest.raises(BadInput, match=r"cut\.nc"):
            load(folder / "cut.nc")


# --- before a campaign is simulated ---------------------------------------------------------------------------
UNUSUAL = 'with = { "contact.pressure" = 0.075, "schedule.speed" = 0.1 }\n'


@pytest.mark.parametrize("command", ["compare", "discover"])
def test_unusual_conditions_are_remarked_before_anything_is_simulated(folder, monkeypatch, capsys, command):
    def refuse(*args):
        raise BadInput("reached")

    monkeypatch.setattr(compare, "compare", refuse)
    monkeypatch.setattr(engine, "discover", refuse)
    (folder / "campaign.toml").write_text(HEAD + VIEW + UNUSUAL + FORCE + 'with = { "contact.pressure" = 2e5 }\n')
    assert main([command, str(folder), "--out", str(folder / "out")]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said == [
        f"{folder / 'campaign.toml'}: a.nc: with: contact.pressure: 0.075 Pa is unusual, 2000 to 2e+07 Pa is usual; "
        'check the value and its unit, or write "0.075 MPa" if that is meant',
        "reached",
    ]


def test_unusual_values_of_the_case_are_remarked_once(folder):
    (folder / "case.toml").write_text("[contact]\npressure = 150.0\n")
    (folder / "campaign.toml").write_text(HEAD + VIEW + FORCE)
    [remark] = remark_on_conditions(campaign.load(folder))
    assert remark.startswith(f"{folder / 'case.toml'}: contact.pressure: 150 Pa is unusual")


@pytest.mark.parametrize("command", ["discover", "plan"])
def test_a_campaign_without_anything_to_fit_is_refused_with_its_line(folder, capsys, command):
    (folder / "campaign.toml").write_text(HEAD + VIEW + "held_out = true\n" + FORCE + "held_out = true\n")
    assert main([command, str(folder), "--out", str(folder / "out")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{folder / 'campaign.toml'}:4: held_out: true for all")
