"""Numbers with units where a case, a campaign, a sweep or a template gives a number; results stay SI."""

from __future__ import annotations

import contextlib
import math
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flashtemp
from flashtemp.__main__ import main
from flashtemp.camera.importing import import_options
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.cli import commands
from flashtemp.errors import BadInput
from flashtemp.model.schema import CASE_TABLES, COMMAND_TABLES, MATERIAL_KEYS
from flashtemp.physics import units
from flashtemp.physics.effect import catalogue
from flashtemp.runs.studies import sweep

DECLARED = {
    p.unit
    for table in (
        *CASE_TABLES.values(),
        *COMMAND_TABLES.values(),
        MATERIAL_KEYS,
        *(e.params() for e in catalogue().values()),
    )
    for p in table.values()
    if {"number", "amount", "amounts"} & set(p.kinds) and p.unit
}


@pytest.fixture
def case(tmp_path):
    (tmp_path / "case.toml").write_text("")
    return tmp_path / "case.toml"


@pytest.mark.parametrize("unit", sorted(DECLARED))
def test_every_declared_unit_is_known_as_it_is_written(unit):
    """W/mK is no milliwatt and no millikelvin."""
    assert unit == "1" or units.to_unit(f"2.5 {unit}", unit) == 2.5
    assert units.find_conversion(unit, unit) == (1.0, 0.0)
    assert units.is_unit(unit, unit)


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("contact.pressure", "0.3MPa", 3e5), ("contact.pressure", "2 bar", 2e5), ("block.length", "25 mm", 0.025),
        ("block.length", "1 inch", 0.0254), ("schedule.speed", "3.6 km/h", 1.0), ("schedule.wait", "2 min", 120.0),
        ("ambient.temperature", "68 degF", 20.0), ("ambient.temperature", "300 K", 26.85), ("contact.spot_fraction", "20 %", 0.2),
        ("ambient.convection", "20 W/(m^2 K)", 20.0), ("ambient.convection", "20 W/m2K", 20.0), ("numerics.atol", "3 mK", 3e-3),
        ("contact.alpha", "inf", math.inf),
    ],
)  # fmt: skip
def test_a_number_with_its_unit_is_the_number(case, key, text, value):
    assert flashtemp.load(case, {key: text})[key] == pytest.approx(value, rel=1e-12)
    assert flashtemp.load(case, [f"{key}={text}"])[key] == pytest.approx(value, rel=1e-12)
    table, _, name = key.partition(".")
    case.write_text(f'[{table}]\n{name} = "{text}"\n')
    assert flashtemp.load(case)[key] == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("contact.pressure", "3 mm", "'3 mm' is not a quantity in Pa"),
        ("block.length", "3 furlings", "the unit 'furlings' is not known; give a number in m"),
        ("contact.spot_fraction", "3 Pa", "is not a quantity without a unit"),
        ("block.length", "30 m", "30.0; give a number >= 0.0001 and <= 1 (m)"),
        ("schedule.repetitions", "3 s", "give a whole number"),
        ("block.material", "3 mm", "no material '3 mm'"),
        ("block.length", "1e400 mm", "give a number"),
    ],
)  # fmt: skip
def test_what_is_no_such_quantity_is_told_with_the_unit_expected(case, key, text, said):
    with pytest.raises(BadInput) as fault:
        flashtemp.load(case, {key: text})
    assert any(part in str(fault.value) for part in said.split("|")), str(fault.value)
    assert key in str(fault.value)


def test_standard_deviations_have_units_too(case):
    case.write_text(
        '[block]\nlength = { value = "25 mm", sd = "0.2 mm" }\n[ambient]\ntemperature = { value = "68 degF", sd = "0.9 degF" }\n'
    )
    loaded = flashtemp.load(case)
    assert loaded["block.length"] == 0.025
    assert loaded.priors == pytest.approx({"block.length": 2e-4, "ambient.temperature": 0.5})


def test_results_stay_plain(case):
    """What is written out of a case holds SI numbers."""
    text = flashtemp.load(case, {"contact.pressure": "0.3 MPa"}).toml({})
    assert tomllib.loads(text)["contact"]["pressure"] == 3e5


