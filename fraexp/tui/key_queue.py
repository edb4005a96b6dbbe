"""Keys that come faster than they can be taken: typed before a screen is there, pasted, or sent over a slow line."""

import time
from collections import deque
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from textual.events import Key
from textual.timer import Timer
from textual.widgets import Input

from fraexp.tui.page import Page

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

TICK = 0.02
"""Seconds between two looks whether the next key may go."""
LONGEST = 0.25
"""Seconds that a key waits for what the one before does, at most: on a screen that is always busy."""
AT_ONCE = ("ctrl+c", "ctrl+q")
"""Keys that never wait."""


class Ahead:
    """Lets keys take effect in their order, and not before the screen has read what it shows at first.

    A letter goes straight to the line that is written in; a key that has a meaning goes through all that is around the
    line first. A letter that followed it at once would overtake it.
    """

    def __init__(self, app: "FraexpApp") -> None:
        self._app = app
        self._held: deque[Key] = deque()
        self._timer: Timer | None = None
        self._before: Key | None = None
        self._since = 0.0

    def takes(self, key: Key, deliver: Callable[[Key], Awaitable[None]]) -> bool:
        """Return whether a key is held back; it is delivered later then."""
        if key.key in AT_ONCE:
            return False
        if not self._held and self._ready() and self._done():
            self._let_pass(key)
            return False
        self._held.append(key)
        if self._timer is None:
            self._timer = self._app.set_interval(TICK, lambda: self._let_go(deliver))
        return True

    async def _let_go(self, deliver: Callable[[Key], Awaitable[None]]) -> None:
        while self._held and self._ready() and self._done():
            key = self._held.popleft()
            self._let_pass(key)
            await deliver(key)
        if not self._held and self._timer:
            self._timer.stop()
            self._timer = None

    def _let_pass(self, key: Key) -> None:
        self._before, self._since = key, time.monotonic()

    def _ready(self) -> bool:
        stack = self._app.screen_stack  # which is empty while places change
        return bool(stack) and (not isinstance(stack[-1], Page) or stack[-1].ready)

    def _done(self) -> bool:
        """Return whether the key before has taken effect: it may open a screen, or lead to another line."""
        if self._before is None or time.monotonic() > self._since + LONGEST:
            return True
        focused = self._app.focused
        if isinstance(focused, Input) and self._before.is_printable:
            return True
        return not any(of.message_queue_size for of in (focused or self._app.screen).ancestors_with_self)
