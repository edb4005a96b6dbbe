"""What all screens have in common: where one is, the command line that does the same, the keys, and what went wrong."""

import asyncio
import re
import time
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, ClassVar, TypeVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.reactive import reactive
from textual.screen import Screen
from textual.widgets import Footer, Static

from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import printable

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

Answer = TypeVar("Answer")

PLACES = {"studies": "Studies", "runs": "Runs", "sweeps": "Sweeps", "compare": "Compare", "plugins": "Plugins"}
"""The screens between which a key leads from anywhere, by the name of their mode; their first letter but for sweeps."""


PATIENCE = 2.0
"""Seconds for which keys wait while a screen reads what it shows at first."""
LOAD, PAGE = READING = "load", "page"
"""Groups of the workers that read what is shown: by the screen, and by its tables."""
LONG = 60
"""Characters of a quoted value that are told."""
MOST = 800
"""Characters of a message that are told: it must leave room for the rest of the screen."""
QUOTED = re.compile(rf"(?<!\w)(['\"])((?:(?!\1).){{{LONG + 1},}})\1", re.DOTALL)


def shortened(text: str) -> str:
    """Return a message in which long quoted values are cut, and the end if it is long even so."""
    text = QUOTED.sub(lambda found: f"{found[1]}{found[2][: LONG - 3]}...{found[1]}", text)
    return text if len(text) <= MOST else f"{text[:MOST]}..."


class Changed(Message):
    """The database has changed, or time has passed, in which a run may have died."""

    def __init__(self, data: bool) -> None:
        super().__init__()
        self.data = data
        """Whether it is the database."""


class Head(Static):
    """Two lines: where one is and what is marked; and the command line that gives the same as the screen."""

    DEFAULT_CSS = """
    Head { height: 2; dock: top; background: $panel; padding: 0 1; text-wrap: nowrap; text-overflow: ellipsis; }
    """

    def show(self, place: str, title: str, marked: int, command: str) -> None:
        """Show where one is."""
        first = Text("fraexp ", style="bold")
        for mode, name in PLACES.items():
            first.append(f" {name} ", style="reverse bold" if mode == place else "")
        if title:
            first.append(f"  {printable(title)}", style="italic")
        if marked:
            first.append(f"  {marked} marked", style="bold")
        self.update(Text("\n").join([first, Text(f"$ {printable(command)}", style="dim")]), layout=False)


class Notice(Static):
    """What stands where nothing is to be shown: loading, empty, or an error with its remedy."""

    DEFAULT_CSS = """
    Notice { width: 1fr; height: auto; padding: 1 2; display: none; }
    Notice.-shown { display: block; }
    Notice.-error { color: $text-error; }
    """

    def tell(self, text: str, error: bool = False) -> None:
        """Show a text, or nothing."""
        self.update(Text("\n".join(printable(line) for line in shortened(text).splitlines())))
        self.set_class(bool(text), "-shown")
        self.set_class(error, "-error")


class Page(Screen[None]):
    """A screen of the application.

    A subclass yields its widgets from `body`, sets `command`, and reads what it shows in `load`, which runs when the
    screen is shown and whenever the database has changed; what `fetch` cannot get is told in the screen's notice.
    """

    PLACE: ClassVar[str] = ""
    """Name of its mode."""
    HELP: ClassVar[str] = ""
    """What the screen is for, and its words, as its help shows them."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "back", "back", show=False, id="back", tooltip="one layer back"),
        Binding("question_mark,f1", "app.keys", "help", id="help", tooltip="what this screen is for, and its keys"),
        Binding("y", "copy_command", "copy", show=False, id="copy", tooltip="copy the command line at the top"),
    ]
    live: bool = False
    """Whether something runs that is shown, so that time matters."""
    _reading = _once_more = _ready = False
    _began: float | None = None  # when it began to read
    command: reactive[str] = reactive("fraexp tui", repaint=False)
    heading: reactive[str] = reactive("", repaint=False)

    app: "FraexpApp"

    def compose(self) -> ComposeResult:
        """Put what the screen shows between head and keys."""
        yield Head()
        yield Notice()
        yield from self.body()
        yield Footer(show_command_palette=False)

    def body(self) -> ComposeResult:
        """Yield the screen's own widgets."""
        yield from ()

    async def load(self) -> None:
        """Read what the screen shows."""

    def on_mount(self) -> None:
        """Show the head at once; the rest is read when the screen is shown, which is next."""
        self.head()

    def on_screen_resume(self) -> None:
        """Read what the screen shows, or look again at what may have changed meanwhile."""
        self.head()
        self.reload()

    def on_changed(self, event: Changed) -> None:
        """Look again, also as time passes if something that is shown lives."""
        if event.data or self.live:
            self.reload()

    @property
    def ready(self) -> bool:
        """Whether all that it shows at first has been read, and keys find what they are meant for; or takes long."""
        if not self._ready and self._began is not None:
            reading = any(of.group in READING and not of.is_finished and of.node.screen is self for of in self.workers)
            self._ready = not reading or time.monotonic() > self._began + PATIENCE
        return self._ready

    def reload(self) -> None:
        """Start reading; what is being read already is read once more afterwards, and never left half shown."""
        self._began = self._began or time.monotonic()
        if self._reading:
            self._once_more = True
            return
        self._reading = True
        self.run_worker(self._read_all(), group=LOAD)

    async def _read_all(self) -> None:
        self._once_more = True
        try:
            while self._once_more:
                self._once_more = False
                await self.load()
        finally:
            self._reading = False

    async def fetch(self, asked: Awaitable[Answer], instead: Callable[[str], None] | None = None) -> Answer | None:
        """Return what was asked for; None if it cannot be had, which is told in the notice, or by `instead`."""
        try:
            return await self.here(asked)
        except FraexpError as error:
            (instead or self.tell_error)(str(error))
            return None

    async def here(self, asked: Awaitable[Answer]) -> Answer:
        """Return what was asked for, or raise what came of it; what asks ends if the screen has been left meanwhile."""
        try:
            return await asked
        finally:
            if self.app._exit or self._pruning or not self.is_running:
                raise asyncio.CancelledError  # there is nothing to show it in

    def tell_error(self, text: str) -> None:
        """Show an error in place of what the screen shows."""
        self.query_one(Notice).tell(text, error=True)

    def tell(self, text: str = "") -> None:
        """Show a text in place of what the screen shows; without one take it away."""
        self.query_one(Notice).tell(text)

    def head(self) -> None:
        """Show where one is."""
        if self.is_mounted:
            self.query_one(Head).show(self.PLACE, self.heading, len(self.app.marks), self.command)

    def watch_command(self) -> None:
        """Show another command."""
        self.head()

    def watch_heading(self) -> None:
        """Show another title."""
        self.head()

    def action_back(self) -> None:
        """Leave what was opened last; the first screen stays."""
        if len(self.app.screen_stack) > 1:
            self.app.pop_screen()

    def action_copy_command(self) -> None:
        """Copy the command line that gives the same as the screen."""
        self.app.copy_to_clipboard(self.command)
        self.app.notify(self.command, title="copied, if the terminal lets it", timeout=3)
