"""Choice of camera files: drop zone, cards of the files in the folder with thumbnails, and an example to try."""

from __future__ import annotations

import os
import re
from base64 import b64encode
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

import numpy as np
from nicegui import events, run, ui

from flashtemp.camera.importing.file_preview import iter_frames
from flashtemp.camera.importing.import_options import ImportOptions, load_template
from flashtemp.camera.importing.import_request import expand_patterns
from flashtemp.display import format_count
from flashtemp.errors import BadInput
from flashtemp.lab.page_layout import action, heading, page_address, refuse_damaged, show_errors
from flashtemp.lab.saving import (
    MAX_UPLOAD_BYTES,
    MAX_UPLOAD_FILES,
    UPLOAD_LIMIT,
    check_upload_name,
    read_text,
    write_upload,
)
from flashtemp.lab.workspace import (
    CAMERA_SUFFIXES,
    MAX_LINE_BYTES,
    TABLE_SUFFIXES,
    escape_control,
    find_own_file,
    free_name,
    list_folder,
    resolve_inside,
)

UPLOAD_FOLDER = "camera"  # name of the folder for several files uploaded at once
EXAMPLE_FOLDER = "camera_example"
MAX_CARDS = 24  # of camera files that are shown with a thumbnail
THUMBNAIL_PX = 160
OPTICS_SD_PX = 0.8  # point spread of the example
FORMATS = "FLIR JPEG, FFF, SEQ and CSQ, InfraTec IRB, 16-bit TIFF and PNG, CSV and text, MATLAB and HDF5"
DROP_ZONE = """
    <div class="ft-dropzone">
        <div v-if="!props.isUploading"><b>Drop camera files here or choose them</b></div>
        <div v-if="!props.isUploading" class="ft-muted ft-small">{formats}</div>
        <q-btn v-if="!props.isUploading" outline no-caps color="primary" label="Choose files" icon="upload_file"
               @click="props.pickFiles" />
        <span style="display: none"><q-uploader-add-trigger /></span>
        <div v-if="props.isUploading" role="status">
            Storing the files: {{ Math.round(100 * props.uploadProgress) }} % of {{ props.uploadSizeLabel }}</div>
        <q-linear-progress v-if="props.isUploading" :value="props.uploadProgress" rounded
                           aria-label="progress of the upload" />
    </div>
"""


def find_camera_files(folder: Path, names: list[str]) -> list[Path]:
    """The camera files of names, patterns and folders; links must not lead out of the folder.  Raises BadInput."""
    files = expand_patterns([str(resolve_inside(folder, name)) for name in names])
    for file in files:
        name = str(file.relative_to(folder.resolve()))
        path = resolve_inside(folder, name)
        if not path.exists():
            raise BadInput(f"{escape_control(name)}: no such file; choose another, or copy it into the folder again")
        if not path.is_file():
            raise BadInput(f"{escape_control(name)}: neither a file nor a folder of files; give a camera file")
    return files


def check_stated_files(folder: Path, facts: ImportOptions) -> None:
    """Check that the tables, the mask and the case of a template lie inside the folder.  Raises BadInput."""
    for field in fields(ImportOptions):
        if isinstance(path := getattr(facts, field.name), Path):
            try:
                resolve_inside(folder, os.path.relpath(path, folder.resolve()))
            except ValueError as fault:  # a NUL byte
                raise BadInput(f"{field.name}: {escape_control(str(path))!r}: not a valid file name") from fault


def find_templates_of(folder: Path, name: str, templates: Iterable[str]) -> list[str]:
    """Those of the recording templates that are made for just the camera files of a name, pattern or folder."""
    out = []
    for template in templates:
        place = Path(template).parent
        try:
            read_text(folder, template)  # checks that it is a short regular file before it is parsed
            names, _, _ = load_template(resolve_inside(folder, template))
            if set(find_camera_files(folder, [str(place / n) for n in names])) == set(
                find_camera_files(folder, [name])
            ):
                out.append(template)
        except (BadInput, OSError):
            continue
    return out


def find_time_tables(folder: Path) -> dict[str, Path]:
    """Tables whose header names file and time, by their names in the folder."""
    out: dict[str, Path] = {}
    listing = list_folder(folder)
    for path in (*listing.tables, *listing.images):
        file = find_own_file(folder, path) if path.suffix.lower() in TABLE_SUFFIXES else None
        if file is None:
            continue
        try:
            if has_time_header(file):
                out[str(path)] = file
        except OSError:
            continue
    return out


def has_time_header(file: Path) -> bool:
    """Whether the first line of a text file names the columns file and time."""
    with file.open("rb") as opened:
        words = re.findall(r"[a-z]+", opened.readline(MAX_LINE_BYTES).decode("latin-1").lower())
    return {"file", "time"} <= set(words)


