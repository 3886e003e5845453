"""The server of the web app: on loopback, protected by a token, with restrictive headers on every response."""

from __future__ import annotations

import hmac
import os
import secrets
import socket
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlencode

from flashtemp.errors import BadInput
from flashtemp.lab.command_options import CommandDescription
from flashtemp.lab.saving import MAX_UPLOAD_BYTES, UPLOAD_LIMIT

HOST, COOKIE = "127.0.0.1", "flashtemp_lab"
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]


BODY_METHODS = ("POST", "PUT", "PATCH", "DELETE")
MAX_BODY_BYTES = MAX_UPLOAD_BYTES + 2**20  # upload and form
PAGE_HEADERS = {  # of every response that does not set them
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",  # the first address contains the token
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


def page_policy(port: int) -> str:
    """Content-Security-Policy of the pages: no other origins, no framing.

    NiceGUI compiles templates and runs handlers in the page, so inline scripts and eval must be allowed.
    """
    sockets = " ".join(f"ws://{name}" for name in host_names(port))
    return (
        "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' {sockets}; worker-src 'self' blob:; "
        "frame-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'; object-src 'none'"
    )


def host_names(port: int) -> tuple[str, str]:
    """The names of this server in the headers Host and Origin."""
    return f"{HOST}:{port}", f"localhost:{port}"


@dataclass(frozen=True)
class TokenGuard:
    """Middleware that admits requests with the `token`: once in the address, then as a cookie for this `port`.

    Host and Origin must be the server's own names, against DNS rebinding and cross-site requests.  Pages on other ports
    of this computer share its cookies; from them only navigation to a whole page is admitted (Fetch Metadata).
    """

    app: Callable[[Scope, Receive, Send], Awaitable[None]]
    token: str
    port: int

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle an HTTP request or a web socket."""
        kind = scope["type"]
        if kind not in ("http", "websocket"):
            await self.app(scope, receive, send)
        elif kind == "websocket" and not self._is_known(scope):
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        elif kind == "websocket":
            await self.app(scope, receive, send)
        else:
            await self._answer_request(scope, receive, _with_headers(send, page_policy(self.port)))

    async def _answer_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle an HTTP request."""
        if self._is_known(scope):
            status, text = _body_refusal(scope)
            if status:
                await _send_answer(send, status, [("connection", "close")], text)
            else:
                await self.app(scope, receive, send)
        elif self._is_here(scope) and self._is_token(_parse_query(scope).get("token", [""])[0]):
            await _send_answer(send, 303, [("location", _without_token(scope)), ("set-cookie", self._cookie_header())])
        else:
            await _send_answer(send, 403, [], "open the address that `flashtemp lab` printed, with its token\n")

    def _is_known(self, scope: Scope) -> bool:
        origin = _header_value(scope, b"origin")
        foreign = origin and origin.removeprefix("http://") not in host_names(self.port)
        cookies = _cookie_values(scope, f"{COOKIE}_{self.port}")
        return self._is_here(scope) and not foreign and not _is_embedded(scope) and any(map(self._is_token, cookies))

    def _is_here(self, scope: Scope) -> bool:
        return _header_value(scope, b"host") in host_names(self.port)

    def _is_token(self, token: str) -> bool:
        return hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode())

    def _cookie_header(self) -> str:
        return f"{COOKIE}_{self.port}={self.token}; HttpOnly; SameSite=Strict; Path=/"


def _is_embedded(scope: Scope) -> bool:
    """Whether another site or port requests anything but a whole page (W3C Fetch Metadata Request Headers)."""
    site, mode, dest = (_header_value(scope, b"sec-fetch-" + name) for name in (b"site", b"mode", b"dest"))
    return site in ("same-site", "cross-site") and (mode, dest) != ("navigate", "document")


