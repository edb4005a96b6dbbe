"""Keys that are typed before the screen that they are meant for can take them."""

from collections import deque
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from textual.events import Key
from textual.timer import Timer

from fraexp.tui.page import Page

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

TICK = 0.02
"""Seconds between two looks whether the next key may go."""
AT_ONCE = ("ctrl+c", "ctrl+q")
"""Keys that never wait."""


class Ahead:
    """Holds keys back while a screen reads for the first time what it shows; then lets them go one by one."""

    def __init__(self, app: "FraexpApp") -> None:
        self._app = app
        self._held: deque[Key] = deque()
        self._timer: Timer | None = None

    def takes(self, key: Key, deliver: Callable[[Key], Awaitable[None]]) -> bool:
        """Return whether a key is held back; it is delivered later then."""
        if key.key in AT_ONCE or (not self._held and self._ready()):
            return False
        self._held.append(key)
        if self._timer is None:
            self._timer = self._app.set_interval(TICK, lambda: self._let_go(deliver))
        return True

    async def _let_go(self, deliver: Callable[[Key], Awaitable[None]]) -> None:
        if self._held and self._ready() and self._quiet():
            await deliver(self._held.popleft())
        if not self._held and self._timer:
            self._timer.stop()
            self._timer = None

    def _ready(self) -> bool:
        stack = self._app.screen_stack  # which is empty while places change
        return bool(stack) and (not isinstance(stack[-1], Page) or stack[-1].ready)

    def _quiet(self) -> bool:
        """Return whether the key before has been dealt with: it may open a screen, or lead to another line."""
        focused = self._app.focused or self._app.screen
        return not any(of.message_queue_size for of in focused.ancestors_with_self)