class UploadArea:
    """The zone in which camera files are dropped; it stores them in the folder and opens them."""

    def __init__(self, folder: Path):
        self.folder = folder

    def show(self) -> None:
        """Show the zone."""
        zone = ui.upload(
            multiple=True, auto_upload=True, on_multi_upload=self._store_files, max_total_size=MAX_UPLOAD_BYTES,
            max_files=MAX_UPLOAD_FILES,
        ).on_rejected(_notify_rejected)  # fmt: skip
        zone.classes("ft-drop w-full").props("flat").props["accept"] = ",".join(sorted(CAMERA_SUFFIXES))
        zone.add_slot("header", DROP_ZONE.replace("{formats}", FORMATS))

    async def _store_files(self, event: events.MultiUploadEventArguments) -> None:
        """Store uploaded files in the folder and open them: one under its own name, several in a new folder."""
        files = [f for f in event.files if Path(f.name).suffix.lower() in CAMERA_SUFFIXES]
        with show_errors(self.folder):
            names = [check_upload_name(file.name) for file in files]
            place = path = self.folder
            if len(files) > 1:
                place = path = self.folder / free_name(self.folder, UPLOAD_FOLDER)
                place.mkdir()
            for name, file in zip(names, files, strict=True):
                path = await write_upload(place, free_name(place, name), file.iterate())
            if files:
                ui.notify(f"stored {format_count(len(files), 'file')}; opening", type="positive")
                ui.navigate.to(self._find_address(path if len(files) == 1 else place))

    def _find_address(self, stored: Path) -> str:
        """The address of a stored file, or of the one series of a stored folder; the choice where there are several."""
        names = [str(stored.relative_to(self.folder))]
        if stored.is_dir():
            series = list_folder(self.folder).image_series
            names = [one for one in series if stored in (self.folder / one, *(self.folder / one).parents)]
        return page_address("camera", open=names[0]) if len(names) == 1 else "/camera"


def _notify_rejected() -> None:
    ui.notify(f"only camera files are accepted, {UPLOAD_LIMIT}: {' '.join(sorted(CAMERA_SUFFIXES))}", type="negative")


def describe_place(name: str) -> str:
    """The name of files as people read it.

    >>> describe_place("."), describe_place("warm")
    ('this folder', 'warm')
    """
    return "this folder" if name == "." else escape_control(name)


async def show_file_cards(folder: Path) -> None:
    """Show the camera files of the folder as cards; thumbnails follow one after the other."""
    series = list(list_folder(folder).image_series.items())
    if not series:
        return
    heading(2, "Camera files in this folder")
    pictures = {}
    with ui.element("div").classes("ft-grid"):
        for name, number in series[:MAX_CARDS]:
            with ui.link(target=page_address("camera", open=name)).classes("ft-card no-underline"):
                pictures[name] = ui.element("div").classes("ft-thumbnail")
                ui.label(describe_place(name)).classes("break-all font-medium")
                ui.label(format_count(number, "file")).classes("ft-muted ft-small")
    if len(series) > MAX_CARDS:
        ui.label(f"and {len(series) - MAX_CARDS} more in the list above").classes("ft-muted")
    client = ui.context.client
    for name, place in pictures.items():
        picture = await run.io_bound(draw_thumbnail, folder, name)
        if client.is_deleted or picture is None:  # the server stops
            return
        with place:
            if picture.startswith("data:"):
                image = ui.element("img").classes("ft-thumbnail").props("alt=''")
                image.props["src"] = picture
            else:
                ui.label(escape_control(picture)).classes("ft-muted ft-small p-2 break-all")


def draw_thumbnail(folder: Path, name: str) -> str:
    """The first frame of camera files as the data address of a PNG; a sentence where there is none."""
    from flashtemp.viz.measurement.raw_images import encode_png

    try:
        file = find_camera_files(folder, [name])[0]
        with refuse_damaged(file):
            frame = next(iter_frames(file, ImportOptions())).temperature[0]
            step = max(1, min(frame.shape) // THUMBNAIL_PX)
            small = frame[::step, ::step]
            low, high = (np.nanmin(small), np.nanmax(small)) if np.isfinite(small).any() else (0.0, 1.0)
            return "data:image/png;base64," + b64encode(encode_png(small, low, high)).decode()
    except (BadInput, StopIteration, OSError) as fault:
        return f"No preview: {str(fault).rpartition(file_prefix(folder))[2] or 'no frame'}"


def file_prefix(folder: Path) -> str:
    """The path of the folder as it precedes the names of its files in messages."""
    return f"{folder.resolve()}/"


def show_example_button(folder: Path) -> None:
    """Show a button that writes a synthetic series of camera files and opens it."""

    async def create() -> None:
        with show_errors(folder):
            name = await run.io_bound(write_example, folder)
            ui.navigate.to(page_address("camera", open=name))

    action("Try an example", create, icon="science")


def write_example(folder: Path) -> str:
    """Write 48 frames of a block that slides from 4 s on, as CSV, into a new folder; returns its name.

    The block is at columns 20.3 to 100.3, its interface at row 70.6; two frames are taken per second.
    """
    from scipy.ndimage import gaussian_filter

    name = free_name(folder, EXAMPLE_FOLDER)
    place = folder / name
    place.mkdir()
    rng = np.random.default_rng(0)
    x, z = (np.arange(120)[None] - 20.3) / 80.0, (70.6 - np.arange(90)[:, None]) / 3.2
    for k in range(48):
        since = 0.5 * k - 4.0
        rise = 2.5 * np.sqrt(max(since, 0.0)) - 2.3 * np.sqrt(max(since - 12.0, 0.0))
        T = np.where((x > 0) & (x < 1) & (z > 0) & (z < 20), 24.0 + rise * np.exp(-z / 4.0) * (0.3 + x), 20.0)
        T = gaussian_filter(T, OPTICS_SD_PX)
        np.savetxt(place / f"frame_{k:03d}.csv", T + 0.03 * rng.normal(size=T.shape), fmt="%.2f", delimiter="\t")
    return name
