"""The laboratory's page among hostile files and sites: nothing of theirs runs, is read from elsewhere, or is lost."""

from __future__ import annotations

import ast
import asyncio
import http.client
import os
import re
import shutil
import socket
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

import flashtemp.lab
from flashtemp.camera.importing.import_options import ImportOptions
from flashtemp.errors import BadInput
from flashtemp.lab import page_layout, saving
from flashtemp.lab import workspace as folders
from flashtemp.lab.camera_files import find_camera_files
from flashtemp.lab.command_form import CommandForm
from flashtemp.lab.folder_files import FolderFiles
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.import_part import ImportPart
from flashtemp.lab.job_start import file_word, start_job
from flashtemp.lab.page_layout import program_lines
from flashtemp.lab.programs import AllowedPrograms, has_trust, programs_of_command, programs_of_text
from flashtemp.lab.saving import ReplacesFile, read_text, write_text, write_upload
from flashtemp.lab.server import MAX_BODY_BYTES, TokenGuard

TOKEN, PORT = "a-token-of-this-test", 8123
BASE = f"http://127.0.0.1:{PORT}"  # of the guard alone; the server of all pages has a port of its own
COOKIE = {"cookie": f"flashtemp_lab_{PORT}={TOKEN}"}
SECRET = "what lies outside of the folder"
HOSTILE_PICTURE = 'c" :foo="window.picture_ran=1" onload="window.picture_ran=1" d=".png'
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8cfc0000003010100c9fe92ef0000000049454e44ae426082"
)
EFFECT = """from pathlib import Path
Path(__file__).with_name("effect_ran").write_text("")
"""


# --- a folder of a stranger ------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with links that leave it, hidden files, a pipe, names that are no text, and an effect file."""
    root = tmp_path_factory.mktemp("stranger").resolve()
    place = root / "folder"
    (place / "result").mkdir(parents=True)
    (root / "secret.toml").write_text(f'title = "{SECRET}"\n')
    (root / "secrets").mkdir()
    (root / "secrets" / "key.txt").write_text(SECRET)
    (place / "out.toml").symlink_to(root / "secret.toml")
    (place / "out").symlink_to(root / "secrets")
    (place / "dangling.csv").symlink_to(root / "nothing.csv")
    (place / "loop").symlink_to(place / "loop")
    (place / ".hidden.txt").write_text(SECRET)
    (place / ".git").mkdir()
    (place / ".git" / "config").write_text(SECRET)
    (place / "to_hidden.txt").symlink_to(place / ".hidden.txt")
    (place / ".to_visible.png").symlink_to(place / "a.png")
    os.mkfifo(place / "pipe.toml")
    (place / "undecodable.toml").write_bytes(b'title = "\xff"\n')
    (Path(os.fsdecode(os.fsencode(place) + b"/\xff\xfe.csv"))).write_text("1\t2\n")
    (place / "effect.toml").write_text('effects = ["./fan.py"]\n')
    (place / "campaign.toml").write_text('case = "effect.toml"\n[[recording]]\nfile = "a.nc"\n')
    (place / "fan.py").write_text(EFFECT)
    (place / "formula.toml").write_text('effects = []\ncase = "\\u0000"\n[[recording]]\nfile = "a.nc"\n')
    for name in ("a.html", "a.svg", "a.png", "a.js", "a.txt", "a.nc", "a.gif", "a.xhtml", "a.pdf", "a.mhtml", "a.HTML"):
        (place / name).write_bytes(b"<script>1</script>")
    result = place / "result"
    (result / "run.nc").write_bytes(b"CDF\x01 broken")
    (result / "report.html").symlink_to(root / "secret.toml")
    (result / "summary.json").write_text(
        '{"a": "\\ud800", "<b>": "<script>", "deep": ' + "[" * 50_000 + "]" * 50_000 + "}"
    )
    (result / HOSTILE_PICTURE).write_bytes(PNG)
    (result / "line\nend.png").write_bytes(PNG)
    return place


