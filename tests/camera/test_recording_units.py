"""Attributes of a NetCDF recording by CF conventions: obeyed, or refused in one line with the remedy."""

from __future__ import annotations

import numpy as np
import pytest

from flashtemp.camera.recording import Recording, load
from flashtemp.camera.sensors import positions_from_rows
from flashtemp.errors import BadInput

T = np.array([[[20.0, 25.0], [30.0, 40.0]], [[21.0, 26.0], [31.0, np.nan]]])
TIME, U, V = np.array([1.0, 2.5]), np.array([1e-3, 3e-3]), np.array([2e-3, 4e-3])


@pytest.fixture
def written(tmp_path):
    """A recording whose variables were changed by {name: function of the variable}, read again."""

    def read(points: bool = False, **changes):
        ds = (POINTS if points else IMAGES).to_dataset()
        for name, change in changes.items():
            ds[name] = change(ds[name])
        ds.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
        return load(tmp_path / "a.nc")

    return read


IMAGES = Recording("sidewall", T, TIME, np.array([1, 2]), U, V)
POINTS = Recording(
    "points", T[:, :1], TIME, np.array([1, 1]), np.arange(2.0), np.zeros(1),
    places=positions_from_rows([{"x": 0.01, "z": 0.002, "lag_s": 0.5}, {"x": 0.02, "z": 0.003, "gain_sigma": 0.02}]),
)  # fmt: skip


def unit(text, factor=1.0, offset=0.0):
    """A variable in another unit: its numbers and the attribute."""
    return lambda variable: (variable * factor + offset).assign_attrs(units=text)


def attributes(**attrs):
    return lambda variable: variable.assign_attrs(**attrs)


def encoded(**how):
    def change(variable):
        out = variable.copy()
        out.encoding = how
        return out

    return change


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("temperature", unit("K", 1, 273.15)), ("temperature", unit("kelvin", 1, 273.15)),
        ("temperature", unit("degF", 9 / 5, 32)), ("temperature", unit("degrees_Fahrenheit", 9 / 5, 32)),
        ("temperature", unit("celsius")), ("temperature", unit("degree_C")), ("temperature", unit("°C")),
        ("temperature", unit("F", 9 / 5, 32)), ("temperature", unit("mK", 1e3, 273150)),
        ("time", unit("ms", 1e3)), ("time", unit("min", 1 / 60)), ("time", unit("seconds")), ("time", unit("us", 1e6)),
        ("time", unit("hours", 1 / 3600)),
        ("u", unit("mm", 1e3)), ("u", unit("cm", 1e2)), ("v", unit("um", 1e6)), ("v", unit("inch", 1 / 0.0254)),
        ("u", unit("metre")), ("repetition", unit("")),
    ],
)  # fmt: skip
def test_a_unit_that_can_be_converted_is_obeyed(written, name, change):
    found = written(**{name: change})
    for own, true in ((found.temperature, T), (found.time, TIME), (found.u, U), (found.v, V)):
        np.testing.assert_allclose(own, true, rtol=1e-12)
    assert list(found.repetition) == [1, 2]


@pytest.mark.parametrize(
    ("name", "text", "factor", "field"),
    [("lag_s", "ms", 1e3, "lag_s"), ("x", "mm", 1e3, "x"), ("z", "cm", 1e2, "z"), ("gain_sigma", "%", 1e2, "gain_sigma"),
     ("place_sigma_m", "um", 1e6, "place_sigma_m")],
)  # fmt: skip
def test_units_of_points_are_obeyed(written, name, text, factor, field):
    found = written(points=True, **{name: unit(text, factor)})
    np.testing.assert_allclose(getattr(found.places, field), getattr(POINTS.places, field), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "remedy"),
    [
        ("temperature", "bananas", "degC"), ("temperature", "mV", "degC"), ("temperature", "count", "degC"),
        ("temperature", "1", "degC"), ("temperature", "", "degC"), ("temperature", "m**9**9**9", "degC"),
        ("temperature", "K s-1", "degC"), ("temperature", "W m-2", "degC"), ("temperature", "dB", "degC"),
        ("time", "seconds since 2024-05-31 12:00:00", "s from the first start of sliding"),
        ("time", "days since 1970-01-01", "s from the first start of sliding"),
        ("time", "m", "'s'"), ("time", "frames", "'s'"), ("time", "1", "'s'"), ("time", "Hz", "'s'"),
        ("u", "pixel", "'m'"), ("u", "degrees_east", "'m'"), ("v", "s", "'m'"), ("v", "hPa", "'m'"),
        ("repetition", "s", "'1'"), ("repetition", "mm", "'1'"), ("repetition", "seconds since 2024-05-31", "'1'"),
        ("temperature", 3.0, "'degC'"), ("time", [1, 2], "'s'"), ("time", "x" * 5000, "'s'"), ("time", "s\n", None),
    ],
    ids=lambda value: str(value)[:20],
)  # fmt: skip
def test_a_unit_that_cannot_be_converted_is_refused(written, tmp_path, name, text, remedy):
    if remedy is None:
        np.testing.assert_array_equal(written(**{name: attributes(units=text)}).time, TIME)
        return
    with pytest.raises(BadInput) as fault:
        written(**{name: attributes(units=text)})
    [line] = fault.value.lines
    assert line.startswith(f"{tmp_path / 'a.nc'}: {name}: units = ")
    assert remedy in line
    assert len(line) < 600


