"""Input that cannot be used is refused in one line per fault: file, key, value and what would be right."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import pytest

from flashtemp.__main__ import main

REMEDY = re.compile(r"did you mean|\b(give|add|write|use|choose|remove|repair|leave|once|must|count from|known)\b")


@dataclass(frozen=True)
class Bad:
    """One case.toml (or override) with exactly one fault, and what its line must name."""

    name: str
    toml: str | bytes
    key: str
    value: str
    says: str = ""  # a suggestion that must be in the line
    given: tuple[str, ...] = ()
    files: dict[str, str | bytes] = field(default_factory=dict)


def override(name: str, key: str, value: str, *given: str, says: str = "") -> Bad:
    return Bad(name, "", key, value, says, given)


def table(name: str, rows: str | bytes, value: str, says: str = "", key: str = "schedule.speed") -> Bad:
    """A fault in a CSV file that a key names."""
    section, last = key.split(".")
    return Bad(name, f'[{section}]\n{last} = "v.csv"\n', key, value, says, files={"v.csv": rows})


def number(dotted: str, *values: str) -> list[Bad]:
    """A value that is wrong for a key; Python writes nan, inf and numbers as TOML does."""
    section, last = dotted.rsplit(".", 1)
    return [Bad(f"{dotted}={v}", f"[{section}]\n{last} = {v}\n", dotted, v.strip("'\"")) for v in values]


MATERIAL = '[block]\nmaterial = "mine"\n[materials.mine]\n'
TILT = 'effects = ["pressure_tilt"]\n'
DEPTH = 'effects = ["heat_depth"]\n[heat_depth]\n'
PROFILE = 'effects = ["pressure_profile"]\n'
FAULTS = [
    # the file as a whole
    Bad("no TOML", "[block]\nlength = \n", "TOML", "line 2"),
    Bad("key twice", "[block]\nlength = 0.02\nlength = 0.03\n", "TOML", "line 3"),
    Bad("not text", b"title = '\xff\xfe'\n", "case.toml", "UTF-8"),
    # names
    Bad("unknown table", "[blok]\nlength = 0.02\n", "blok", "unknown", "did you mean 'block'"),
    Bad("unknown key", "[block]\nlenght = 0.02\n", "block.lenght", "unknown", "did you mean 'block.length'"),
    Bad("unknown key, nothing like it", "[block]\nqqqqq = 0.02\n", "block.qqqqq", "unknown", "length"),
    Bad("unknown table, nothing like it", "[qqqqq]\n", "qqqqq", "unknown", "schedule"),
    Bad("single-letter key", TILT + "[pressure_tilt]\nA = 0.5\n", "pressure_tilt.A", "unknown", "'pressure_tilt.a'"),
    Bad("value for a table", "block = 3\n", "block", "3", r"\[block\]"),
    Bad("list of tables", "[[block]]\nlength = 0.02\n", "block", "0.02", r"\[block\]"),
    Bad("value for materials", "materials = 3\n", "materials", "3"),
    Bad("title", "title = 3\n", "title", "3"),
    # types
    *number("block.length", '"long"', "[1.0]", "true", "nan", "inf", "-inf", "0", "-0.02"),
    *number("schedule.repetitions", "0", "-1", "1.5", "1000000"),
    *number("schedule.lifted", '"yes"', "1"),
    *number("block.material", "3"),
    # ranges
    *number("contact.pressure", "0", "-150000.0", "nan"),
    *number("contact.spot_fraction", "0", "1.5", "-0.1", "nan"),
    *number("contact.spot_exponent", "3.0"),
    *number("schedule.speed", "0", "-1001", "inf", '""'),
    *number("schedule.distance", "0", "-1.0"),
    *number("schedule.wait", "-1", "nan"),
    *number("ambient.temperature", "-300", "nan"),
    *number("friction.mu", "-1", "nan", "inf"),
    *number("numerics.mesh", '"fin"', "0", "-1", "1000", "nan", "[1]"),
    *number("numerics.cells", "[1, 2]", "[1, 2, 3]", "[10, 10, 10.5]", "10", '"many"'),
    *number("numerics.finer", "[1, 2]", "[0, 1, 1]", "[1, 1, 100]", "2", "[1, 1, true]"),
    *number("numerics.above", "-1", "2.5"),
    *number("numerics.rtol", "0", "1", "-0.0001", '"tight"'),
    *number("numerics.integrator", '"cvodes"', "3"),
    *number("numerics.order", "6"),
    *number("output.profiles", "1"),
    *number("output.pictures", "1"),
    # the law alpha(v)
    *number("contact.alpha", "0", "-5", "nan", "-inf", "[]"),
    Bad("alpha law of zeros", "[contact]\nalpha = { a0 = 0, a1 = 0 }\n", "contact.alpha", "'a0': 0"),
    Bad("alpha law negative", "[contact]\nalpha = { a0 = -1.0 }\n", "contact.alpha", "-1.0"),
    Bad("alpha law with a wrong name", "[contact]\nalpha = { b = 3.0 }\n", "contact.alpha", "'b'"),
    Bad("alpha law with text", '[contact]\nalpha = { a0 = "x" }\n', "contact.alpha", "x"),
    Bad("alpha law with nan", "[contact]\nalpha = { a0 = nan }\n", "contact.alpha", "nan"),
    Bad("alpha law with a flag", "[contact]\nalpha = { a0 = true }\n", "contact.alpha", "True"),
    Bad("alpha table with zero", "[contact]\nalpha = [[0.1, 0.0], [0.2, 1.0]]\n", "contact.alpha", "0"),
    Bad("alpha word", '[contact]\nalpha = "fast"\n', "contact.alpha", "fast"),
    # tables in files
    Bad("file not there", '[schedule]\nspeed = "v.csv"\n', "schedule.speed", "v.csv"),
    Bad("folder for a file", '[schedule]\nspeed = "."\n', "schedule.speed", "'.'"),
    Bad("law where there is none", "[schedule]\nspeed = { a = 1 }\n", "schedule.speed", "'a': 1", "rows|number"),
    table("nan in a file", "time_s,v\n0,0.1\n1,nan\n", "nan", r"v\.csv:3"),
    table("text in a file", "time_s,v\n0,0.1\n1,fast\n", "fast", r"v\.csv:3"),
    table("header only", "time_s,v\n", "v.csv", "rows"),
    table("two decimal signs", "time_s;v\n0;0.1\n2;0,2\n3;0.1\n", "0,2", r"v\.csv:3"),
    table("empty file", "", "v.csv", "the file is empty"),
    table("ragged rows", "time_s,v\n0,0.1\n1,0.1,3\n", "3 values", r"v\.csv:3"),
    table("time goes back", "time_s,v\n0,0.1\n2,0.1\n1,0.1\n", "from 2 to 1", "increase"),
    table("negative time", "time_s,v\n-1,0.1\n2,0.1\n", "-1", ">= 0"),
    table("too fast back", "time_s,v\n0,0.1\n2,-1001\n", "-1001", ">= -1000"),
    table("no speed", "time_s,v\n0,0\n2,0\n", "zero", "> 0"),
    table("stops before the distance", "time_s,v\n0,0.1\n2,0\n", "3.5", "> 0"),
    table("binary file", b"\x89PNG\xff\xfe\x00", "v.csv", "text|CSV"),
    table("no pressure", "time_s,p\n0,0\n9,0\n", "zero", "> 0", key="contact.pressure"),
    table("pressure out of bounds", "time_s,p\n0,1e5\n9,1e12\n", "1e+12", "1e+09".replace("+", r"\+"), key="contact.pressure"),
    Bad("rows too short", "[schedule]\nspeed = [0.1, 0.2]\n", "schedule.speed", "0.1", "2 numbers"),
    Bad("flag in rows", "[schedule]\nspeed = [[true, 0.2]]\n", "schedule.speed", "True"),
    Bad("grid with a hole", "[friction]\ntable = [[0.1, 20, 1.0], [0.1, 60, 0.8], [1, 20, 1]]\n", "friction.table", "3 rows"),
    Bad("grid with a row twice", "[friction]\ntable = [[0.1, 20, 1], [0.1, 20, 0.8], [1, 60, 1], [1, 60, 1]]\n", "friction.table", "20"),
    Bad("negative friction in a table", "[friction]\ntable = [[0.1, 20, -1.5]]\n", "friction.table", "-1.5"),
    Bad("nan in a table", "[friction]\ntable = [[0.1, 20, nan]]\n", "friction.table", "nan", "row 1"),
    # the heat's depth and the mesh
    Bad("shares above one", "[friction]\nspectrum = [[0.6, 1e-4], [0.6, 1e-3]]\n", "friction.spectrum", "1.2", "<= 1"),
    Bad("negative share", "[friction]\nspectrum = [[0.6, 1e-4], [-0.1, 1e-3]]\n", "friction.spectrum", "-0.1"),
    Bad("source below any mesh", "[friction]\nspectrum = [[0.6, 1e-9]]\n", "friction.spectrum", "1e-09", ">="),
    Bad("source deeper than any block", "[friction]\nspectrum = [[0.6, 1.0]]\n", "friction.spectrum", "1 m", "<="),
    Bad("spectrum and share", "[friction]\nvolumetric_share = 0.3\nspectrum = [[0.6, 1e-4]]\n", "friction.", "0.3"),
    Bad("shares of effect and base above one", "effects = ['heat_depth']\n[heat_depth]\nshare = 0.7\n[friction]\nvolumetric_share = 0.6\n", "share", "1.3"),
    Bad("mesh too coarse for the source", "[friction]\nvolumetric_share = 0.3\ndepth = 1e-7\n[numerics]\nfirst_block = 4e-6\n", "numerics.first_block", "4e-06", "<= 2e-07"),
    Bad("mesh too coarse for an effect's source", DEPTH + "depth = 1e-7\n[numerics]\nfirst_block = 4e-6\n", "numerics.first_block", "4e-06", "<= 2e-07"),
    Bad("first cell larger than the block", "[numerics]\nfirst_block = 0.01\n", "numerics.first_block", "0.01", "smaller"),
    Bad("first cell longer than the block", "[numerics]\nfirst_x = 0.03\n", "numerics.first_x", "0.03", "smaller"),
    Bad("last cell longer than the block", "[numerics]\nlast_x = 0.05\n", "numerics.last_x", "0.05", "smaller"),
    Bad("first cell deeper than the road", "[road]\ndepth = 1e-3\n[numerics]\nfirst_road = 1e-3\n", "numerics.first_road", "0.001", "smaller"),
    # effects
    Bad("unknown effect", "effects = ['friction_softning']\n", "effects", "friction_softning", "'friction_softening'"),
    Bad("unknown effect, nothing like it", "effects = ['qqqqq']\n", "effects", "qqqqq"),
    Bad("base effect", "effects = ['friction']\n", "effects", "friction", "leave"),
    Bad("effect twice", "effects = ['pressure_tilt', 'pressure_tilt']\n", "effects", "pressure_tilt", "once"),
    Bad("effects is a number", "effects = 3\n", "effects", "3", "list"),
    Bad("effects of numbers", "effects = [1]\n", "effects", "[1]", "list"),
    Bad("effect not listed", "[pressure_tilt]\na = 0.5\n", "pressure_tilt", "not listed", "add"),
    Bad("effect is no table", TILT + "pressure_tilt = 3\n", "pressure_tilt", "3", r"\[pressure_tilt\]"),
    Bad("effect out of bounds", TILT + "[pressure_tilt]\na = 7\n", "pressure_tilt.a", "7", "<= 1"),
    Bad("unknown candidate", "candidates = ['presure_tilt']\n", "candidates", "presure_tilt", "'pressure_tilt'"),
    Bad("decay over no length", "effects = ['edge_pressure']\n[edge_pressure]\nlength = 0\n", "edge_pressure.length", "0", "> 0"),
    Bad("no profile", PROFILE, "pressure_profile.profile", "missing", "rows"),
    Bad("profile of one row", PROFILE + "[pressure_profile]\nprofile = [[0, 1.5]]\n", "pressure_profile.profile", "1 row", "two rows"),
    Bad("profile of zeros", PROFILE + "[pressure_profile]\nprofile = [[0, 0], [1, 0]]\n", "pressure_profile.profile", "zero"),
    Bad("profile zero under the block", PROFILE + "[pressure_profile]\nprofile = [[0, 0], [1, 0], [2, 3]]\n", "contact.pressure", "0 on average"),
    Bad("profile negative", PROFILE + "[pressure_profile]\nprofile = [[0, -1], [1, 2]]\n", "pressure_profile.profile", "-1", ">= 0"),
    Bad("map of one line", PROFILE + "[pressure_profile]\nmap = [[0, 0, 1], [1, 0, 1]]\n", "pressure_profile.map", "2 x 1 nodes", "two in x and in y"),
    Bad("map with a hole", PROFILE + "[pressure_profile]\nmap = [[0, 0, 1], [1, 0, 1], [1, 1, 1]]\n", "pressure_profile.map", "2 x 2 nodes", "every pair"),
    Bad("track shorter than the road shown", "effects = ['track_memory']\n[road]\ntrack_length = 0.03\n", "road.track_length", "0.03", "longer"),
    # what a fit may move
    Bad("free of nothing known", "free = ['friction.mmu']\n", "free", "friction.mmu", "did you mean 'friction.mu'"),
    Bad("free of nothing like it", "free = ['qqqqq']\n", "free", "qqqqq"),
    Bad("free is text", "free = 'friction.mu'\n", "free", "friction.mu", "list"),
    Bad("free of a number", "free = [3]\n", "free", "3"),
    Bad("free twice", "free = ['friction.mu', 'friction.mu']\n", "free", "friction.mu", "once"),
    # materials
    Bad("unknown material", '[block]\nmaterial = "tread_ruber"\n', "block.material", "tread_ruber", "did you mean 'tread_rubber'"),
    Bad("unknown material, nothing like it", '[road]\nmaterial = "qqqqq"\n', "road.material", "qqqqq", "asphalt"),
    Bad("material without density", MATERIAL + "conductivity = 0.2\nheat_capacity = 1700\n", "materials.mine", "density", "kg/m3"),
    Bad("material that conducts nothing", MATERIAL + "conductivity = 0\ndensity = 1200\nheat_capacity = 1700\n", "materials.mine.conductivity", "0", "> 0"),
    Bad("material with an unknown key", MATERIAL + "conductivity = 0.2\ndensity = 1200\nheat_capacity = 1700\ndensitty = 1\n", "materials.mine.densitty", "unknown", "'materials.mine.density'"),
    # the command line
    override("no equals sign", "friction.mu", "friction.mu", "friction.mu", says="key=value"),
    override("no key", "=1", "=1", "=1", says="key=value"),
    override("unknown key of an override", "friction.mv", "unknown", "friction.mv=1", says="did you mean 'friction.mu'"),
    override("unknown table of an override", "frction", "unknown", "frction.mu=1", says="did you mean 'friction'"),
    override("override out of bounds", "friction.mu", "-1", "friction.mu=-1", says=">= 0"),
    override("override of the wrong type", "friction.mu", "high", "friction.mu=high", says="number"),
    override("empty override", "friction.mu", "''", "friction.mu=", says="number"),
    override("override of a table", "block", "3", "block=3", says=r"\[block\]"),
    override("override too deep", "block.length", "1", "block.length.x=1"),
    override("override lists an unknown effect", "effects", "pressure_tlt", "effects=pressure_tlt", says="'pressure_tilt'"),
    override("override of an effect not listed", "pressure_tilt", "not listed", "pressure_tilt.a=0.3", says="add"),
    override("override names no file", "schedule.speed", "nofile.csv", "schedule.speed=nofile.csv"),
]  # fmt: skip


def written(folder, bad: Bad):
    text = bad.toml if isinstance(bad.toml, bytes) else bad.toml.encode()
    (folder / "case.toml").write_bytes(text)
    for name, content in bad.files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def lines_of(capsys, argv: list[str]) -> list[str]:
    """The lines on stderr of a command that must end with exit code 2 and nothing on stdout."""
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    return err.splitlines()


@pytest.mark.parametrize("bad", FAULTS, ids=lambda b: b.name)
def test_one_line_that_helps(bad, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = written(tmp_path, bad)
    before = sorted(tmp_path.rglob("*"))
    lines = lines_of(capsys, ["check", str(folder), *bad.given])
    assert len(lines) == 1
    where, line = "command line" if bad.given else "case.toml", lines[0]
    assert where in line
    assert bad.key in line
    said = line.replace(str(folder), "").split(bad.key, 1)[1] if bad.value != bad.key else line
    assert re.search(rf"(?<![\w.]){re.escape(bad.value)}(?![\w.])", said, re.IGNORECASE)
    assert REMEDY.search(line)
    assert re.search(bad.says, line)
    assert lines_of(capsys, ["run", str(folder), *bad.given, "--out", "result"]) == lines
    assert sorted(tmp_path.rglob("*")) == before


def test_line_number_leads_to_the_fault(tmp_path, capsys):
    written(tmp_path, Bad("", "# a case\n\n[block]\nlength = -1  # m\n", "", ""))
    [line] = lines_of(capsys, ["check", str(tmp_path)])
    assert line.startswith(f"{tmp_path / 'case.toml'}:4: block.length: -1")


def test_all_faults_at_once(tmp_path, capsys):
    text = "[block]\nlenght = 1\nheight = -1\n[contact]\nspot_fraction = 2\n[schedule]\nrepetitions = 0\n"
    written(tmp_path, Bad("", text, "", ""))
    lines = lines_of(capsys, ["check", str(tmp_path), "friction.mu=-3"])
    keys = ("block.lenght", "block.height", "contact.spot_fraction", "schedule.repetitions", "friction.mu")
    assert len(lines) == len(keys)
    for key in keys:
        assert sum(key in line for line in lines) == 1


@pytest.mark.parametrize("command", ["check", "run"])
def test_no_case(tmp_path, capsys, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    for name in ("nowhere", "nowhere.toml", "."):
        [line] = lines_of(capsys, [command, name])
        assert name in line
        assert "case.toml" in line
        assert REMEDY.search(line)
    assert list(tmp_path.iterdir()) == []


def test_binding_that_is_not_installed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("flashtemp.model.numerics.find_spec", lambda module: module == "sksundae")
    written(tmp_path, Bad("", '[numerics]\nintegrator = "scikits-odes"\n', "", ""))
    before = sorted(tmp_path.rglob("*"))
    for command in (["check", str(tmp_path)], ["run", str(tmp_path), "--out", str(tmp_path / "result")]):
        [line] = lines_of(capsys, command)
        assert "case.toml:2: numerics.integrator" in line
        assert "scikits-odes" in line
        assert 'use "scikit-sundae"' in line
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("values", ["cells = [3, 3, 3]", "cells = [4, 3, 200]", "mesh = 0.05", "mesh = 0.07"])
def test_coarsest_mesh_is_built_or_refused(values, tmp_path, capsys):
    """What the declared bounds allow must not end in a traceback."""
    written(tmp_path, Bad("", f"[numerics]\n{values}\n", "", ""))
    assert main(["check", str(tmp_path)]) in (0, 2)
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "value"),
    [
        (["runn", "x"], "runn"),
        (["run"], "CASE"),
        (["check"], "FILE"),
        (["check", "x", "--ot"], "--ot"),
        (["effects", "frction"], "frction"),
    ],
    ids=["command", "no case", "no file", "option", "effect"],
)
def test_bad_command_line(argv, value, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [line] = lines_of(capsys, argv)
    assert value in line


def test_result_that_exists_is_kept(tmp_path, capsys):
    written(tmp_path, Bad("", "", "", ""))
    kept = tmp_path / "result" / "note.txt"
    kept.parent.mkdir()
    kept.write_text("mine")
    [line] = lines_of(capsys, ["run", str(tmp_path), "--out", str(kept.parent)])
    assert str(kept.parent) in line
    assert "--overwrite" in line
    assert kept.read_text() == "mine"


KINDS = {
    "case": 'title = "a"\n[contact]\npressure = 1e5\n',
    "campaign": 'title = "a"\ncase = "case.toml"\n',
    "recording template": 'files = ["*.jpg"]\n',
}


@pytest.mark.parametrize("there", KINDS)
@pytest.mark.parametrize(
    ("wanted", "words"),
    [("case", ["check"]), ("campaign", ["compare"]), ("recording template", ["import"])],
    ids=lambda w: w if isinstance(w, str) else "",
)
def test_one_kind_of_file_in_the_place_of_another_is_told(there, wanted, words, tmp_path, capsys):
    file = tmp_path / "mine.toml"
    file.write_text(KINDS[there], encoding="utf-8")
    main([*words, str(file)])
    said = capsys.readouterr().err.splitlines()
    if there == wanted:
        assert not [line for line in said if "this is a" in line]
    else:
        assert len(said) == 1
        assert said[0].startswith(f"{file}: this is a {there}, not a {wanted}; ")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("contact.pressure=0,3MPa", "'0,3MPa'; write the number with a point: 0.3MPa"),
        ("pressure=3e5", "did you mean 'contact.pressure'?"),
        ("presure=3e5", "did you mean 'contact.pressure'?"),
        ("temperature=30", "did you mean 'ambient.temperature' or 'limits.temperature'?"),
        ("titel=a", "did you mean 'title'?"),
    ],
)
def test_what_a_newcomer_types_is_put_right(given, says, tmp_path, capsys):
    (tmp_path / "case.toml").write_text(KINDS["case"], encoding="utf-8")
    assert main(["check", str(tmp_path), given]) == 2
    assert says in capsys.readouterr().err


def test_a_folder_or_file_of_something_else_is_told(tmp_path, capsys):
    (tmp_path / "case.toml").write_text(KINDS["case"], encoding="utf-8")
    assert main(["compare", str(tmp_path)]) == 2
    assert "no campaign.toml in it, but case.toml; give" in capsys.readouterr().err
    (tmp_path / "side.nc").write_bytes(b"\x89HDF\r\n")
    assert main(["compare", str(tmp_path / "side.nc")]) == 2
    assert "side.nc: not UTF-8 text, so not TOML; give a .toml file" in capsys.readouterr().err