def test_a_sweep_has_plain_axes(case):
    axes, fixed = sweep.parse_axes(["contact.pressure=0.1MPa,0.2MPa", "block.length=20 mm"])
    asked = sweep.plan_sweep(case, axes, fixed)
    assert asked.axes == {"contact.pressure": (1e5, 2e5)}
    assert {p["block.length"] for p in asked.points} == {0.02}
    with pytest.raises(BadInput, match="twice"):
        sweep.plan_sweep(case, {"contact.pressure": ("0.1MPa", 1e5)}, {})


def test_points_and_templates_take_units(tmp_path):
    assert positions_from_rows([{"x": "10 mm", "z": "2 mm", "lag_s": "500 ms"}]).as_rows()[0]["lag_s"] == 0.5
    with pytest.raises(BadInput, match="point 1: z: '2 s' is not a quantity in m"):
        positions_from_rows([{"z": "2 s"}])
    (tmp_path / "t.toml").write_text(
        'files = ["a.csv"]\nreflected = "293.15 K"\nfps = "30 Hz"\nblock = ["2.5 cm", 7]\n'
    )
    facts = import_options.load_template(tmp_path / "t.toml")[2]
    assert (facts.reflected, facts.fps, facts.block) == (pytest.approx(20.0), 30.0, (25.0, 7.0))


def test_a_file_is_no_quantity(case):
    (case.parent / "2.csv").write_text("0,1e5\n1,2e5\n")
    assert flashtemp.load(case, {"contact.pressure": "2.csv"})["contact.pressure"] == "2.csv"


def test_the_command_line_takes_units(case, capsys):
    assert main(["check", str(case), "contact.pressure=0.3MPa", "block.length=30 mm"]) == 0
    assert main(["check", str(case), "contact.pressure=0.3 m"]) == 2
    assert "contact.pressure (command line): '0.3 m' is not a quantity in Pa" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "plain"),
    [
        (["spots", "--cutoff", "1mm", "--pressure=0.15 MPa"], ["spots", "--cutoff", "0.001", "--pressure=150000.0"]),
        (["wait", "case", "--below", "333.15 K"], ["wait", "case", "--below", "60.0"]),
        (["view", "run", "--time", "1e-3"], ["view", "run", "--time", "1e-3"]),
        (["import", "a.csv", "--exposure", "1e-2", "--start", "1e-3 s"], ["import", "a.csv", "--exposure", "1e-2", "--start", "0.001"]),
        (["run", "case", "--out", "3 m"], ["run", "case", "--out", "3 m"]),
        ([], []),
    ],
    ids=lambda w: w[0] if w else "",
)  # fmt: skip
def test_options_of_commands_take_units(words, plain):
    assert commands.strip_units(words) == plain


def test_an_option_in_another_unit_is_told(capsys):
    assert main(["spots", "--synthetic", "--cutoff", "1 s", "--out", "a.npz"]) == 2
    assert capsys.readouterr().err == "cutoff: '1 s' is not a quantity in m; give a unit that converts to it\n"
    assert main(["spots"]) == 2
    assert "See flashtemp spots --help." in capsys.readouterr().err


HOSTILE = (
    "5 m**9**9**9", "5 m^9^9", "5 m*2**999999999/2**999999999", "5 m**999", "5 m99", "1 dB", "5 bit", "3 count", "4 byte",
    "1 Np", "2 decade", "5 m{}", "5 m[0]", "5 m\x00", "5 m\n*2", "5 (m", "5 m)", "5 m()", "5 ((((m))))", "5 m/", "5 m//s",
    "5 m*", "5 m;m", "5 sqrt(m)", "5 __import__", "5 m.__class__", "5 c s", "5 m%", "5 m" + "/m*m" * 9,
    "5 " + "m " * 19, "5 m 2", "5 m2m", "5 m-", "5 m**", "5 m^-", "5 lambda", "5 m if s", "5 °", "5 %%",
    "5 m\u0308", "5 \u202em", "5 m**1e9", "5 m**0x9",
)  # fmt: skip


@pytest.mark.parametrize("text", HOSTILE, ids=lambda _: "")
def test_what_is_no_product_of_named_units_is_refused(text):
    for unit in ("m", "1"):
        with pytest.raises(BadInput):
            units.to_unit(text, unit)