class Server:
    """The application in a thread of this process, and a client that sends an address as it stands."""

    def __init__(self, place: Path):
        import uvicorn

        from flashtemp.lab.pages import make_application

        self.socket = socket.create_server(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.base = f"http://127.0.0.1:{self.port}"
        app, self.jobs = make_application(place)
        self.server = uvicorn.Server(
            uvicorn.Config(TokenGuard(app, TOKEN, self.port), log_level="error", lifespan="on")
        )
        self.thread = threading.Thread(target=self.server.run, kwargs={"sockets": [self.socket]})
        self.thread.start()

    def get(self, path):
        """The answer to who has the cookie."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        client.request("GET", path, headers={"cookie": f"flashtemp_lab_{self.port}={TOKEN}"})
        answer = client.getresponse()
        text = answer.read().decode("utf-8", "replace")
        client.close()
        return SimpleNamespace(status_code=answer.status, headers=answer.headers, text=text)

    def stop(self):
        self.jobs.stop_all()
        self.server.should_exit = True
        self.thread.join(30)
        self.socket.close()


@pytest.fixture(scope="module")
def pages(place):
    """The pages of the stranger's folder."""
    server = Server(place)
    yield server
    server.stop()


def served(app, method="GET", path="/", headers=(), query="", host=f"127.0.0.1:{PORT}", kind="http"):
    """Status, headers and body that an ASGI application answers; of a web socket, the type of its first message."""
    sent = []
    fields = [(b"host", host.encode()), *((k.lower().encode(), v.encode("latin-1")) for k, v in dict(headers).items())]
    scope = {
        "type": kind, "method": method, "path": path, "raw_path": path.encode("utf-8", "surrogateescape"),
        "query_string": query.encode(), "headers": fields, "root_path": "", "scheme": "http", "http_version": "1.1",
    }  # fmt: skip

    async def receive():
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message):
        sent.append(message)

    asyncio.run(app(scope, receive, send))
    if kind == "websocket":
        return sent[0]["type"]
    headers = {k.decode(): v.decode() for k, v in sent[0]["headers"]}
    return sent[0]["status"], headers, b"".join(m.get("body", b"") for m in sent[1:])


