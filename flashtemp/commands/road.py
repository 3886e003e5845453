"""The command on the road: spots, from a topography to a contact map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from flashtemp.errors import BadInput
from flashtemp.terminal import DONE, Json, Switch, emit

LENGTH, WIDTH = 0.05, 0.02  # of a synthetic road, m


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
    from flashtemp import topography

    if (file is None) != synthetic:
        raise BadInput("spots: give one FILE of heights, or --synthetic")
    if out.suffix != ".npz" or not out.absolute().parent.is_dir():
        raise BadInput(f"--out: {out}; give a .npz file in a folder that exists")
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
        road = topography.synthetic(length, width, pixel, hurst, rms, rolloff, seed)
    else:
        road = topography.read(file, None if length is None else (length, width))
    found = topography.press(road, pressure, modulus, cutoff)
    found.save(out)
    emit(found.as_dict() | {"out": str(out)}, json, f"{found}\n  resolved_spots.contact_map: {out}")
    return DONE
