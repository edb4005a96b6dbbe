"""A queue for keys that arrive before they can be handled: typed ahead, pasted, or sent over a slow line."""

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

RELEASE_INTERVAL_S = 0.02
"""Seconds between two attempts to deliver the next key."""
MAX_WAIT_S = 0.25
"""Maximum seconds that a key waits for the effect of the previous one, on a screen that is always busy."""
IMMEDIATE_KEYS = ("ctrl+c", "ctrl+q")
"""Keys that are never queued."""


class KeyQueue:
    """Delivers keys in order, and not before the screen has loaded.

    A letter goes straight to the focused input; a key with a binding passes through its ancestors first. A letter that
    followed it at once would overtake it.
    """

    def __init__(self, app: "FraexpApp") -> None:
        self._app = app
        self._held: deque[Key] = deque()
        self._timer: Timer | None = None
        self._before: Key | None = None
        self._since = 0.0

    def holds(self, key: Key, deliver: Callable[[Key], Awaitable[None]]) -> bool:
        """Return whether a key is queued; `deliver` is then called later."""
        if key.key in IMMEDIATE_KEYS:
            return False
        if not self._held and self._is_ready() and self._is_handled():
            self._note_delivered(key)
            return False
        self._held.append(key)
        if self._timer is None:
            self._timer = self._app.set_interval(RELEASE_INTERVAL_S, lambda: self._release(deliver))
        return True

    async def _release(self, deliver: Callable[[Key], Awaitable[None]]) -> None:
        while self._held and self._is_ready() and self._is_handled():
            key = self._held.popleft()
            self._note_delivered(key)
            await deliver(key)
        if not self._held and self._timer:
            self._timer.stop()
            self._timer = None

    def _note_delivered(self, key: Key) -> None:
        self._before, self._since = key, time.monotonic()

    def _is_ready(self) -> bool:
        stack = self._app.screen_stack  # empty while places change
        return bool(stack) and (not isinstance(stack[-1], Page) or stack[-1].ready)

    def _is_handled(self) -> bool:
        """Return whether the previous key has taken effect: it may open a screen, or move the focus."""
        if self._before is None or time.monotonic() > self._since + MAX_WAIT_S:
            return True
        focused = self._app.focused
        if isinstance(focused, Input) and self._before.is_printable:
            return True
        return not any(of.message_queue_size for of in (focused or self._app.screen).ancestors_with_self)
