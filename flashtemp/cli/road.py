"""The commands on the road: spots, from a topography to a contact map; spectrum, from heights to C(q)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from flashtemp.cli.terminal import DONE, Json, Switch, emit
from flashtemp.errors import BadInput

LENGTH, WIDTH = 0.05, 0.02  # of a synthetic road, m
WHY = 120  # characters of what a reader has to say


def spots(
    file: Path | None = None,
    /,
    *,
    out: Path,
    cutoff: float,
    pressure: float = 1.5e5,
    modulus: float = 1.33e7,
    synthetic: Annotated[bool, Switch] = False,
    length: float | None = None,
    width: float | None = None,
    pixel: float = 1e-4,
    hurst: float = 0.85,
    rms: float = 3e-4,
    rolloff: float = 5e-3,
    seed: int = 1,
    json: Json = False,
) -> int:
    """Which macroasperity regions of a road touch: a contact map for resolved_spots.contact_map.

    Parameters
    ----------
    file
        Height map of an instrument, or a text matrix of heights in m with blanks between (any format of
        SurfaceTopography); x, the columns of a matrix, along the direction of sliding.
    out
        The contact map, a .npz file.
    cutoff
        Shortest wavelength of the road that counts, m: the magnification of the macroasperities.
    pressure
        Nominal contact pressure, Pa.
    modulus
        Contact modulus E/(1 - nu^2) of the rubber, Pa.
    synthetic
        A self-affine road instead of a file, of this length, width, pixel, hurst exponent, rms height and rolloff (m).
    length
        Of the road along x, m: 0.05 where it is synthetic; of a file only where that does not state it, with its width.
    width
        Of the road across, m: 0.02 where it is synthetic.
    """
    from flashtemp.physics.friction import contact_map

    if (file is None) != synthetic:
        raise BadInput("spots: give one FILE of heights, or --synthetic")
    if out.suffix != ".npz" or not out.absolute().parent.is_dir():
        raise BadInput(f"--out: {out}; give a .npz file in a folder that exists")
    if out.exists():
        raise BadInput(f"--out: {out} exists; choose another name")
    if synthetic:
        length, width = LENGTH if length is None else length, WIDTH if width is None else width
    elif (length is None) != (width is None):
        raise BadInput(
            f"--{'width' if width is None else 'length'}: missing; give both --length and --width, or neither"
        )
    given = {"pressure": pressure, "modulus": modulus, "cutoff": cutoff, "length": length, "width": width,
             "pixel": pixel, "hurst": hurst, "rms": rms, "rolloff": rolloff}  # fmt: skip
    for name, value in given.items():
        if value is not None and not 0.0 < value < float("inf") or (name == "hurst" and value > 1):
            raise BadInput(f"--{name}: {value:g}; give a number > 0" + (" and <= 1" if name == "hurst" else ""))
    if synthetic:
        road = contact_map.synthetic(length, width, pixel, hurst, rms, rolloff, seed)
    else:
        road = contact_map.read(file, None if length is None else (length, width))
    found = contact_map.press(road, pressure, modulus, cutoff)
    found.save(out)
    emit(found.as_dict() | {"out": str(out)}, json, f"{found}\n  resolved_spots.contact_map: {out}")
    return DONE


def spectrum(
    file: Path,
    /,
    *,
    out: Path,
    profile: Annotated[bool, Switch] = False,
    highpass: float | None = None,
    pixel: float | None = None,
    json: Json = False,
) -> int:
    """The power spectrum C(q) of a measured road, for persson_friction.spectrum, and a picture of it.

    Parameters
    ----------
    file
        Height map of an instrument (any format of SurfaceTopography), or a profile.
    out
        The spectrum, a new .csv file (q in 1/m, C in m^4); the picture stands beside it as .png.
    profile
        The file is one line: columns of distance and height with their units in the header.
    highpass
        Longest wavelength that counts, m; all that fit twice into the measurement if none is given.
    pixel
        The file holds nothing but heights in m (.npy or text, one row per line) at this distance, m.
    """
    from flashtemp.physics.friction import measured_roughness
    from flashtemp.physics.friction.elastic_contact import library
    from flashtemp.viz import spectrum as picture

    _new(out)
    for name, value in {"highpass": highpass, "pixel": pixel}.items():
        if value is not None and not 0.0 < value < float("inf"):
            raise BadInput(f"--{name}: {value:g}; give a number > 0")
    if not file.is_file():
        raise BadInput(f"{file}: not found; give a file of heights")
    library()
    longest = float("inf") if highpass is None else highpass
    heights, step = _heights(file, profile, pixel)
    heights = measured_roughness.without_spikes(heights)
    line = heights.ndim == 1
    points = (
        measured_roughness.of_profile(heights, step, longest)
        if line
        else measured_roughness.of_topography(heights, step, longest)
    )
    found = measured_roughness.Summary.of(points)
    told = found.as_dict() | {"missing": float((heights != heights).mean()), "out": str(out)}
    if line:
        told["rms_height_of_line_m"] = measured_roughness.profile_height(heights, step, longest)
    measured_roughness.save(points, out)
    told["picture"] = str(out.with_suffix(".png"))
    picture.draw(points, found.law, file.name).savefig(told["picture"])
    text = f"{found}\n  dropouts and spikes: {100 * told['missing']:.2g} % of the heights\n"
    if line:
        text += f"  rms height of the line itself: {1e3 * told['rms_height_of_line_m']:.3g} mm\n"
    emit(told, json, f"{text}  persson_friction.spectrum: {out}\n  picture: {told['picture']}")
    return DONE


def _new(out: Path) -> None:
    """BadInput where a spectrum cannot go, or where it or its picture would overwrite a file."""
    if out.suffix != ".csv" or not out.absolute().parent.is_dir():
        raise BadInput(f"--out: {out}; give a .csv file in a folder that exists")
    for path in (out, out.with_suffix(".png")):
        if path.exists():
            raise BadInput(f"--out: {path} exists; choose another name")


def _heights(file: Path, profile: bool, pixel: float | None):
    """Heights in m, (n,) of a line or (nx, ny), missing ones nan, and their distance in m."""
    import warnings

    import numpy as np

    from flashtemp.physics.friction import measured_roughness

    if pixel is not None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", UserWarning)  # an empty file
                bare = np.load(file) if file.suffix == ".npy" else np.loadtxt(file, encoding="utf-8-sig")
            bare = np.squeeze(np.asarray(bare, dtype=float))
        except (ValueError, TypeError, OSError, EOFError, UserWarning) as fault:
            raise BadInput(
                f"{file}: no table of heights in m with blanks between; leave out --pixel for files with a header"
            ) from fault
        if bare.ndim != (1 if profile else 2):
            raise BadInput(f"{file}: {bare.ndim} dimensions; give rows of heights, or one line with --profile")
        return bare, pixel
    if profile:
        return measured_roughness.read_profile(file)
    road = _area(file)
    heights = np.ma.filled(np.ma.asarray(road.heights()).astype(float), np.nan)
    return heights, tuple(s / n for s, n in zip(road.physical_sizes, heights.shape, strict=True))


def _area(file: Path):
    """The topography of a file; what keeps it from being read, with the remedies of `spectrum`.  Raises BadInput."""
    from textwrap import shorten

    from flashtemp.physics.friction import contact_map

    try:
        return contact_map.read(file)
    except BadInput as fault:
        why = str(fault).removeprefix(f"{file}: ").rpartition("; ")[0]
        if fault.__cause__ is not None:  # every reader says why the file is not of its format
            said = str(fault.__cause__)
            known = "no format that SurfaceTopography knows" if said.startswith("tried ") else said
            why = f"no topography: {shorten(known, WHY, placeholder=' ...')}"
        remedy = "give a height map of an instrument, --profile for columns of distance and height, or --pixel"
        raise BadInput(f"{file}: {why}; {remedy} for nothing but heights in m with blanks between") from fault
