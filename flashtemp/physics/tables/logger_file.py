"""Read files of data loggers: LabVIEW LVM and TDMS by their first bytes, all others as text tables."""

from __future__ import annotations

from pathlib import Path

from flashtemp.physics import safe_text
from flashtemp.physics.tables import lvm, tdms
from flashtemp.physics.tables.encoding import decode_text
from flashtemp.physics.tables.table import parse_table
from flashtemp.physics.tables.text_table import TextTable
from flashtemp.physics.tables.time_axis import TimeAxis


def read_logger_file(
    path: Path, where: str, comma: bool | None = None, group: str | None = None
) -> tuple[TextTable, TimeAxis | None]:
    """The table of a logger's file, and its times if the format states them.  Raises BadInput, beginning with `where`.

    The user may state whether commas are decimal (`comma`) and the `group` of a TDMS file.
    """
    data = safe_text.read_bounded_bytes(path, where)
    if data.startswith(tdms.TDMS_MAGIC):
        return tdms.read_tdms(path, where, group)
    text = decode_text(data, where)
    if text.lstrip().startswith(lvm.LVM_MAGIC):
        return lvm.parse_lvm(text.lstrip(), where)
    return parse_table(text, where, comma, of_logger=True), None
