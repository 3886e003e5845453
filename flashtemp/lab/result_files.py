"""The files of a result folder: which there are, reading them within limits, and showing pictures, report and files."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import ui

from flashtemp.errors import BadInput
from flashtemp.lab.page_layout import card, file_address, refuse_damaged
from flashtemp.lab.result_parts import write_text
from flashtemp.lab.workspace import RESULT_COMMANDS, escape_control, find_own_file, read_json, resolve_inside
from flashtemp.model.case_file import MAX_TOML_BYTES, flatten_tables, parse_toml

MAX_PICTURES = 200
MAX_FILES_SHOWN = 500
PICTURE_SUFFIXES = (".png", ".gif", ".svg")
FILE_DESCRIPTIONS = {
    "case.toml": "the case with all its keys; it can be run again",
    "run.nc": "temperatures and pressure over x and time (NetCDF)",
    "summary.json": "main numbers",
    "profiles.csv": "profiles along the block at the end",
    "fields.vtkhdf": "temperature fields for ParaView",
    "report.html": "report",
    "report.pdf": "report for printing",
    "verdict.json": "verdict with all its numbers",
    "extended.toml": "the case with the accepted causes; it can be run",
    "learned.py": "the learned law as an effect: a Python program",
    "compare.json": "differences between measurement and model",
    "plan.json": "what planned data can tell apart",
    "sweep.nc": "numbers and profiles of every combination (NetCDF)",
    "sweep.csv": "one row for every combination",
    "sensitivity.json": "what every input does",
    "worn.csv": "worn depth along the block",
    "friction.json": "friction over speed and temperature",
    "area.json": "contact area over pressure",
    "loads.json": "what makes friction depend on load",
    "tread.json": "friction of a tread block over slip",
    "tyre.json": "side force of a tyre over slip angle",
}
RUN_PICTURE_CAPTIONS = {
    "budget": "Where the friction heat went",
    "field": "Temperature in block and road",
    "friction": "Friction over the distance",
    "map": "Temperature over position and time",
    "profile": "Surface temperature along the block",
    "run_in": "Repetitions: temperature at the edges and in the middle",
    "spots": "Contact regions from above",
    "width": "Temperature across the width",
    "worn": "Worn depth along the block",
    "sweep": "Numbers over the swept keys",
    "sensitivity": "What every input does",
    "separability": "Which effects these data can tell apart",
    "what_is_wrong": "Measured, computed and their difference where it is largest",
    "area": "Contact area over pressure",
    "loads": "What makes friction depend on load",
    "tread": "Friction along the footprint",
    "tyre": "Side force over slip angle",
}


@dataclass(frozen=True)
class ResultFolder:
    """A result in the `folder` of the page: its path `here` in it, and the `command` that made it ("" if unknown)."""

    folder: Path
    here: Path
    command: str

    @property
    def path(self) -> Path:
        return self.folder / self.here

    @property
    def name(self) -> str:
        """The path in the folder as text, without control characters."""
        return escape_control(str(self.here))

    def find_file(self, name: str) -> Path | None:
        """A regular file of the result; None where there is none or a link leads out of the folder."""
        return find_own_file(self.folder, self.here / name)

    def read_json(self, name: str) -> dict[str, Any]:
        """The content of a JSON file of the result; {} where there is none.  Raises BadInput for a damaged file."""
        return read_json(self.folder, self.here / name)

    def read_case(self) -> dict[str, Any]:
        """The keys of the result's case {key with table: value}; {} where it has none.  Raises BadInput."""
        if (file := self.find_file("case.toml")) is None:
            return {}
        with refuse_damaged(file):
            if file.stat().st_size > MAX_TOML_BYTES:
                raise BadInput(f"{file}: larger than {MAX_TOML_BYTES // 2**20} MiB; open it with a text editor")
            return flatten_tables(parse_toml(file.read_text(encoding="utf-8")))