SIGNS = st.sampled_from(
    list("mskKCFgNPaWJ%°µ12 9*/^.()-+e\u00b2\u207b\x00{}[]_") + ["**", "degC", "h", "in", "H2O", " per "]
)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(text=st.lists(SIGNS, max_size=24).map("".join) | st.text(max_size=80), unit=st.sampled_from(sorted(DECLARED)))
def test_any_text_is_a_unit_or_bad_input(text, unit):
    assert units.looks_like_quantity(f"5 {text}") in (True, False)
    for convert in (lambda: units.to_unit(f"5 {text}", unit), lambda: sum(units.find_conversion(text, unit))):
        with contextlib.suppress(BadInput):
            assert math.isfinite(convert())
    assert units.is_unit(text, unit) in (True, False)


WRITTEN = [  # by loggers, cameras, tables and NetCDF files: spellings, unit wanted, what 2 of them are in it
    ("degC|°C|C|c|deg C|Celsius|celsius|CELSIUS|degrees Celsius|degree_Celsius|℃|º C|Â°C|\ufffdC|deg. C", "degC", 2.0),
    ("K|k|Kelvin|kelvins|°K", "degC", -271.15),
    ("degF|°F|F|deg F|Fahrenheit|degrees_Fahrenheit|℉", "degC", -150 / 9),
    ("mK", "degC", -273.148),
    ("s|S|sec|secs|Sec|SEC|second|seconds|Seconds", "s", 2.0),
    ("ms|msec|MSEC|msecs|millisecond|milliseconds|Milliseconds", "s", 2e-3),
    ("us|µs|μs|usec|microseconds", "s", 2e-6),
    ("min|mins|Min|MIN|minute|minutes", "s", 120.0),
    ("h|hr|hrs|HR|hour|hours", "s", 7200.0),
    ("m/s|m s-1|m s^-1|m.s-1|m·s⁻¹|m*s**-1|meters per second|mps", "m/s", 2.0),
    ("mm/s|mm s-1", "m/s", 2e-3),
    ("km/h|kph|kmh|km/hr|km h-1", "m/s", 2 / 3.6),
    ("mph|mi/h", "m/s", 0.89408),
    ("m/min", "m/s", 2 / 60),
    ("m|meter|metres", "m", 2.0),
    ("mm|millimetres", "m", 2e-3),
    ("um|µm|μm|micron|microns", "m", 2e-6),
    ("in|inch|inches", "m", 0.0508),
    ("W/mK|W/m K|W/(m K)|W m-1 K-1|W/(m·K)|W/m/K|W/m°C|W/(m deg C)", "W/mK", 2.0),
    ("N/mm²|MPa", "Pa", 2e6),
    ("bar", "Pa", 2e5),
    ("cmH2O", "Pa", 196.133),
]


@pytest.mark.parametrize(
    ("text", "unit", "two"), [(text, unit, two) for texts, unit, two in WRITTEN for text in texts.split("|")]
)
def test_units_as_they_are_written_in_files(text, unit, two):
    factor, offset = units.find_conversion(text, unit)
    assert 2 * factor + offset == pytest.approx(two, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "unit"),
    [(t, "degC") for t in ("mV", "V", "%", "s", "m", "", "bananas", "1/K", "raw")]
    + [(t, "s") for t in ("m", "M", "MS", "Hz", "1", "rpm", "degC", "seconds since 2024-01-01")]
    + [(t, "m") for t in ("px", "s", "m2", "mm/s")]
    + [(t, "1") for t in ("rad", "deg", "dB", "bit", "count", "pi", "m")]
    + [("rpm", "1/s"), ("Pas", "Pa"), ("MBAR", "Pa")],
)
def test_a_unit_of_another_dimension_is_refused(text, unit):
    assert not units.is_unit(text, unit)
    with pytest.raises(BadInput):
        units.find_conversion(text, unit)


def test_keys_in_kelvin_are_differences(case):
    assert flashtemp.load(case, {"numerics.atol": "0.002 degC"})["numerics.atol"] == 0.002
    assert flashtemp.load(case, {"numerics.atol": "0.0018 degF"})["numerics.atol"] == pytest.approx(0.001)
