"""HDF5 files of others, looked at before they are read: nothing outside the file, nothing too large for memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import h5py

from flashtemp.errors import BadInput, short

MOST_ITEMS, MOST_DEPTH = 10_000, 100  # the library takes seconds for a path of a thousand groups
MOST_TEXT = 4096  # bytes of an attribute that is looked at
INSIDE = "save it anew with all data inside and give that"


def datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Every dataset by its path.

    Raises BadInput for links to other files, for data kept in other files and for more items than anybody reads.
    """
    found: dict[str, h5py.Dataset] = {}
    count = 0

    def link(name: Any, about: Any) -> str | None:
        """What is wrong with a link; said after the visit, since the library loses what is raised in it."""
        nonlocal count
        count += 1
        if count > MOST_ITEMS:
            return f"more than {MOST_ITEMS} items in one file; give a part of it"
        if _word(name).count("/") >= MOST_DEPTH:
            return f"groups are nested more than {MOST_DEPTH} deep; give the part with the data"
        if isinstance(about, h5py.ExternalLink):
            return f"'{_word(name)}' is a link to another file ({short(str(about.filename))}); {INSIDE}"
        return None

    def item(name: Any, what: Any) -> None:
        if isinstance(what, h5py.Dataset):
            found[_word(name)] = what

    if wrong := file.visititems_links(link):
        raise BadInput(wrong)
    file.visititems(item)
    return {name: inside(dataset) for name, dataset in found.items()}


def inside(dataset: h5py.Dataset) -> h5py.Dataset:
    """The dataset, if its data lie in its own file.  Raises BadInput."""
    made = dataset.id.get_create_plist()
    if made.get_external_count() or made.get_layout() == h5py.h5d.VIRTUAL:
        raise BadInput(f"'{_word(dataset.name)}' keeps its data in another file; {INSIDE}")
    return dataset


def check(path: Any, wanted: Callable[[str], bool], allow: Callable[[int, str, bool], None]) -> None:
    """Look at a file before another library reads it: `allow` hears how many numbers `wanted` datasets
    hold, which, and whether of a usual kind.

    Raises BadInput as `datasets` and for what was not written to its end, whatever `allow` raises, and OSError for what
    is no HDF5.
    """
    with h5py.File(path) as file:
        for name, found in datasets(file).items():
            if wanted(name):
                allow(claimed(found), f"'{name}' of shape {found.shape}", usual(found))
                if not is_complete(found):
                    raise BadInput(f"'{name}' was not written to its end; save the file anew and give that")


def is_complete(dataset: h5py.Dataset) -> bool:
    """Whether all of a dataset was written, or what was not is marked as missing.

    HDF5 hands out the fill value for the rest, 0 unless another is set, and readers of NetCDF lengthen a variable by it
    to the size of its dimension.
    """
    is_number = dataset.dtype.kind == "f" and dataset.size
    if "_FillValue" in dataset.attrs or (is_number and math.isnan(dataset.fillvalue)):
        return True
    sizes = [scale.shape for dimension in dataset.dims for scale in dimension.values()]
    axes = [n for dimension, n in zip(dataset.dims, dataset.shape, strict=True) for _ in dimension.values()]
    if any(len(size) == 1 and size[0] > n for size, n in zip(sizes, axes, strict=True)):
        return False
    if not dataset.size:
        return True
    if dataset.chunks:
        needed = math.prod(-(-n // side) for n, side in zip(dataset.shape, dataset.chunks, strict=True))
        return bool(dataset.id.get_num_chunks() >= needed)
    return bool(dataset.id.get_storage_size() > 0)


def claimed(dataset: h5py.Dataset) -> int:
    """Numbers that are in memory while a dataset is read: its own, and one of its chunks."""
    size, chunk = int(dataset.size or 0), 1
    for side in dataset.chunks or ():
        chunk *= int(side)
    return size + chunk * bool(dataset.chunks)


def usual(dataset: h5py.Dataset) -> bool:
    """Whether the numbers of a dataset are of a kind that programs write: nothing else tells a damaged description."""
    kind = dataset.id.get_type()
    names = [f"IEEE_F{bits}" for bits in (16, 32, 64)] + [f"STD_{s}{bits}" for s in "IU" for bits in (8, 16, 32, 64)]
    return any(kind == getattr(h5py.h5t, name + order) for name in names for order in ("LE", "BE"))


def text(item: Any, name: str) -> str | None:
    """A short text attribute; None where there is none."""
    if name not in item.attrs or item.attrs.get_id(name).get_storage_size() > MOST_TEXT:
        return None
    value = item.attrs[name]
    value = value.decode("ascii", "replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else None


def _word(name: Any) -> str:
    """A name for a message; a damaged one stays bytes."""
    return name if isinstance(name, str) else bytes(name).decode("latin-1")
