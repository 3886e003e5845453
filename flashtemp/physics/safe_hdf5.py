"""Check HDF5 files before they are read: no data outside the file, nothing too large for memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import h5py

from flashtemp.errors import BadInput, shorten_text

MAX_HDF5_ITEMS, MAX_HDF5_DEPTH = 10_000, 100  # the library takes seconds for a path of a thousand groups
MAX_ATTRIBUTE_BYTES = 4096  # longest text attribute that is read
INTERNAL_DATA_REMEDY = "save it again with all data inside and give that file"


def list_datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Every dataset by its path.

    Raises BadInput for links to other files, for data stored in other files and for too many items or levels.
    """
    found: dict[str, h5py.Dataset] = {}
    count = 0

    def find_link_fault(name: Any, about: Any) -> str | None:
        """The fault of a link, returned as text because the library discards exceptions raised during the visit."""
        nonlocal count
        count += 1
        if count > MAX_HDF5_ITEMS:
            return f"more than {MAX_HDF5_ITEMS} items in one file; give a part of it"
        if _decode_name(name).count("/") >= MAX_HDF5_DEPTH:
            return f"groups are nested more than {MAX_HDF5_DEPTH} deep; give the part with the data"
        if isinstance(about, h5py.ExternalLink):
            target = shorten_text(str(about.filename))
            return f"'{_decode_name(name)}' is a link to another file ({target}); {INTERNAL_DATA_REMEDY}"
        return None

    def collect_dataset(name: Any, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[_decode_name(name)] = item

    if fault := file.visititems_links(find_link_fault):
        raise BadInput(fault)
    file.visititems(collect_dataset)
    return {name: require_internal_data(dataset) for name, dataset in found.items()}


def require_internal_data(dataset: h5py.Dataset) -> h5py.Dataset:
    """The dataset, checked to have its data in its own file.  Raises BadInput."""
    creation = dataset.id.get_create_plist()
    if creation.get_external_count() or creation.get_layout() == h5py.h5d.VIRTUAL:
        raise BadInput(f"'{_decode_name(dataset.name)}' keeps its data in another file; {INTERNAL_DATA_REMEDY}")
    return dataset


def check_hdf5_file(path: Any, wanted: Callable[[str], bool], allow: Callable[[int, str, bool], None]) -> None:
    """Check a file before another library reads it.

    `allow(count, text, is_usual)` is called for every dataset whose name is `wanted`: the values it needs in memory, a
    description for messages, and whether its number type is common.  Raises BadInput as `list_datasets` does and for
    incomplete datasets, whatever `allow` raises, and OSError for a file that is not HDF5.
    """
    with h5py.File(path) as file:
        for name, found in list_datasets(file).items():
            if wanted(name):
                allow(count_values_in_memory(found), f"'{name}' of shape {found.shape}", has_usual_type(found))
                if not is_complete(found):
                    raise BadInput(f"'{name}' was not written completely; save the file again and give that")


def is_complete(dataset: h5py.Dataset) -> bool:
    """Whether a dataset was written completely, or its missing part is marked as missing.

    HDF5 returns the fill value for missing data, 0 unless another is set.  Readers of NetCDF extend a variable by it to
    the size of its dimension.
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
    """Numbers in memory while a dataset is read: the whole dataset and one of its chunks."""
    size, chunk = int(dataset.size or 0), 1
    for side in dataset.chunks or ():
        chunk *= int(side)
    return size + chunk * bool(dataset.chunks)


def has_usual_type(dataset: h5py.Dataset) -> bool:
    """Whether a dataset has a common number type; a damaged type description shows in no other way."""
    kind = dataset.id.get_type()
    names = [f"IEEE_F{bits}" for bits in (16, 32, 64)] + [f"STD_{s}{bits}" for s in "IU" for bits in (8, 16, 32, 64)]
    return any(kind == getattr(h5py.h5t, name + order) for name in names for order in ("LE", "BE"))


def read_text_attribute(item: Any, name: str) -> str | None:
    """A text attribute of at most `MAX_ATTRIBUTE_BYTES`; None where there is none."""
    if name not in item.attrs or item.attrs.get_id(name).get_storage_size() > MAX_ATTRIBUTE_BYTES:
        return None
    value = item.attrs[name]
    value = value.decode("ascii", "replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else None


def _decode_name(name: Any) -> str:
    """A name as text; undecodable bytes are read as Latin-1."""
    return name if isinstance(name, str) else bytes(name).decode("latin-1")
