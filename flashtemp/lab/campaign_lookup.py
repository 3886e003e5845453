"""The campaign that a result was computed from, found by the recordings that both list."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from flashtemp.lab.workspace import list_folder
from flashtemp.model.case_file import parse_toml


def find_campaign(folder: Path, files: Iterable[str], title: str, with_forces: bool = True) -> Path | None:
    """The campaign of the folder with exactly these recordings and load-cell files; of several that with this title.

    `with_forces`: whether `files` include those of load cells.  None where no campaign, or more than one, is left.
    """
    wanted = set(files)
    found = [(path, tables) for path, tables in _read_campaigns(folder) if _listed_files(tables, with_forces) == wanted]
    titled = [(path, tables) for path, tables in found if tables.get("title") == title]
    left = titled if len(found) > 1 else found
    return left[0][0] if len(left) == 1 and wanted else None


def _read_campaigns(folder: Path) -> Iterable[tuple[Path, dict[str, object]]]:
    for path in list_folder(folder).campaigns:
        try:
            yield path, parse_toml((folder / path).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue


def _listed_files(tables: dict[str, object], with_forces: bool) -> set[str]:
    """Files of the recordings, and where wanted of the load-cell series, of a campaign."""
    lists = [tables.get(kind) for kind in ("recording", "force")[: 1 + with_forces]]
    rows = [row for rows in lists if isinstance(rows, list) for row in rows if isinstance(row, dict)]
    return {row["file"] for row in rows if isinstance(row.get("file"), str)}
