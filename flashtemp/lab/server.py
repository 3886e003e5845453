"""The page's server: on loopback only, for who knows the token in its address."""

from __future__ import annotations

import hmac
import secrets
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode

from flashtemp.errors import BadInput

HOST, COOKIE = "127.0.0.1", "flashtemp_lab"
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]


@dataclass(frozen=True)
class Guard:
    """Lets through who brings the `token`, in the address once and as a cookie from then on, to this `port` itself.

    The name of the host is looked at too, so that no other site's name can stand for it.
    """

    app: Callable[[Scope, Receive, Send], Awaitable[None]]
    token: str
    port: int

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request of HTTP or one web socket."""
        if scope["type"] not in ("http", "websocket") or self._known(scope):
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        elif self._here(scope) and self._right(parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]):
            await _answer(send, 303, [("location", _without_token(scope)), ("set-cookie", self._cookie())])
        else:
            await _answer(send, 403, [], b"open the address that `flashtemp lab` printed, with its token\n")

    def _known(self, scope: Scope) -> bool:
        cookie = SimpleCookie(_header(scope, b"cookie")).get(f"{COOKIE}_{self.port}")
        origin = _header(scope, b"origin")
        foreign = origin and origin.removeprefix("http://") not in self._names()
        return self._here(scope) and not foreign and cookie is not None and self._right(cookie.value)

    def _here(self, scope: Scope) -> bool:
        return _header(scope, b"host") in self._names()

    def _names(self) -> tuple[str, str]:
        return f"{HOST}:{self.port}", f"localhost:{self.port}"

    def _right(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())

    def _cookie(self) -> str:
        return f"{COOKIE}_{self.port}={self.token}; HttpOnly; SameSite=Strict; Path=/"


def _header(scope: Scope, name: bytes) -> str:
    return next((value.decode("latin-1") for key, value in scope["headers"] if key == name), "")


def _without_token(scope: Scope) -> str:
    rest = [(k, v) for k, vs in parse_qs(scope["query_string"].decode("latin-1")).items() for v in vs if k != "token"]
    return "/" + scope["path"].lstrip("/") + ("?" + urlencode(rest) if rest else "")  # of this host, whatever it says


async def _answer(send: Send, status: int, headers: list[tuple[str, str]], body: bytes = b"") -> None:
    named = [(k.encode("latin-1"), v.encode("latin-1")) for k, v in [*headers, ("content-type", "text/plain")]]
    await send({"type": "http.response.start", "status": status, "headers": named})
    await send({"type": "http.response.body", "body": body})


def serve(folder: Path, browser: bool = True, told: Callable[[str], Any] = print) -> None:
    """Serve the page of a folder until Ctrl-C; `told` is given its address.  Raises BadInput."""
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder; give the folder of your case and camera files")
    try:
        import uvicorn

        from flashtemp.lab.pages import application
    except ModuleNotFoundError as fault:
        raise BadInput(f"lab: {fault.name} is not installed; pip install 'flashtemp[lab]'") from fault
    token = secrets.token_urlsafe(24)
    with socket.create_server((HOST, 0)) as listening:
        port = listening.getsockname()[1]
        app, jobs = application(folder.resolve())
        server = uvicorn.Server(uvicorn.Config(Guard(app, token, port), log_level="error", ws_max_size=2**26))
        address = f"http://{HOST}:{port}/?token={token}"
        told(address)
        if browser:
            import webbrowser

            webbrowser.open(address)
        try:
            server.run(sockets=[listening])
        finally:
            jobs.stop_all()