async def echo(scope, receive, send):
    """An application that lets everybody in."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": b"in"})


GUARD = TokenGuard(echo, TOKEN, PORT)

# --- what is served --------------------------------------------------------------------------------------------
OUT_OF_REACH = [
    "../secret.toml", "..%2fsecret.toml", "%2e%2e/secret.toml", "%2e%2e%2fsecret.toml", "..%5csecret.toml",
    "..%252fsecret.toml", "result/../../secret.toml", "result/..%2f..%2fsecret.toml", "/etc/passwd", "%2fetc/passwd",
    "//etc/passwd", "out.toml", "out/key.txt", "out", "dangling.csv", "loop", "loop/x", ".hidden.txt", ".git/config",
    "result/../.hidden.txt", "%2ehidden.txt", "to_hidden.txt", ".to_visible.png", "pipe.toml", "result", "", ".", "..", "%00", "a.png%00",
    "%00/../../secret.toml", "./../secret.toml", "..\\secret.toml", "a" * 5000, "result/" + "a/" * 2500, "a.txt/b", "result/report.html", "%ff%fe", "%0d%0aSet-Cookie:x",
]  # fmt: skip


@pytest.mark.parametrize("name", OUT_OF_REACH, ids=lambda name: name[:24] or "empty")
def test_only_visible_files_of_the_folder_are_served(pages, name):
    answer = pages.get(f"/files/{name}")
    assert answer.status_code in (400, 404)
    assert SECRET not in answer.text
    assert "Traceback" not in answer.text


@pytest.mark.parametrize("name", ["a.html", "a.HTML", "a.svg", "a.png", "a.js", "a.txt", "a.nc", "a.xhtml", "a.mhtml"])
def test_no_file_of_the_folder_is_a_page_of_this_origin(pages, name):
    headers = pages.get(f"/files/{name}").headers
    policy = dict(rule.strip().partition(" ")[::2] for rule in headers["content-security-policy"].split(";"))
    assert policy["sandbox"] == ""
    assert policy["default-src"] == "'none'"
    assert "script-src" not in policy
    assert policy["frame-ancestors"] == "'self'"
    assert headers["x-content-type-options"] == "nosniff"
    if Path(name).suffix.lower() not in (".html", ".svg", ".png"):
        assert headers["content-type"] == "application/octet-stream"
        assert headers["content-disposition"].startswith("attachment")


def test_a_file_that_may_not_be_read_is_not_there(tmp_path, monkeypatch):
    (tmp_path / "a.png").write_bytes(PNG)
    files = FolderFiles(tmp_path)

    def refuse(path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(files, "lookup_path", refuse)
    from starlette.exceptions import HTTPException

    with pytest.raises(HTTPException) as fault:
        asyncio.run(files.get_response("a.png", {"method": "GET"}))
    assert fault.value.status_code == 404


@pytest.mark.parametrize("path", ["/docs", "/redoc", "/openapi.json", "/docs/oauth2-redirect"])
def test_the_interface_is_not_described_to_strangers(pages, path):
    answer = pages.get(path)
    assert answer.status_code == 404
    assert "swagger" not in answer.text


@pytest.mark.parametrize("page", ["camera", "case", "campaign", "runs", "result"])
@pytest.mark.parametrize(
    "name", ["%00", "a" * 5000, "..%2fsecret.toml", "out.toml", ".hidden.txt", "pipe.toml", "undecodable.toml", "loop",
             "result", "effect.toml", "formula.toml", "%f0%9f%94%a5%22%3E%3Cscript%3E", "--trust", "~", "%0a", "a.txt/b"]
)  # fmt: skip
def test_a_page_opens_nothing_outside_and_says_why(pages, place, page, name):
    answer = pages.get(f"/{page}?open={name}&of={name}&template={name}&command={name}")
    assert answer.status_code == 200
    assert "Traceback" not in answer.text
    assert SECRET not in answer.text
    assert not (place / "effect_ran").exists(), "an effect file ran because a page was opened"


def test_names_of_files_become_no_properties(pages):
    text = pages.get("/result?open=result").text
    assert "foo=" in text, "the picture is shown by its name"
    assert not re.search(r'":?foo"\s*:', text)
    assert '"onload"' not in text
    assert "srcdoc" not in text
    assert "iframe" not in re.findall(r'"tag":"(\w+)"', text), "the report is a link out of the folder"


def test_no_component_takes_properties_or_html_from_a_value():
    """Properties that come from values are set by key; a string of them or HTML would be parsed by the page."""
    for file in Path(flashtemp.lab.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if not isinstance(node, ast.Call):
                continue
            where = f"{file.name}:{node.lineno}"
            if isinstance(node.func, ast.Name) and node.func.id == "add_script":
                assert all(isinstance(arg, ast.Constant) for arg in node.args), where
            if not isinstance(node.func, ast.Attribute):
                continue
            if node.func.attr == "props":
                assert all(isinstance(arg, ast.Constant) for arg in node.args), where
            if isinstance(node.func.value, ast.Name) and node.func.value.id == "ui":
                allowed = {"add_head_html"} if file.name == "page_layout.py" else set()  # `add_script`, of assets alone
                assert node.func.attr not in {"html", "markdown", "add_head_html", "add_body_html"} - allowed, where


def test_every_answer_keeps_the_page_out_of_frames_and_its_address_to_itself(pages):
    for path in ("/", "/case", "/nothing", "/files/nothing"):
        headers = pages.get(path).headers
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-frame-options"] == "DENY"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["x-content-type-options"] == "nosniff"
    assert served(GUARD)[1]["referrer-policy"] == "no-referrer"


# --- who gets in -----------------------------------------------------------------------------------------------
NAVIGATES = {"sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"origin": BASE}, 200),
        ({"origin": f"http://localhost:{PORT}"}, 200),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": f"http://127.0.0.1:{PORT + 1}"}, 403),
        ({"origin": f"https://127.0.0.1:{PORT}"}, 403),
        ({"origin": f"http://127.0.0.1:{PORT}.evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "same-origin", "sec-fetch-mode": "cors"}, 200),
        ({"sec-fetch-site": "none", **NAVIGATES}, 200),
        ({"sec-fetch-site": "same-site", **NAVIGATES}, 200),
        ({"sec-fetch-site": "same-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "script"}, 403),
        ({"sec-fetch-site": "same-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "iframe"}, 403),
        ({"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "image"}, 403),
        ({"cookie": ""}, 403),
        ({"cookie": f"flashtemp_lab_{PORT}={TOKEN[:-1]}"}, 403),
        ({"cookie": f"flashtemp_lab_{PORT + 1}={TOKEN}"}, 403),
        ({"cookie": f"a,b=1; path=/; =; x; \xe9=\xff; flashtemp_lab_{PORT}={TOKEN}"}, 200),
        ({"cookie": f"flashtemp_lab_{PORT}=planted; flashtemp_lab_{PORT}={TOKEN}"}, 200),
        ({"cookie": f"flashtemp_lab_{PORT}=\xff\xfe"}, 403),
    ],
)
def test_only_the_page_itself_may_ask(headers, status):
    assert served(GUARD, headers=COOKIE | headers)[0] == status
    opened = served(GUARD, headers=COOKIE | headers, kind="websocket")
    assert opened == ("websocket.accept" if status == 200 and headers.get("sec-fetch-site") != "same-site" else opened)
    if status == 403:
        assert opened == "websocket.close"


@pytest.mark.parametrize("host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1", f"127.0.0.1:{PORT}@evil", ""])
def test_no_other_name_stands_for_the_server(host):
    assert served(GUARD, headers=COOKIE, host=host)[0] == 403
    assert served(GUARD, query=f"token={TOKEN}", host=host)[0] == 403
    assert served(GUARD, headers=COOKIE, host=host, kind="websocket") == "websocket.close"


@pytest.mark.parametrize(
    "path", ["//evil.example", "/\\evil.example", "/\\/evil.example", "/\r\nx: y", "/\u20ac", "/%2f/x"]
)
def test_the_token_leads_to_this_server_only(path):
    status, headers, _ = served(GUARD, path=path, query=f"token={TOKEN}&open=a%0d%0ab")
    assert status == 303
    assert re.fullmatch(r"/(?![/\\])[!-~]*", headers["location"])
    assert TOKEN not in headers["location"]


@pytest.mark.parametrize("query", ["token=" + "x" * 9000, "token=%ff", "token", "&".join(["a=1"] * 5000), "token[]=1"])
def test_a_strange_token_is_refused_in_words(query):
    assert served(GUARD, query=query)[0] == 403


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"content-length": str(MAX_BODY_BYTES)}, 200),
        ({"content-length": str(MAX_BODY_BYTES + 1)}, 413),
        ({"content-length": "9" * 30}, 413),
        ({"content-length": "-1"}, 411),
        ({"transfer-encoding": "chunked"}, 411),
        ({}, 411),
    ],
)
def test_what_is_sent_has_a_length_and_a_limit(headers, status):
    assert served(GUARD, "POST", headers=COOKIE | headers)[0] == status


# --- saving ----------------------------------------------------------------------------------------------------
@pytest.fixture
def home(tmp_path):
    """A folder inside another one that must stay as it is."""
    (tmp_path / "private.toml").write_text("private")
    home = tmp_path / "folder"
    home.mkdir()
    (home / "case.toml").write_text("a = 1\n")
    yield home
    assert (tmp_path / "private.toml").read_text() == "private"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder", "private.toml"]
    assert not [p for p in home.rglob("*.new") if p.is_file() and not p.is_symlink()]


def test_a_page_that_was_overtaken_does_not_save(home):
    """Two pages have one case open: the second to save is told, whatever the first one wrote."""
    (_, one), (_, two) = (read_text(home, "case.toml") for _ in range(2))
    one = write_text(home, "case.toml", "a = 2\n", one)
    with pytest.raises(BadInput, match="changed on disk since it was opened; reload the page or save under another"):
        write_text(home, "case.toml", "a = 3\n", two)
    assert (home / "case.toml").read_text() == "a = 2\n"
    write_text(home, "case.toml", "a = 4\n", one)
    write_text(home, "other.toml", "a = 3\n", two)
    assert ((home / "case.toml").read_text(), (home / "other.toml").read_text()) == ("a = 4\n", "a = 3\n")


def test_another_file_is_replaced_only_when_the_user_says_so(home):
    for opened in (None, read_text(home, "case.toml")[1]):
        (home / "other.toml").write_text("b = 1\n")
        with pytest.raises(ReplacesFile, match=r"other.toml: exists already"):
            write_text(home, "other.toml", "a = 1\n", opened)
        assert (home / "other.toml").read_text() == "b = 1\n"
        write_text(home, "other.toml", "a = 1\n", opened, replace=True)
        assert (home / "other.toml").read_text() == "a = 1\n"


@pytest.mark.parametrize(
    "name", ["a.nc", "fan.py", "a", "", ".", "..", ".toml", ".case.toml", "a/.b.toml", "../private.toml", "/etc/x.toml",
             "a\0.toml", "a" * 300 + ".toml", "case.toml/b.toml", "a.toml/", "folder.toml", "~/../../private.toml"]
)  # fmt: skip
def test_the_editors_write_toml_files_of_the_folder_only(home, name):
    (home / "folder.toml").mkdir()
    with pytest.raises(BadInput):
        write_text(home, name, "a = 1\n")
    assert sorted(p.name for p in home.iterdir()) == ["case.toml", "folder.toml"]


@pytest.mark.parametrize("link", [".case.toml.new", "case.toml", "new.toml", "sub"])
@pytest.mark.parametrize("target", ["../private.toml", "../nothing.toml", "/dev/null"])
def test_saving_follows_no_link_out_of_the_folder(home, link, target):
    (home / link).unlink(missing_ok=True)
    (home / link).symlink_to(target)
    for name in ("case.toml", "new.toml", "sub/a.toml"):
        try:
            write_text(home, name, "mine\n", replace=True)
        except BadInput:
            continue
        assert not (home / name).is_symlink()
        assert (home / name).read_text() == "mine\n"
    assert (home / link).is_symlink(), "a link is left as it is"


def test_the_temporary_name_is_new_and_no_link(home, monkeypatch):
    """Even one who guesses the name gains nothing: the file is made with O_EXCL and O_NOFOLLOW."""
    monkeypatch.setattr(saving.secrets, "token_hex", lambda n: "guessed")
    (home / ".guessed.new").symlink_to("../private.toml")
    with pytest.raises(OSError, match="exists"):
        write_text(home, "case.toml", "mine\n", replace=True)
    assert (home / "case.toml").read_text() == "a = 1\n"


def test_a_save_that_fails_leaves_the_file_as_it_was(home, monkeypatch):
    opened = read_text(home, "case.toml")[1]
    (home / "case.toml").chmod(0o640)

    def full(number):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(saving.os, "fsync", full)
        with pytest.raises(OSError, match="No space"):
            write_text(home, "case.toml", "mine\n", opened)
    assert (home / "case.toml").read_text() == "a = 1\n"
    write_text(home, "case.toml", "mine\n", opened)
    assert (home / "case.toml").stat().st_mode & 0o777 == 0o640, "who may read it stays as it was"


@pytest.mark.parametrize("text", ["\ud800", "a" * (folders.MAX_TOML_BYTES + 1)], ids=["surrogate", "large"])
def test_what_is_no_text_of_a_case_is_not_written(home, text):
    with pytest.raises(BadInput, match="not Unicode|larger than"):
        write_text(home, "a.toml", text)
    assert not (home / "a.toml").exists()


async def chunks(*parts):
    for part in parts:
        yield part


def upload(folder, name, *parts):
    return asyncio.run(write_upload(folder, name, chunks(*parts)))


@pytest.mark.parametrize(
    "name", ["../x.csv", "a/b.csv", "a\\b.csv", "/etc/x.csv", ".x.csv", ".csv", "", "..", "a\0.csv", "a\nb.csv",
             "\u202ecsv.png", "x.toml", "fan.py", "x.sh", "x.html", "case.toml", "a" * 300 + ".csv"]
)  # fmt: skip
def test_an_upload_has_the_plain_name_of_a_camera_file(home, name):
    with pytest.raises(BadInput):
        upload(home, name, b"1")
    assert [p.name for p in home.iterdir()] == ["case.toml"]


def test_an_upload_overwrites_nothing_and_follows_no_link(home):
    (home / "here.csv").write_text("old")
    (home / "out.csv").symlink_to("../private.toml")
    (home / "dangling.csv").symlink_to("../nothing.csv")
    for name in ("here.csv", "out.csv", "dangling.csv"):
        with pytest.raises(BadInput, match="cannot be created"):
            upload(home, name, b"new")
        free = folders.free_name(home, name)
        assert free == name.replace(".csv", "-2.csv")
        assert upload(home, free, b"n", b"ew").read_bytes() == b"new"
    assert (home / "here.csv").read_text() == "old"


def test_an_upload_that_is_too_large_leaves_nothing(home, monkeypatch):
    monkeypatch.setattr(saving, "MAX_UPLOAD_BYTES", 10)
    with pytest.raises(BadInput, match=r"at most 2 GiB and 1000 files at once; copy the file into the folder instead"):
        upload(home, "a.csv", b"12345", b"678901")
    assert not (home / "a.csv").exists()
    assert upload(home, "a.csv", b"1234567890").stat().st_size == 10


def test_a_recording_gets_a_name_that_takes_no_camera_file_with_it(tmp_path):
    """The picture beside NAME.nc is NAME.png, which may be the very image that is imported."""
    (tmp_path / "car.png").write_bytes(PNG)
    part = ImportPart(tmp_path, FrameServer(), ["car.png"], SimpleNamespace(), ImportOptions())
    assert part.out_name == "car-2.nc"
    part.out = SimpleNamespace(value="car.nc")
    with pytest.raises(BadInput, match=r"car.png: is a camera file of this recording"):
        part._claim_names()


def test_a_pipe_is_no_camera_file(home):
    os.mkfifo(home / "a.csv")
    with pytest.raises(BadInput, match="give a camera file"):
        find_camera_files(home, ["a.csv"])


def test_camera_files_are_not_read_through_a_link_out_of_the_folder(home):
    (home / "img1.csv").write_text("1\t2\n")
    (home / "img2.csv").symlink_to("../private.toml")
    for name in ("img2.csv", "img*.csv", "."):
        with pytest.raises(BadInput, match="outside the folder"):
            find_camera_files(home, [name])


# --- programs --------------------------------------------------------------------------------------------------
def test_every_way_to_an_effect_file_is_seen_before_it_runs(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "case.toml").write_text('effects = ["wear", "./fan.py"]\ncandidates = ["/opt/other.py"]\n')
    (tmp_path / "sub" / "case.toml").write_text('effects = "./deep.py"\n')
    (tmp_path / "campaign.toml").write_text('case = "sub/case.toml"\n')
    (tmp_path / "bare.toml").write_text("effects = []\n")
    for words, names in {
        ("run", "case.toml", "--trust"): ["fan.py", "/opt/other.py"],
        ("run", "."): ["fan.py", "/opt/other.py"],
        ("run", "sub"): ["sub/deep.py"],
        ("run", "--resume", "sub"): ["sub/deep.py"],
        ("discover", "campaign.toml"): ["sub/deep.py"],
        ("compare", "."): ["sub/deep.py"],
        ("watch", "sub", "campaign.toml"): ["sub/deep.py"],
        ("run", "bare.toml", 'effects=["./a.py", "wear"]'): ["a.py"],
        ("sweep", "bare.toml", "effects=./a.py,./b.py"): ["a.py", "b.py"],
        ("run", "bare.toml", "candidates=./a.py"): ["a.py"],
        ("run", "bare.toml", "friction.mu=0.8"): [],
        ("run", "nothing.toml"): [],
    }.items():
        expected = [(tmp_path / name).resolve() for name in names]
        assert programs_of_command(words, tmp_path) == expected, words
    (tmp_path / "large.toml").write_text('effects = ["./fan.py"]\n' + "# \n" * folders.MAX_TOML_BYTES)
    with pytest.raises(BadInput, match="larger than"):
        programs_of_command(("run", "large.toml"), tmp_path)
    assert programs_of_text('effects = ["\\u0000.py"]', tmp_path)


def test_a_program_that_changed_is_asked_for_again(tmp_path):
    file = tmp_path / "fan.py"
    file.write_text("1")
    allowed = AllowedPrograms()
    assert allowed.unconfirmed_files([file]) == [file]
    allowed.allow([file])
    assert allowed.unconfirmed_files([file]) == []
    file.write_text("2")
    assert allowed.unconfirmed_files([file]) == [file]


def test_the_question_names_each_file_and_says_that_it_is_a_program(tmp_path):
    lines = program_lines([tmp_path / "fan.py", tmp_path / "\u202eyp.\n.py"], trust=True)
    assert str(tmp_path / "fan.py") in lines
    assert "program" in lines[-1]
    assert all(line.isprintable() for line in lines)
    assert "--trust" in lines[0]
    assert "--trust" in program_lines([], trust=True)[0]


@pytest.mark.parametrize(
    ("words", "known", "asked"),
    [
        (["run", "case.toml"], False, True),
        (["run", "case.toml"], True, False),
        (["run", "case.toml", "--trust"], True, True),
        (["run", "bare.toml", "--trust"], False, True),
        (["run", "bare.toml"], False, False),
        (["run", "bare.toml", "effects=./fan.py"], False, True),
    ],
)
@pytest.mark.parametrize("answer", [False, True])
def test_effect_files_run_only_after_a_click_of_their_own(tmp_path, monkeypatch, words, known, asked, answer):
    (tmp_path / "case.toml").write_text('effects = ["./fan.py"]\n')
    (tmp_path / "bare.toml").write_text("effects = []\n")
    (tmp_path / "fan.py").write_text("")
    allowed, questions, started = AllowedPrograms(), [], []
    if known:
        allowed.allow([tmp_path / "fan.py"])

    async def ask(lines, consent):
        questions.append(lines)
        return answer

    monkeypatch.setattr(page_layout, "ask_consent", ask)
    jobs = SimpleNamespace(start=started.append)
    assert asyncio.run(start_job(tmp_path, jobs, allowed, words)) == (answer or not asked)
    assert started == ([words] if answer or not asked else [])
    assert len(questions) == asked
    if asked and "case.toml" in words:
        assert str(tmp_path / "fan.py") in questions[0]


@pytest.mark.parametrize("link", ["results", ".flashtemp-lab"])
def test_no_command_writes_through_a_link_that_came_with_the_folder(home, link):
    (home / link).symlink_to("..")
    started = []
    with pytest.raises(BadInput, match="a link"):
        asyncio.run(start_job(home, SimpleNamespace(start=started.append), AllowedPrograms(), ["run", "case.toml"]))
    assert started == []


@pytest.mark.parametrize("of", ["--trust", "-x.toml", "--out", "a b.toml", "a'b.toml", "$(id).toml", "a\nb.toml"])
def test_the_name_of_a_file_is_no_option_of_the_command(tmp_path, of):
    page = CommandForm(tmp_path)
    page.resumed, page.command, page.of, page.more = "", *(SimpleNamespace(value=v) for v in ("run", of, ""))
    words = page.command_words()
    assert not words[1].startswith("-")
    assert (tmp_path / words[1]).resolve() == (tmp_path / of).resolve()
    assert not has_trust(words)
    page.resumed = of
    assert not page.command_words()[2].startswith("-")
    assert file_word("case.toml") == "case.toml"


# --- listing ---------------------------------------------------------------------------------------------------
def test_a_listing_of_a_huge_or_hostile_folder_ends_soon_and_says_what_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "MAX_LISTED_FILES", 300)
    monkeypatch.setattr(folders, "MAX_LISTED_FOLDERS", 40)
    os.mkfifo(tmp_path / "case.toml")
    for name in ("piped", "deep"):
        (tmp_path / name).mkdir()
    os.mkfifo(tmp_path / "piped" / ".flashtemp.json")
    (tmp_path / "deep" / ".flashtemp.json").write_text("[" * 100_000)
    (tmp_path / "a.toml").write_text("[" * 20_000)
    (tmp_path / "b.toml").write_text("# \n" * folders.MAX_TOML_BYTES)
    for k in range(500):
        (tmp_path / f"img{k:03}.csv").touch()
    Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.csv")).touch()
    begun = time.monotonic()
    found = folders.list_folder(tmp_path)
    assert time.monotonic() - begun < 5.0
    assert (found.cases, found.begun) == ([], {})
    assert 0 < len(found.images) <= 300
    assert [s.split()[0] for s in found.omissions] == ["Only", "1"]
    many = tmp_path / "many"
    for k in range(60):
        (many / str(k)).mkdir(parents=True)
        (many / str(k) / "a.csv").touch()
    found = folders.list_folder(many)
    assert 0 < len(found.images) < 60
    assert found.omissions


# --- in the browser --------------------------------------------------------------------------------------------
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
CASE = """effects = ["./browsed.py"]
title = "</script><script>window.title_ran=1</script><img src=x onerror='window.title_ran=1'>"
"""
REPORT = """<!DOCTYPE html><title>report</title><p>a report</p>
<script>document.body.append("script ran"); parent.report_ran = 1; top.location = "/case";</script>
<img src="x" onerror="document.body.append('script ran')"><svg onload="document.body.append('script ran')"></svg>
<form id="f" action="/" method="post" target="_top"><button>send</button></form>
<a href="javascript:document.body.append('script ran')">a link</a> <a href="/runs" target="_top">away</a>
<meta http-equiv="refresh" content="0; url=http://127.0.0.1:9/"><iframe src="/case"></iframe>
"""
SVG = '<svg xmlns="http://www.w3.org/2000/svg"><script>document.documentElement.setAttribute("ran","1")</script></svg>'


@pytest.fixture
def context(pages):
    """A browser that has opened the page with its token."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium-headless-shell")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        context = browser.new_context()
        context.set_default_timeout(20_000)
        context.new_page().goto(f"{pages.base}/?token={TOKEN}")
        yield context
        browser.close()