@pytest.mark.parametrize(
    ("name", "attrs", "said"),
    [
        ("temperature", {"standard_name": "air_pressure"}, "give the variable that holds temperature"),
        ("time", {"standard_name": "forecast_period"}, "give the variable that holds time"),
        ("temperature", {"units_metadata": "temperature: difference"}, "give temperatures, not differences"),
        ("v", {"positive": "down"}, "it increases upwards"),
        ("temperature", {"valid_range": "all"}, "give two numbers"),
        ("temperature", {"valid_range": [1.0, 2.0, 3.0]}, "give two numbers"),
    ],
)
def test_attributes_that_mean_something_else_are_refused(written, name, attrs, said):
    with pytest.raises(BadInput, match=said):
        written(**{name: attributes(**attrs)})


def test_attributes_that_say_the_same_are_accepted(written):
    found = written(
        temperature=attributes(standard_name="surface_temperature", units_metadata="temperature: on_scale", long_name="x"),
        time=attributes(standard_name="time", axis="T", calendar="standard"),
        v=attributes(positive="up", axis="Z"),
    )  # fmt: skip
    np.testing.assert_array_equal(found.temperature, T)


@pytest.mark.parametrize(
    "how",
    [
        {"dtype": "int16", "scale_factor": 0.01, "add_offset": 20.0, "_FillValue": np.int16(-32768)},
        {"dtype": "int16", "scale_factor": 0.01, "_FillValue": np.int16(-1), "missing_value": np.int16(-1)},
        {"dtype": "float32", "_FillValue": np.float32(-999.0)},
        {"dtype": "float64", "missing_value": -1e30, "_FillValue": -1e30},
    ],
    ids=str,
)
def test_packed_and_marked_values_are_unpacked(written, how):
    np.testing.assert_allclose(written(temperature=encoded(**how)).temperature, T, atol=1e-5)


def test_packed_kelvin_are_unpacked_and_converted(written):
    def change(variable):
        out = unit("K", 1.0, 273.15)(variable)
        out.encoding = {"dtype": "int16", "scale_factor": 0.01, "add_offset": 273.15, "_FillValue": np.int16(-32768)}
        return out

    np.testing.assert_allclose(written(temperature=change).temperature, T, atol=1e-9)


def test_values_outside_the_valid_range_are_missing(written):
    """CF 2.5.1: in terms of the packed values where these limits are whole numbers as they are."""

    def packed(variable):
        out = variable.assign_attrs(valid_range=np.array([0, 1050], np.int16))
        out.encoding = {"dtype": "int16", "scale_factor": 0.01, "add_offset": 20.0, "_FillValue": np.int16(-32768)}
        return out

    lost = np.where(T > 30.5, np.nan, T)
    for change in (attributes(valid_max=30.5), attributes(valid_range=[-10.0, 30.5]), packed):
        np.testing.assert_allclose(written(temperature=change).temperature, lost, atol=1e-9)


def test_durations_are_times(written):
    """As xarray writes them."""

    def change(variable):
        return ("frame", (variable.values * 1e3).astype("timedelta64[ms]").astype("timedelta64[ns]"))

    np.testing.assert_allclose(written(time=change).time, TIME)


def test_dates_are_refused(written):
    with pytest.raises(BadInput, match="is a date; give s from the first start of sliding"):
        written(time=lambda variable: ("frame", np.array(["2024-05-31T12:00", "2024-05-31T12:01"], "datetime64[ns]")))


def test_what_is_written_here_is_read_bit_by_bit(tmp_path):
    IMAGES.save(tmp_path / "a.nc")
    found = load(tmp_path / "a.nc")
    for name in ("temperature", "time", "u", "v", "repetition"):
        np.testing.assert_array_equal(getattr(found, name), getattr(IMAGES, name))
