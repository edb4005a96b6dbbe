"""The terminal UI in a browser: who comes in, and what a real one shows."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import pyte
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.tui.services.browser_server import is_local, without_foreign_links
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE
from tests.waiting import HANG_TIMEOUT_S

TOKEN = "abcdefghij0123456789"
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Served(NamedTuple):
    process: "subprocess.Popen[str]"
    port: int


def free_port() -> int:
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


@pytest.fixture(autouse=True)
def _kept_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """`serve` tells its sessions the database by a variable, which must not reach the tests that follow."""
    monkeypatch.setenv(DATABASE_VARIABLE, "")


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    port = free_port()
    options = [f"--port={port}", f"--token={TOKEN}", f"--workspace={tmp_path}"]
    command = [sys.executable, "-m", "fraexp", "serve", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stdout.readline().startswith(f"fraexp is served at http://127.0.0.1:{port}/?token=")
        yield Served(process, port)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=HANG_TIMEOUT_S)
        assert TOKEN not in errors
        assert "Traceback" not in errors


def answer(port: int, path: str = "/", **headers: str) -> tuple[int, str]:
    end = time.monotonic() + HANG_TIMEOUT_S
    while True:
        connection = HTTPConnection("127.0.0.1", port, timeout=HANG_TIMEOUT_S)
        try:
            connection.request("GET", path, headers=headers)
            reply = connection.getresponse()
            return reply.status, reply.getheader("Set-Cookie") or ""
        except ConnectionRefusedError:  # the address is told just before it listens
            assert time.monotonic() < end
            time.sleep(0.05)
        finally:
            connection.close()


def test_only_whoever_has_the_token_comes_in_and_no_page_uses_its_cookie(served: Served) -> None:
    for path in ("/", "/ws", "/static/js/textual.js", "/?token=wrong"):
        assert answer(served.port, path)[0] == 403
    assert answer(served.port, Cookie="fraexp=wrong")[0] == 403
    status, cookie = answer(served.port, f"/?token={TOKEN}")
    assert status == 302
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    kept = cookie.partition(";")[0]
    assert kept == f"fraexp={TOKEN}"
    assert answer(served.port, Cookie=kept)[0] == 200
    assert answer(served.port, "/ws", Cookie=kept, Origin="http://evil.example")[0] == 403
    assert answer(served.port, "/", Cookie=kept, Host="evil.example")[0] == 403  # a name bent to this machine


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--host=0.0.0.0"], "give a --token"),
        (["--host=0.0.0.0", "--token=short"], "the token is too weak"),
        (["--token=a b c d e f g h i j k l"], "the token is too weak"),
        (["--port=0"], "invalid port 0"),
        (["--host=no.such.name.invalid", f"--token={TOKEN}"], "cannot be used"),
    ],
)
def test_what_would_let_others_in_is_refused(
    options: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["serve", f"--workspace={tmp_path}", *options]) == ExitCode.USAGE
    assert said in capsys.readouterr().err


def test_a_port_in_use_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert main(["serve", f"--workspace={tmp_path}", f"--port={taken.getsockname()[1]}"]) == ExitCode.USAGE
    assert "choose another --port" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("host", "local"),
    [("127.0.0.1", True), ("::1", True), ("[::1]", True), ("localhost", True), ("127.8.8.8", True),
     ("0.0.0.0", False), ("::", False), ("192.168.0.1", False), ("localhost.evil.example", False)],
)  # fmt: skip
def test_which_addresses_others_reach(host: str, local: bool) -> None:
    assert is_local(host) is local


class Shown:
    """What a browser's terminal shows, from the bytes that it got."""

    def __init__(self) -> None:
        self._screen = pyte.Screen(200, 60)
        self._stream = pyte.ByteStream(self._screen)

    def take(self, frame: str | bytes) -> None:
        if isinstance(frame, bytes):
            self._stream.feed(frame)

    @property
    def text(self) -> str:
        return "\n".join(self._screen.display)


def until(holds: Callable[[], bool], step: Callable[[], object]) -> bool:
    end = time.monotonic() + HANG_TIMEOUT_S
    while not holds() and time.monotonic() < end:
        step()
    return holds()


@pytest.mark.thorough
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")
def test_a_browser_shows_the_studies_and_takes_keys(served: Served, tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    shown = Shown()
    sandbox = [] if os.name != "posix" or os.geteuid() else ["--no-sandbox"]  # which Chromium wants of root
    assert answer(served.port)[0] == 403  # it listens
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=BROWSER, args=sandbox)
        page = browser.new_page(viewport={"width": 1200, "height": 700})
        page.on("websocket", lambda socket: socket.on("framereceived", shown.take))
        asked: list[str] = []
        page.on("request", lambda request: asked.append(urlsplit(request.url).hostname or ""))
        refused: list[str] = []
        page.on("console", lambda message: refused.append(message.text) if "Content Security" in message.text else None)
        page.goto(f"http://127.0.0.1:{served.port}/?token={TOKEN}")
        assert urlsplit(page.url).query == ""  # the token is not left in the address bar
        wait = lambda: page.wait_for_timeout(100)  # noqa: E731
        assert until(lambda: "Quick look" in shown.text, wait), shown.text
        assert page.evaluate("document.activeElement.tagName") == "TEXTAREA"  # without a click
        page.keyboard.press("r")
        assert until(lambda: "fraexp list" in shown.text, wait), shown.text
        page.keyboard.press("s")
        assert until(lambda: "Quick look" in shown.text, wait), shown.text
        picture = tmp_path / "page.png"
        page.screenshot(path=picture)
        browser.close()
    assert set(asked) == {"127.0.0.1"}  # no font, and nothing else, from another host
    assert refused == []  # nor is it asked for, and refused
    assert picture.stat().st_size > 10_000  # an empty page has fewer


def test_links_to_other_hosts_are_removed_and_those_of_the_page_itself_kept() -> None:
    own = '<link rel="stylesheet" href="http://127.0.0.1:8000/static/css/xterm.css" />'
    font = '<link\n rel="stylesheet"\n href="https://fonts.example/css?family=Roboto%20Mono"\n/>'
    neighbour = '<link href="http://127.0.0.1:8001/x.css">'
    assert without_foreign_links(f"<head>{own}{font}{neighbour}</head>", "127.0.0.1:8000") == f"<head>{own}</head>"
