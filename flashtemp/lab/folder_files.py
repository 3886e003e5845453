"""Files of the folder over HTTP: pictures and reports are shown in a sandbox, all others are downloads."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, Response
from starlette.staticfiles import StaticFiles

from flashtemp.lab.workspace import has_hidden_part

SHOWN_TYPES = {
    ".html": "text/html; charset=utf-8", ".png": "image/png", ".gif": "image/gif", ".svg": "image/svg+xml",
    ".jpg": "image/jpeg", ".jpeg": "image/jpeg",
}  # fmt: skip
FILE_POLICY = (  # Content Security Policy Level 3: no script, no origin, nothing loaded, framed by the page alone
    "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)


class FolderFiles(StaticFiles):
    """Regular files of a folder; 404 for hidden files, links that leave the folder, and invalid names."""

    def __init__(self, folder: Path):
        super().__init__(directory=folder, follow_symlink=False)
        self.folder = Path(os.path.realpath(folder))

    async def get_response(self, path: str, scope: Any) -> Response:
        """The file.  Raises HTTPException 404 for every name that cannot be served."""
        try:
            return await super().get_response(path, scope)
        except HTTPException as fault:
            raise HTTPException(404 if fault.status_code == 401 else fault.status_code) from fault
        except (OSError, ValueError) as fault:
            raise HTTPException(404) from fault

    def lookup_path(self, path: str) -> tuple[str, os.stat_result | None]:
        """The resolved path of a file that may be served, and its state."""
        if has_hidden_part(Path(path)):
            return "", None
        found, state = super().lookup_path(path)
        if state is None or has_hidden_part(Path(found).relative_to(self.folder)):
            return "", None
        return found, state

    def file_response(
        self, full_path: Any, stat_result: os.stat_result, scope: Any, status_code: int = 200
    ) -> Response:
        """The file with the type of its suffix, never guessed from its content."""
        kind = SHOWN_TYPES.get(Path(full_path).suffix.lower())
        headers = {
            "content-security-policy": FILE_POLICY, "x-content-type-options": "nosniff", "cache-control": "no-store",
            "x-frame-options": "SAMEORIGIN",
        }  # fmt: skip
        return FileResponse(
            full_path, status_code, headers, kind or "application/octet-stream", stat_result=stat_result,
            filename=None if kind else Path(full_path).name,
        )  # fmt: skip
