"""HDF5 files of others, looked at before they are read: nothing outside the file, nothing too large for memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import h5py

from flashtemp.errors import BadInput, shorten_text

MAX_HDF5_ITEMS, MAX_HDF5_DEPTH = 10_000, 100  # the library takes seconds for a path of a thousand groups
MAX_ATTRIBUTE_BYTES = 4096  # bytes of an attribute that is looked at
INTERNAL_DATA_REMEDY = "save it anew with all data inside and give that"


def list_datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Every dataset by its path.

    Raises BadInput for links to other files, for data kept in other files and for more items than anybody reads.
    """
    found: dict[str, h5py.Dataset] = {}
    count = 0

    def find_link_fault(name: Any, about: Any) -> str | None:
        """What is wrong with a link; said after the visit, since the library loses what is raised in it."""
        nonlocal count
        count += 1
        if count > MAX_HDF5_ITEMS:
            return f"more than {MAX_HDF5_ITEMS} items in one file; give a part of it"
        if _decode_name(name).count("/") >= MAX_HDF5_DEPTH:
            return f"groups are nested more than {MAX_HDF5_DEPTH} deep; give the part with the data"
        if isinstance(about, h5py.ExternalLink):
            return f"'{_decode_name(name)}' is a link to another file ({shorten_text(str(about.filename))}); {INTERNAL_DATA_REMEDY}"
        return None

    def collect_dataset(name: Any, what: Any) -> None:
        if isinstance(what, h5py.Dataset):
            found[_decode_name(name)] = what

    if wrong := file.visititems_links(find_link_fault):
        raise BadInput(wrong)
    file.visititems(collect_dataset)
    return {name: require_internal_data(dataset) for name, dataset in found.items()}


def require_internal_data(dataset: h5py.Dataset) -> h5py.Dataset:
    """The dataset, if its data lie in its own file.  Raises BadInput."""
    made = dataset.id.get_create_plist()
    if made.get_external_count() or made.get_layout() == h5py.h5d.VIRTUAL:
        raise BadInput(f"'{_decode_name(dataset.name)}' keeps its data in another file; {INTERNAL_DATA_REMEDY}")
    return dataset


def check_hdf5_file(path: Any, wanted: Callable[[str], bool], allow: Callable[[int, str, bool], None]) -> None:
    """Look at a file before another library reads it: `allow` hears how many numbers `wanted` datasets
    hold, which, and whether of a usual kind.

    Raises BadInput as `list_datasets` and for what was not written to its end, whatever `allow` raises, and OSError for what
    is no HDF5.
    """
    with h5py.File(path) as file:
        for name, found in list_datasets(file).items():
            if wanted(name):
                allow(count_values_in_memory(found), f"'{name}' of shape {found.shape}", has_usual_type(found))
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


def count_values_in_memory(dataset: h5py.Dataset) -> int:
    """Numbers that are in memory while a dataset is read: its own, and one of its chunks."""
    size, chunk = int(dataset.size or 0), 1
    for side in dataset.chunks or ():
        chunk *= int(side)
    return size + chunk * bool(dataset.chunks)


def has_usual_type(dataset: h5py.Dataset) -> bool:
    """Whether the numbers of a dataset are of a kind that programs write: nothing else tells a damaged description."""
    kind = dataset.id.get_type()
    names = [f"IEEE_F{bits}" for bits in (16, 32, 64)] + [f"STD_{s}{bits}" for s in "IU" for bits in (8, 16, 32, 64)]
    return any(kind == getattr(h5py.h5t, name + order) for name in names for order in ("LE", "BE"))


def read_text_attribute(item: Any, name: str) -> str | None:
    """A short text attribute; None where there is none."""
    if name not in item.attrs or item.attrs.get_id(name).get_storage_size() > MAX_ATTRIBUTE_BYTES:
        return None
    value = item.attrs[name]
    value = value.decode("ascii", "replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else None


def _decode_name(name: Any) -> str:
    """A name for a message; a damaged one stays bytes."""
    return name if isinstance(name, str) else bytes(name).decode("latin-1")
