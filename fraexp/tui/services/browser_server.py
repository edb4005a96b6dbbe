"""The terminal UI in a browser: a session of ``fraexp tui`` for each page, for those who have the token."""

import asyncio
import hmac
import ipaddress
import logging
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

COOKIE = "fraexp"
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; frame-ancestors 'none'"
)
"""What a page may load: nothing from other places, also not the letters that the template asks for there."""
PATIENCE = 5.0
"""Seconds that a session may take to quit."""
DENIED = "This fraexp wants a token: open the address that 'fraexp serve' has printed, with its token at the end.\n"
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def is_local(host: str) -> bool:
    """Return whether an address is reached from this machine alone."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class Door:
    """Who may enter: whoever has the token, from a page of this server."""

    def __init__(self, host: str, token: str) -> None:
        self._host = host
        self._token = token

    @web.middleware
    async def check(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request, or refuse it."""
        if not self._named(request.host) or not self._own(request):
            return web.Response(status=403, text="This is not the address that 'fraexp serve' has printed.\n")
        given = request.query.get("token", "")
        if not self._fits(given or request.cookies.get(COOKIE, "")):
            return web.Response(status=403, text=DENIED)
        if given and request.path == "/":
            entered = web.HTTPFound("/")  # the token stays neither in the address bar nor in the history
            entered.set_cookie(COOKIE, given, httponly=True, samesite="Strict")
            return entered
        return await handler(request)

    def _fits(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    def _named(self, host: str) -> bool:
        """Return whether the browser asked for this server by its own name, not by one that was bent to it."""
        name = urlsplit(f"//{host}").hostname or ""
        return name == self._host or is_local(name) or not is_local(self._host)

    def _own(self, request: web.Request) -> bool:
        """Return whether it is a page of this server that asks: others may open web sockets, too."""
        origin = request.headers.get("Origin")
        return origin is None or urlsplit(origin).netloc == request.host


class FraexpServer(Server):
    """A server of terminal sessions behind a door."""

    def __init__(self, command: Sequence[str], host: str, port: int, token: str) -> None:
        super().__init__(shlex.join(command), host, port, title="fraexp")
        self._door = Door(host, token)
        self._address = f"{self.public_url}/?token={token}"

    def initialize_logging(self) -> None:
        """Log what fails, without the requests, in which the token stands."""
        logging.basicConfig(level=logging.ERROR, format="%(message)s")

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()
        app.middlewares.append(self._door.check)
        app.on_response_prepare.append(_guarded)
        return app

    async def handle_index(self, request: web.Request) -> Any:
        """Return the page, with addresses as the browser sees this server: its port may be forwarded."""
        self.public_url = f"{request.scheme}://{request.host}"
        return await super().handle_index(request)

    async def _process_messages(self, websocket: web.WebSocketResponse, app_service: AppService) -> None:
        try:
            await super()._process_messages(websocket, app_service)
        finally:
            await app_service.stop()
            await _ended(app_service._process)

    async def on_startup(self, app: web.Application) -> None:
        """Tell the address."""
        print(f"fraexp is at {self._address}", flush=True)
        print("Ctrl-C ends the sessions; runs go on", file=sys.stderr, flush=True)


async def _ended(process: asyncio.subprocess.Process | None) -> None:
    """Wait for a session that was asked to quit, and end it if it does not: none outlives its page or the server."""
    if process is None:
        return
    try:
        await asyncio.wait_for(process.wait(), PATIENCE)
    except TimeoutError:
        process.kill()
        await process.wait()


async def _guarded(request: web.Request, response: web.StreamResponse) -> None:
    response.headers["Content-Security-Policy"] = POLICY
    response.headers["Referrer-Policy"] = "no-referrer"


def serve(command: Sequence[str], host: str, port: int, remote: bool, token: str) -> None:
    """Serve until interrupted; FraexpError if the address is not to be had, or open to others without being asked."""
    if not is_local(host) and not (remote and token):
        raise FraexpError(
            f"serve: others can reach {host}, and whoever comes in acts as you; "
            "if that is wanted give --remote and a --token of 16 characters or more"
        )
    if token and (len(token) < 16 or not token.isascii() or not token.isalnum()):
        raise FraexpError("serve: the token is weak; expected 16 letters and digits or more, or none to have one made")
    _check_free(host, port)
    FraexpServer(command, host, port, token or secrets.token_hex(16)).serve()


def _check_free(host: str, port: int) -> None:
    if not 0 < port < 65536:
        raise FraexpError(f"serve: {port} is no port; expected 1 to 65535, such as --port 8000")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family[0]) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(family[4])
    except OSError as error:
        raise FraexpError(f"serve: {host}:{port} cannot be used ({error.strerror}); give another --port") from None