def open_result(folder: Path, name: str) -> ResultFolder:
    """The result folder with that name in the folder of the page.  Raises BadInput."""
    path = resolve_inside(folder, name)
    if not name or not path.is_dir():
        raise BadInput(f"{escape_control(name)}: no such result; choose one on the page Home")
    result = ResultFolder(folder.resolve(), path.relative_to(folder.resolve()), "")
    command = next((c for file, c in RESULT_COMMANDS.items() if result.find_file(file) is not None), "")
    return ResultFolder(result.folder, result.here, command)


@contextmanager
def open_dataset(file: Path, max_bytes: int, left_out: str = "") -> Iterator[Any]:
    """Context manager: a NetCDF file of a result whose data lie in the file and fit into `max_bytes` of memory.

    Variables whose names end with `left_out` are not read by the page.  Raises BadInput.
    """
    import h5py
    import xarray

    from flashtemp.physics.safe_hdf5 import count_values_in_memory, list_datasets

    with refuse_damaged(file):
        with h5py.File(file) as content:
            found = list_datasets(content)  # raises for links into other files and for data that lie there
            n_bytes = sum(
                count_values_in_memory(values) * values.dtype.itemsize
                for name, values in found.items()
                if not left_out or not name.endswith(left_out)
            )
        if n_bytes > max_bytes:
            raise BadInput(f"{file}: holds {n_bytes / 2**20:.0f} MiB of profiles; open it with xarray")
        with xarray.open_dataset(file, engine="h5netcdf") as data:
            yield data


def list_pictures(result: ResultFolder) -> list[str]:
    """Names of the pictures of a result in order; names with control characters are left out."""
    names = sorted(p.name for p in result.path.iterdir() if p.suffix in PICTURE_SUFFIXES)
    return [name for name in names if escape_control(name) == name and result.find_file(name) is not None]


def picture_caption(name: str) -> str:
    """What a picture shows: a known caption, or its file name in words.

    >>> picture_caption("budget.png"), picture_caption("my_plot.png")
    ('Where the friction heat went', 'My plot')
    """
    stem = Path(name).stem
    words = stem.replace("_", " ").strip()
    caption = RUN_PICTURE_CAPTIONS.get(stem, f"{words[:1].upper()}{words[1:]}")
    return f"{caption} (animation)" if Path(name).suffix == ".gif" else caption


def show_gallery(result: ResultFolder, captions: dict[str, str] | None = None) -> None:
    """Show the pictures of a result with captions; a click enlarges one."""
    names = list_pictures(result)
    if not names:
        return
    words = {name: (captions or {}).get(Path(name).stem) or picture_caption(name) for name in names[:MAX_PICTURES]}
    with card("Pictures", "Click a picture to enlarge it; the arrow keys go to the others."):
        lightbox = PictureLightbox(result, words)
        with ui.element("div").classes("ft-gallery"):
            for name, caption in words.items():
                with ui.element("figure").classes("m-0"):
                    button = ui.element("button").on("click", lambda name=name: lightbox.show_picture(name))
                    button.props["aria-label"] = f"enlarge: {caption}"
                    with button:
                        picture = ui.image(file_address(result.here / name)).props("fit=contain")
                        picture.props["alt"] = caption
                    write_text("figcaption", caption).classes("ft-small ft-muted")
        if len(names) > MAX_PICTURES:
            ui.label(f"and {len(names) - MAX_PICTURES} more pictures in {result.name}").classes("ft-muted")


