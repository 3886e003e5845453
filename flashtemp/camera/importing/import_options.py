"""Import options: what the user states on the command line or in a recording template (TOML), with the same names."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from flashtemp.errors import BadInput, suggest_name
from flashtemp.model import file_kinds
from flashtemp.model.case_file import read_toml
from flashtemp.physics import units

CHOICES = {
    "view": ("sidewall", "wake", "profile", "points"),
    "downstream": ("right", "left", "up", "down"),
    "up": ("up", "down", "left", "right"),
    "unit": ("degC", "K", "mK", "degF"),
    "decimal": ("comma", "point"),
    "dead_pixels": ("find", "keep"),
    "labels": ("none", "columns", "rows", "both"),
}
IMPORT_OPTION_UNITS = {  # of options that are numbers
    "mm_per_pixel": "mm", "at": "mm", "crop": "mm", "block": "mm", "start": "s", "starts": "s", "fps": "1/s",
    "emissivity": "1", "reflected": "degC", "air": "degC", "humidity": "1", "distance": "m", "window": "1",
    "window_temperature": "degC", "offset": "degC", "below": "degC", "exposure": "s", "netd": "K",
    "fixed_pattern": "K", "band": "K", "psf_sigma": "px", "registration_sigma": "px",
}  # fmt: skip
Direction = Literal["right", "left", "up", "down"]


@dataclass(frozen=True)
class ImportOptions:
    """Facts that camera files may not contain; None where not stated.

    Parameters
    ----------
    view
        Side wall (u = x, v = z), wake (road behind the block, v = y), profile (block surface along x), thermocouples.
    places
        CSV file of thermocouples: column, name, x, y, z, lag_s, lag_sigma_s, place_sigma_m, depth_sigma_m,
        gain_sigma, zero_sigma_K.
    downstream
        Where u points in the image: downstream, from the leading edge to the trailing edge.
    up
        Where v points in the image: away from the road (sidewall), to the side that counts as +y (wake).
    pixel
        Column and row of the known point: the leading edge at the interface, counted from 0 at the upper left.
    at
        u and v of that point in mm, where it is another one.
    mm_per_pixel
        Size of a pixel on the object, mm.
    second
        A second known point instead: column, row, u mm, v mm.
    point
        A marked point: column, row, u mm, v mm; give four or more for an image seen at an angle.
    crop
        Keep only u0 u1 v0 v1, mm.
    mask_box
        Foreign pixels to leave out: column, row, column, row.
    mask
        File with a matrix that is not 0 where a pixel is dead or foreign.
    dead_pixels
        find dead pixels by comparing with neighbours (default), or keep all.
    start
        Time of the first frame, s from the first start of sliding.
    zero
        When sliding first began on the camera's clock, as 2024-05-31T12:00:03.25.
    fps
        Frames per second.
    times
        CSV file with columns file,time[,repetition]; time in s from the first start of sliding.
    time_column
        Name or number of the column of the time in a table of thermocouples.
    repetition
        Number of the repetition that all frames belong to, from 1.
    starts
        Times at which the repetitions begin to slide, s.
    case
        Case file: gives the starts of the repetitions and the block's outline.
    block
        Length and height of the block for the outline, mm.
    every
        Keep one frame of so many.
    emissivity
        Emissivity of the surface.
    reflected
        Reflected apparent temperature, degC.
    air
        Temperature of the air, degC.
    humidity
        Relative humidity, 0 to 1.
    distance
        Distance to the object, m.
    window
        Transmission of a window before the camera.
    window_temperature
        Temperature of that window, degC.
    planck
        Calibration R1 R2 B F O of a radiometric file.
    was
        Parameters that exported temperatures were computed with, as --was.emissivity 0.95 --was.reflected 20.
    band
        Planck constant B of the camera's band for exported temperatures, K: 1428 (8 to 14 um), about 3000 (3 to 5 um).
    scale
        degC per count of a TIFF.
    offset
        degC of count 0 of a TIFF, often -273.15.
    unit
        Unit of temperatures where the file does not say.
    variable
        Which array of a MATLAB or HDF5 file.
    decimal
        Decimal comma or point of a text file.
    below
        Temperatures of a text file at or under this are below the camera's range, degC.
    rows
        Rows of a text file that holds a part of an image.
    labels
        Labels around the matrix of a text file: none, columns (above), rows (at the side) or both.
    limit
        GB of memory that reading one file may take, 1 unless said.
    netd
        Noise of one pixel of one frame, K.
    fixed_pattern
        Scatter between pixels that stays, K.
    psf_sigma
        Blur of the optics, standard deviation in pixels.
    exposure
        Exposure or time constant, s.
    registration_sigma
        How well the origin is known, pixels.
    """

    view: Literal["sidewall", "wake", "profile", "points"] | None = None
    places: Path | None = None
    downstream: Direction | None = None
    up: Direction | None = None
    pixel: tuple[float, float] | None = None
    at: tuple[float, float] | None = None
    mm_per_pixel: float | None = None
    second: tuple[float, float, float, float] | None = None
    point: tuple[tuple[float, float, float, float], ...] | None = None
    crop: tuple[float, float, float, float] | None = None
    mask_box: tuple[tuple[int, int, int, int], ...] | None = None
    mask: Path | None = None
    dead_pixels: Literal["find", "keep"] | None = None
    start: float | None = None
    zero: str | None = None
    fps: float | None = None
    times: Path | None = None
    time_column: str | None = None
    repetition: int | None = None
    starts: tuple[float, ...] | None = None
    case: Path | None = None
    block: tuple[float, float] | None = None
    every: int | None = None
    emissivity: float | None = None
    reflected: float | None = None
    air: float | None = None
    humidity: float | None = None
    distance: float | None = None
    window: float | None = None
    window_temperature: float | None = None
    planck: tuple[float, float, float, float, float] | None = None
    was: dict[str, float] | None = None
    band: float | None = None
    scale: float | None = None
    offset: float | None = None
    unit: Literal["degC", "K", "mK", "degF"] | None = None
    variable: str | None = None
    decimal: Literal["comma", "point"] | None = None
    below: float | None = None
    rows: int | None = None
    labels: Literal["none", "columns", "rows", "both"] | None = None
    limit: float | None = None
    netd: float | None = None
    fixed_pattern: float | None = None
    psf_sigma: float | None = None
    exposure: float | None = None
    registration_sigma: float | None = None

    @property
    def block_outline(self) -> tuple[float, float] | None:
        """Length and height of the block, m, from the option or the case.  Raises BadInput."""
        if self.block is not None:
            if not all(0 < side < math.inf for side in self.block):
                raise BadInput(f"block: {self.block}; give length and height in mm, greater than zero")
            return 1e-3 * self.block[0], 1e-3 * self.block[1]
        if self.case is None:
            return None
        from flashtemp.model.case import NO_EFFECTS, load_case

        case = load_case(self.case, NO_EFFECTS)
        return case["block.length"], case["block.height"]

    def merged_over(self, other: ImportOptions) -> ImportOptions:
        """These options where they are stated, those of `other` elsewhere."""
        return replace(other, **{f.name: v for f in fields(self) if (v := getattr(self, f.name)) is not None})


def option_name(name: str) -> str:
    """Name of an option on the command line."""
    return "--" + name.replace("_", "-")


TEMPLATE_EXAMPLE: dict[str, dict[str, str]] = {  # group: {key: value}; a leading # marks a key that is commented out
    "the files": {"files": '["*.jpg"]', "out": '"side.nc"', "#every": "1"},
    "the place": {
        "view": '"sidewall"', "downstream": '"right"', "up": '"up"', "pixel": "[12.0, 200.0]", "mm_per_pixel": "0.2",
        "#at": "[0.0, 0.0]", "#second": "[137.0, 200.0, 25.0, 0.0]",
        "#point": "[[12, 200, 0, 0], [137, 200, 25, 0], [137, 150, 25, 10], [12, 150, 0, 10]]",
        "#crop": "[0.0, 25.0, 0.2, 10.0]", "#block": "[25.0, 10.0]", "#mask_box": "[[0, 0, 30, 20]]",
        "#mask": '"mask.csv"', "#dead_pixels": '"find"', "#places": '"places.csv"',
    },
    "the time": {
        "start": "0.0", "repetition": "1", "#zero": '"2024-05-31T12:00:03.25"', "#fps": "30.0", "#times": '"times.csv"',
        "#time_column": '"Time"',
        "#starts": "[0.0, 45.0, 90.0]", "#case": '"../case.toml"',
    },
    "object, air, window; leave out what the file says rightly": {
        "#emissivity": "0.95", "#reflected": "20.0", "#air": "20.0", "#humidity": "0.5", "#distance": "0.5",
        "#window": "1.0", "#window_temperature": "20.0", "#was": "{ emissivity = 0.95, reflected = 20.0 }",
        "#band": "1428.0", "#planck": "[14906.2, 0.0108, 1396.6, 1.0, -7261.0]",
    },
    "the file's numbers, where the file does not say": {
        "#scale": "0.04", "#offset": "-273.15", "#unit": '"degC"', "#variable": '"temperature"', "#decimal": '"comma"',
        "#below": "-40.01", "#rows": "100", "#labels": '"both"', "#limit": "1.0",
    },
    "the camera": {
        "#netd": "0.05", "#fixed_pattern": "0.05", "#psf_sigma": "0.7", "#exposure": "0.01",
        "#registration_sigma": "0.5",
    },
}  # fmt: skip
OWN_HELP = {
    "files": "Patterns in the folder of this file, in order of their names.",
    "out": "The recording, in the folder of this file.",
}


def template_text() -> str:
    """The commented recording template."""
    helps = {**_option_helps(), **OWN_HELP}
    lines = [
        "# Recording template of flashtemp: flashtemp import recording.toml",
        "# Options of the command line go first.",
    ]
    for group, keys in TEMPLATE_EXAMPLE.items():
        lines += ["", f"# --- {group}"]
        for key, value in keys.items():
            name, off = key.lstrip("#"), "# " if key.startswith("#") else ""
            lines += [f"# {helps[name]}", f"{off}{name} = {value}"]
    return "\n".join(lines)


def _option_helps() -> dict[str, str]:
    """{option: help in one line} from the docstring of `ImportOptions`, where help is indented."""
    helps: dict[str, str] = {}
    name = ""
    for line in (inspect.getdoc(ImportOptions) or "").split("----------\n")[-1].splitlines():
        if line.startswith(" "):
            helps[name] = f"{helps[name]} {line.strip()}".strip()
        else:
            name = line
            helps[name] = ""
    return helps


def load_template(path: Path) -> tuple[list[str], str | None, ImportOptions]:
    """File patterns, output and options of a template; its file names are relative to its folder.

    Raises BadInput with every fault at once, one line each.
    """
    try:
        _, raw = read_toml(path)
    except OSError as fault:
        raise BadInput(f"{path}: no such file; give a recording template or write one with --template") from fault
    file_kinds.require_kind(file_kinds.TEMPLATE_KIND, raw, path, path.name)
    known = {f.name: f.type for f in fields(ImportOptions)}
    faults, values = [], {}
    files, out = raw.pop("files", None), raw.pop("out", None)
    if not isinstance(files, list) or not files or not all(isinstance(f, str) for f in files):
        faults.append(f'{path}: files: {"missing" if files is None else repr(files)}; give a list like ["*.jpg"]')
    if out is not None and not isinstance(out, str):
        faults.append(f"{path}: out: {out!r}; give a file name in quotes")
    for key, value in raw.items():
        if key not in known:
            faults.append(f"{path}: {key}: unknown key{suggest_name(key, [*known, 'files', 'out'])}")
            continue
        try:
            values[key] = _parse_value(key, str(known[key]), value, path.parent)
        except BadInput as fault:
            faults.append(f"{path}: {fault}")
    if faults:
        raise BadInput(*faults)
    return files, None if out is None else str(path.parent / out), ImportOptions(**values)


def _parse_value(key: str, kind: str, value: Any, folder: Path) -> Any:
    """A TOML value as the type of its option.  BadInput states the valid form."""
    if key in CHOICES:
        if value not in CHOICES[key]:
            raise BadInput(f"{key}: {value!r}; give {', '.join(CHOICES[key])}")
        return value
    if kind.startswith("Path") or kind.startswith("str"):
        if not isinstance(value, str):
            raise BadInput(f"{key}: {value!r}; give text in quotes")
        return folder / value if kind.startswith("Path") else value
    if kind.startswith("dict"):
        if not isinstance(value, dict):
            raise BadInput(f"{key}: {value!r}; give {{ emissivity = 0.95, reflected = 20.0 }}")
        return {k: _parse_number(f"{key}.{k}", v) for k, v in value.items()}
    if kind.startswith("tuple[tuple"):
        if not isinstance(value, list):
            raise BadInput(f"{key}: {value!r}; give a list of lists of 4 numbers")
        return tuple(_parse_row(key, row, 4) for row in value)
    if kind.startswith("tuple"):
        return _parse_row(key, value, None if "..." in kind else kind.count("float"))
    number = _parse_number(key, value)
    if kind.startswith("int") and number != int(number):
        raise BadInput(f"{key}: {value!r}; give a whole number")
    return int(number) if kind.startswith("int") else number


def _parse_row(key: str, value: Any, length: int | None) -> tuple[float, ...]:
    if not isinstance(value, list) or (length is not None and len(value) != length) or not value:
        raise BadInput(f"{key}: {value!r}; give a list of {length or 'one or more'} numbers")
    return tuple(_parse_number(key, v) for v in value)


def _parse_number(key: str, value: Any) -> float:
    if units.looks_like_quantity(value) and key.split(".")[-1] in IMPORT_OPTION_UNITS:
        try:
            return units.to_unit(value, IMPORT_OPTION_UNITS[key.split(".")[-1]])
        except BadInput as fault:
            raise BadInput(f"{key}: {fault}") from fault
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value or abs(value) == float("inf"):
        raise BadInput(f"{key}: {value!r}; give a number")
    return float(value)