def test_a_hostile_picture_name_and_a_hostile_report_run_no_script_and_start_no_job(context, pages, place):
    base, result = pages.base, place / "shown"
    result.mkdir()
    (result / "verdict.json").write_text('{"verdict": "<img src=x onerror=window.json_ran=1>"}')
    (result / "report.html").write_text(REPORT)
    (result / HOSTILE_PICTURE).write_bytes(PNG)
    (result / "a.svg").write_text(SVG)
    (place / "shown.toml").write_text(CASE)
    (place / "browsed.py").write_text(EFFECT)
    (place / "<img src=x onerror=window.name_ran=1>.toml").write_text("[block]\n")
    ran = "['picture', 'report', 'title', 'json', 'name'].filter(n => window[n + '_ran'])"
    page = context.pages[0]
    page.goto(f"{base}/")
    page.get_by_text("onerror=window.name_ran").first.wait_for()
    page.goto(f"{base}/result?open=shown")
    report = page.frame_locator("iframe")
    report.get_by_text("a report").wait_for()
    assert page.locator("iframe").get_attribute("sandbox") == ""
    report.get_by_text("a link").click()
    report.get_by_text("away").click()
    report.get_by_text("send").click()
    page.wait_for_function("document.querySelectorAll('.q-img img').length == 2")
    assert "script ran" not in report.locator("body").inner_text()
    assert page.url.startswith(f"{base}/result?")
    assert page.evaluate(ran) == []
    other = context.new_page()
    other.goto(f"{base}/files/shown/a.svg")
    assert other.locator("svg").get_attribute("ran") is None
    other.goto(f"{base}/files/shown/report.html")
    assert "script ran" not in other.locator("body").inner_text()

    page.goto(f"{base}/case?open=shown.toml")
    page.get_by_role("alert").get_by_text(str(place / "browsed.py")).wait_for()
    other.goto(f"{base}/case?open=shown.toml")
    other.get_by_role("alert").wait_for()
    assert page.evaluate(ran) == []
    page.get_by_role("button", name="Save").click()
    page.get_by_text("shown.toml is saved").wait_for()
    (place / "shown.toml").write_text(CASE + "# by another program\n")
    other.get_by_role("button", name="Save").click()
    other.get_by_text("changed on disk since it was opened").wait_for()

    page.goto(f"{base}/runs?command=run&of=shown.toml")
    page.get_by_text("Further arguments", exact=True).click()
    page.get_by_label("further arguments: table").fill("--trust")
    page.get_by_label("further arguments: table").press("Tab")
    page.get_by_role("button", name="Start").click()
    question = page.get_by_role("alertdialog")
    question.get_by_text(str(place / "browsed.py")).wait_for()
    question.get_by_text("is a Python program").wait_for()
    question.get_by_role("button", name="Cancel").click()
    question.wait_for(state="detached")
    assert not (place / ".flashtemp-lab").exists(), "no job"
    assert not (place / "effect_ran").exists(), "no program"
    page.get_by_role("button", name="Start").click()
    question.get_by_role("button", name="Run as a program").click()
    page.get_by_text(re.compile("failed|running")).first.wait_for()
    assert list((place / ".flashtemp-lab").glob("*-run.log"))