class PictureLightbox:
    """A dialog that shows one picture large, with buttons and keys for the next and the last one."""

    def __init__(self, result: ResultFolder, captions: dict[str, str]):
        self.result, self.captions, self.names, self.at = result, captions, list(captions), 0
        with ui.dialog() as self.dialog, ui.element("div").classes("ft-lightbox"):
            self.place = ui.column().classes("w-full items-stretch gap-1")
            with ui.row().classes("items-center w-full no-wrap"):
                self.back = ui.button(icon="chevron_left", on_click=lambda: self.move_by(-1))
                self.back.props('flat round aria-label="last picture"')
                self.next = ui.button(icon="chevron_right", on_click=lambda: self.move_by(1))
                self.next.props('flat round aria-label="next picture"')
                self.caption = ui.label().classes("grow")
                self.link = ui.link("open alone", "#", new_tab=True)
                ui.button("Close", on_click=self.dialog.close).props("flat no-caps")
        self.dialog.on("keydown.left", lambda: self.move_by(-1))
        self.dialog.on("keydown.right", lambda: self.move_by(1))

    def show_picture(self, name: str) -> None:
        """Open the dialog with the picture of that name."""
        self.at = self.names.index(name)
        self._draw_picture()
        self.dialog.open()

    def move_by(self, step: int) -> None:
        """Show the picture that many places further, around the end."""
        self.at = (self.at + step) % len(self.names)
        self._draw_picture()

    def _draw_picture(self) -> None:
        name = self.names[self.at]
        self.place.clear()
        with self.place:
            ui.image(file_address(self.result.here / name)).props("fit=contain").props["alt"] = self.captions[name]
        self.caption.text = self.captions[name]
        self.link.props["href"] = file_address(self.result.here / name)


def show_files(result: ResultFolder) -> None:
    """Show the files of a result with their sizes, each offered for saving."""
    names = sorted(p.name for p in result.path.iterdir() if not p.name.startswith("."))
    with card("Files", f"All of {result.name}."), ui.element("div").classes("ft-scroll"):
        with ui.element("table").classes("ft-table").props('aria-label="files"'), ui.element("tbody"):
            for name in names[:MAX_FILES_SHOWN]:
                if escape_control(name) == name and (file := result.find_file(name)) is not None:
                    with ui.element("tr"):
                        with ui.element("td"):
                            link = ui.link(name, file_address(result.here / name))
                            link.classes("ft-mono ft-small").props("download")
                        write_text("td", FILE_DESCRIPTIONS.get(name, "")).classes("ft-muted")
                        write_text("td", describe_size(file.stat().st_size)).classes("number")
        if len(names) > MAX_FILES_SHOWN:
            ui.label(f"and {len(names) - MAX_FILES_SHOWN} more").classes("ft-muted")


def show_report(result: ResultFolder) -> None:
    """Show a report in a sandboxed frame without scripts, since its author is unknown."""
    if result.find_file("report.html") is None:
        return
    address = file_address(result.here / "report.html")
    with card("Report"):
        with ui.row().classes("gap-4"):
            ui.link("Open the report in a new tab", address, new_tab=True)
            if result.find_file("report.pdf") is not None:
                ui.link("PDF for printing", file_address(result.here / "report.pdf"), new_tab=True)
        frame = ui.element("iframe").classes("ft-report")
        for key, value in {"src": address, "title": "report", "sandbox": "", "referrerpolicy": "no-referrer"}.items():
            frame.props[key] = value


def describe_size(n_bytes: int) -> str:
    """A file size in words.

    >>> describe_size(800), describe_size(123_456), describe_size(5_000_000)
    ('800 B', '123 kB', '5.0 MB')
    """
    if n_bytes < 1000:
        return f"{n_bytes} B"
    return f"{n_bytes / 1e3:.0f} kB" if n_bytes < 1e6 else f"{n_bytes / 1e6:.1f} MB"


def describe_age(result: ResultFolder, names: Sequence[str]) -> str:
    """When a result was written, from the first of its files that exists."""
    file = next((f for name in names if (f := result.find_file(name)) is not None), None)
    try:
        return "" if file is None else time.strftime("%Y-%m-%d %H:%M", time.localtime(file.stat().st_mtime))
    except (OSError, ValueError, OverflowError):  # removed meanwhile, or a time beyond the calendar
        return ""