def _body_refusal(scope: Scope) -> tuple[int, str]:
    """Status and text for a body that is too large or of unknown length; status 0 for an acceptable one."""
    length = _header_value(scope, b"content-length")
    if length.isascii() and length.isdigit():
        return (
            (413, f"{UPLOAD_LIMIT}; copy the files into the folder instead\n")
            if int(length) > MAX_BODY_BYTES
            else (0, "")
        )
    has_body = scope["method"] in BODY_METHODS or _header_value(scope, b"transfer-encoding") or length
    return (411, "the request needs a Content-Length\n") if has_body else (0, "")


def _header_value(scope: Scope, name: bytes) -> str:
    return next((value.decode("latin-1") for key, value in scope["headers"] if key == name), "")


def _cookie_values(scope: Scope, name: str) -> list[str]:
    """Values of the cookies of that name; other servers on this computer may set any cookies."""
    pairs = (part.strip().partition("=") for part in _header_value(scope, b"cookie").split(";"))
    return [value for key, _, value in pairs if key == name]


def _parse_query(scope: Scope) -> dict[str, list[str]]:
    try:
        return parse_qs(scope["query_string"].decode("latin-1"))
    except ValueError:  # more fields than urllib accepts
        return {}


def _without_token(scope: Scope) -> str:
    """The same address on this host without the token; a path of several slashes cannot lead to another host."""
    rest = [(k, v) for k, values in _parse_query(scope).items() for v in values if k != "token"]
    return "/" + quote(scope["path"].lstrip("/\\")) + ("?" + urlencode(rest) if rest else "")


def _with_headers(send: Send, policy: str) -> Send:
    """A `send` that adds PAGE_HEADERS and the policy to every response."""

    async def send_with_headers(message: Any) -> None:
        if message["type"] == "http.response.start":
            headers = list(message.get("headers", ()))
            present = {bytes(key).lower() for key, _ in headers}
            for name, value in {**PAGE_HEADERS, "content-security-policy": policy}.items():
                if name.encode() not in present:
                    headers.append((name.encode(), value.encode()))
            message = {**message, "headers": headers}
        await send(message)

    return send_with_headers


async def _send_answer(send: Send, status: int, headers: list[tuple[str, str]], text: str = "") -> None:
    plain = [*headers, ("content-type", "text/plain; charset=utf-8"), ("cache-control", "no-store")]
    encoded = [(k.encode("latin-1"), v.encode("latin-1")) for k, v in plain]
    await send({"type": "http.response.start", "status": status, "headers": encoded})
    await send({"type": "http.response.body", "body": text.encode()})


def serve(
    folder: Path,
    browser: bool = True,
    announce: Callable[[str], Any] = print,
    commands: Sequence[CommandDescription] = (),
) -> None:
    """Serve the pages of a folder until Ctrl-C; `announce` is called with the address.

    `commands` describe what the page of runs offers.  Raises BadInput.
    """
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder; give the folder of your case and camera files")
    # NiceGUI would otherwise load its storage from the current folder, which may hold untrusted files
    os.environ["NICEGUI_STORAGE_PATH"] = str(Path.home() / ".cache" / "flashtemp" / "page")
    try:
        import uvicorn

        from flashtemp.lab.pages import make_application
    except ModuleNotFoundError as fault:
        if (fault.name or "").startswith("flashtemp"):
            raise
        raise BadInput(f"lab: {fault.name} is not installed; pip install 'flashtemp[lab]'") from fault
    token = secrets.token_urlsafe(24)
    with socket.create_server((HOST, 0)) as listening:
        port = listening.getsockname()[1]
        app, jobs = make_application(folder.resolve(), commands)
        server = uvicorn.Server(uvicorn.Config(TokenGuard(app, token, port), log_level="error", ws_max_size=2**26))
        address = f"http://{HOST}:{port}/?token={token}"
        announce(address)
        if browser:
            import webbrowser

            webbrowser.open(address)
        try:
            server.run(sockets=[listening])
        finally:
            jobs.stop_all()
