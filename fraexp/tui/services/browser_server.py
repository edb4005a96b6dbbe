"""A web server for the terminal UI: a session of ``fraexp tui`` for each page, protected by a token."""

import asyncio
import hmac
import ipaddress
import logging
import re
import secrets
import shlex
import socket
import sys
from collections.abc import Awaitable, Callable, Sequence
from typing import Any
from urllib.parse import urlsplit

from aiohttp import web
from textual_serve.app_service import AppService
from textual_serve.server import Server

from fraexp.errors import FraexpError

COOKIE_NAME = "fraexp"
CONTENT_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; frame-ancestors 'none'"
)
"""What a page may load: nothing from other hosts."""
LINK = re.compile(r"<link[^>]*https?://([^/\"'>]*)[^>]*>", re.DOTALL)
"""A link with a host, which may be that of the page itself."""
KEYBOARD_SCRIPT = """<script>
  const takeKeyboard = () => {
    const input = document.querySelector("#terminal textarea");
    if (input) { input.focus(); } else { requestAnimationFrame(takeKeyboard); }
  };
  addEventListener("load", takeKeyboard);
  addEventListener("focus", takeKeyboard);
</script>
</head>"""
"""What gives the keyboard to the terminal as soon as it exists, and whenever the window has it."""
QUIT_TIMEOUT_S = 5.0
"""Maximum seconds that a session may take to quit."""
DENIED_TEXT = "fraexp: token required. Open the address that 'fraexp serve' has printed, including its token.\n"
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def is_local(host: str) -> bool:
    """Return whether an address can be reached from this machine only."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class _AccessGuard:
    """Middleware that admits requests with the token, from pages of this server."""

    def __init__(self, host: str, token: str) -> None:
        self._host = host
        self._token = token

    @web.middleware
    async def check(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request, or reject it."""
        if not self._is_own_host(request.host) or not self._is_own_page(request):
            return web.Response(
                status=403, text="fraexp: unknown address. Open the address that 'fraexp serve' has printed.\n"
            )
        given = request.query.get("token", "")
        if not self._is_token(given or request.cookies.get(COOKIE_NAME, "")):
            return web.Response(status=403, text=DENIED_TEXT)
        if given and request.path == "/":
            entered = web.HTTPFound("/")  # so that the token is neither in the address bar nor in the history
            entered.set_cookie(COOKIE_NAME, given, httponly=True, samesite="Strict")
            return entered
        return await handler(request)

    def _is_token(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    def _is_own_host(self, host: str) -> bool:
        """Return whether the request names this server itself, not a host name that was rebound to its address."""
        name = urlsplit(f"//{host}").hostname or ""
        return name == self._host or is_local(name) or not is_local(self._host)

    def _is_own_page(self, request: web.Request) -> bool:
        """Return whether the request comes from a page of this server, as other pages can open web sockets too."""
        origin = request.headers.get("Origin")
        return origin is None or urlsplit(origin).netloc == request.host


class _FraexpServer(Server):
    """A server of terminal sessions that are protected by a token.

    textual-serve has no public hook for middleware and for the end of a session: `_make_app`, `_process_messages` and
    the session's `_process` are its private members, which tests/tui/test_toolkit.py watches.
    """

    def __init__(self, command: Sequence[str], host: str, port: int, token: str) -> None:
        super().__init__(shlex.join(command), host, port, title="fraexp")
        self._guard = _AccessGuard(host, token)
        self._address = f"{self.public_url}/?token={token}"

    def initialize_logging(self) -> None:
        """Log failures, but not requests, which contain the token."""
        logging.basicConfig(level=logging.ERROR, format="%(message)s")

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()
        app.middlewares.extend([self._guard.check, _adapt_page])
        app.on_response_prepare.append(_add_security_headers)
        return app

    async def handle_index(self, request: web.Request) -> Any:
        """Return the page, with the address under which the browser sees this server: its port may be forwarded."""
        self.public_url = f"{request.scheme}://{request.host}"
        return await super().handle_index(request)

    async def _process_messages(self, websocket: web.WebSocketResponse, app_service: AppService) -> None:
        try:
            await super()._process_messages(websocket, app_service)
        finally:
            await app_service.stop()
            await _wait_for_exit(app_service._process)

    async def on_startup(self, app: web.Application) -> None:
        """Print the address."""
        print(f"fraexp is served at {self._address}", flush=True)
        print("Ctrl-C ends all sessions; runs continue", file=sys.stderr, flush=True)


@web.middleware
async def _adapt_page(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Return the page without links to other hosts, with the keyboard in the terminal."""
    response = await handler(request)
    if request.path == "/" and isinstance(response, web.Response) and response.text:
        response.text = without_foreign_links(response.text, request.host).replace("</head>", KEYBOARD_SCRIPT, 1)
    return response


def without_foreign_links(page: str, host: str) -> str:
    """Return a page without the links to hosts other than its own, such as to fonts; the page then uses local ones."""
    return LINK.sub(lambda link: link[0] if link[1] == host else "", page)


async def _wait_for_exit(process: asyncio.subprocess.Process | None) -> None:
    """Wait for a stopped session, and kill it after a timeout: none outlives its page or the server."""
    if process is None:
        return
    try:
        await asyncio.wait_for(process.wait(), QUIT_TIMEOUT_S)
    except TimeoutError:
        process.kill()
        await process.wait()


async def _add_security_headers(request: web.Request, response: web.StreamResponse) -> None:
    response.headers["Content-Security-Policy"] = CONTENT_POLICY
    response.headers["Referrer-Policy"] = "no-referrer"


def serve(command: Sequence[str], host: str, port: int, token: str) -> None:
    """Serve until interrupted; FraexpError if the address is unavailable, or public without a token."""
    if not is_local(host) and not token:
        raise FraexpError(
            f"serve: other machines can reach {host}, and act with your rights; "
            "to allow this, give a --token of at least 16 letters and digits"
        )
    if token and (len(token) < 16 or not token.isascii() or not token.isalnum()):
        raise FraexpError(
            "serve: the token is too weak; expected at least 16 letters and digits, or no --token for a random one"
        )
    _check_free(host, port)
    _FraexpServer(command, host, port, token or secrets.token_hex(16)).serve()


def _check_free(host: str, port: int) -> None:
    if not 0 < port < 65536:
        raise FraexpError(f"serve: invalid port {port}; expected 1 to 65535, such as --port 8000")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family[0]) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(family[4])
    except OSError as error:
        raise FraexpError(f"serve: {host}:{port} cannot be used ({error.strerror}); choose another --port") from None
