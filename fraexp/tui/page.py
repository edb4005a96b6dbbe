"""The base of all screens: a header with the place and the equivalent command, a notice, and the keys."""

import asyncio
import re
import time
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, ClassVar, TypeVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.message import Message
from textual.reactive import reactive
from textual.screen import Screen
from textual.widgets import Footer, Static

from fraexp.data.texts import printable
from fraexp.errors import FraexpError

if TYPE_CHECKING:
    from fraexp.store import Store
    from fraexp.tui.app import FraexpApp
    from fraexp.workspace.workspace_service import WorkspaceService

Answer = TypeVar("Answer")

PLACES = {"studies": "Studies", "runs": "Runs", "sweeps": "Sweeps", "compare": "Compare", "plugins": "Plugins"}
PLACE_KEYS = {"sweeps": "w"}
"""Places whose key is not their first letter."""
"""The places that a key leads to from anywhere, by mode: the first letter of the name, but w for sweeps."""


LOAD_TIMEOUT_S = 2.0
"""Maximum seconds that keys wait for a screen to load."""
LOAD_GROUP, TABLE_GROUP = READING_GROUPS = "load", "page"
"""Groups of the workers that load: those of the screen, and those of its tables."""
ACTION_GROUP = "action"
"""Group of the workers that ask the user something: the next keys are for the dialog."""
MAX_QUOTE_LENGTH = 60
"""Maximum characters of a quoted value in a message."""
MAX_MESSAGE_LENGTH = 800
"""Maximum characters of a message: it must leave room for the rest of the screen."""
MAX_COMMAND_LENGTH = 400
"""Maximum characters of the command line that are drawn, more than the columns of a terminal; it is copied whole."""
LONG_QUOTE = re.compile(rf"(?<!\w)(['\"])((?:(?!\1).){{{MAX_QUOTE_LENGTH + 1},}})\1", re.DOTALL)


def shorten(text: str) -> str:
    """Return a message with long quoted values cut, and its end if it is still too long."""
    text = LONG_QUOTE.sub(lambda found: f"{found[1]}{found[2][: MAX_QUOTE_LENGTH - 3]}...{found[1]}", text)
    return text if len(text) <= MAX_MESSAGE_LENGTH else f"{text[:MAX_MESSAGE_LENGTH]}..."


class DatabaseChanged(Message):
    """The database has changed, or some time has passed, in which a run may have died."""

    def __init__(self, data: bool) -> None:
        super().__init__()
        self.data = data
        """Whether the database has changed."""


class PageHeader(Static):
    """Two lines: the place and the number of marked sweeps; and the equivalent command line."""

    def show(self, place: str, title: str, marked: int, command: str, measuring: str = "") -> None:
        """Show place, title, marks, the measurement that is running, and command."""
        parts: list[tuple[str, str]] = [("fraexp ", "bold $primary")]
        for mode, name in PLACES.items():
            parts += _place_parts(name, PLACE_KEYS.get(mode, name[0].lower()), mode == place)
        parts += [(f" {measuring} ", "bold $warning")] if measuring else []
        parts += [(f"  {printable(title)}", "bold")] if title else []
        parts += [(f"  {marked:,} marked", "bold $accent")] if marked else []
        parts += [("\n$ ", "$accent"), (printable(command[:MAX_COMMAND_LENGTH]), "$text-muted")]
        self.update(Content.assemble(*parts), layout=False)


def _place_parts(name: str, key: str, current: bool) -> list[tuple[str, str]]:
    """Return the parts of a place's name, its key underlined."""
    style = "bold $block-cursor-foreground on $block-cursor-background" if current else "$text-muted"
    at = name.lower().index(key)
    return [(f" {name[:at]}", style), (name[at], f"underline {style}"), (f"{name[at + 1 :]} ", style)]


class Notice(Static):
    """A text in place of the content: loading, empty, or an error with its remedy."""

    _shown = ("", False)

    def show(self, text: str, error: bool = False) -> None:
        """Show a text; an empty one hides the notice."""
        if (text, error) == self._shown:
            return  # an update draws the whole screen anew
        self._shown = text, error
        self.update(Text("\n".join(printable(line) for line in shorten(text).splitlines())))
        self.set_class(bool(text), "-shown")
        self.set_class(error, "-error")


class Page(Screen[None]):
    """A screen of the application.

    A subclass yields its widgets from `body`, sets `command`, and reads its content in `load`, which runs when the
    screen is shown and whenever the database has changed; `fetch` shows errors in the notice of the screen.
    """

    PLACE: ClassVar[str] = ""
    """Name of its mode."""
    HELP: ClassVar[str] = ""
    """The help text: purpose and terms of the screen."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "back", "back", show=False, tooltip="go back"),
        Binding("question_mark,f1", "app.keys", "help", tooltip="help: purpose and keys of this screen"),
        Binding("y", "copy_command", "copy", show=False, tooltip="copy the command line at the top"),
    ]
    live: bool = False
    """Whether the content changes with time, as a running run does."""
    fault: FraexpError | None = None
    """The error that was shown last."""
    _reading = _once_more = _ready = False
    _began: float | None = None  # when loading began
    command: reactive[str] = reactive("fraexp tui", repaint=False)
    heading: reactive[str] = reactive("", repaint=False)

    app: "FraexpApp"

    def compose(self) -> ComposeResult:
        """Put the content between header and footer."""
        yield PageHeader()
        yield Notice()
        yield from self.body()
        yield Footer(show_command_palette=False)

    def body(self) -> ComposeResult:
        """Yield the screen's own widgets."""
        yield from ()

    async def load(self) -> None:
        """Read the content."""

    def on_mount(self) -> None:
        """Show the header at once; the content is loaded when the screen resumes, which is next."""
        self.show_header()

    def on_screen_resume(self) -> None:
        """Load the content, or load it again."""
        self.show_header()
        self.reload()

    def on_database_changed(self, event: DatabaseChanged) -> None:
        """Follow the database; a subclass overrides `follow`, as Textual calls the handlers of all base classes."""
        self.follow(event.data)

    def follow(self, changed: bool) -> None:
        """Load again; if the database has not `changed`, only if the content is live."""
        if changed or self.live:
            self.reload()

    @property
    def ready(self) -> bool:
        """Whether keys can be delivered: the content has been loaded once, or takes too long, and no dialog is due."""
        busy = {of.group for of in self.workers if not of.is_finished and of.node.screen is self}
        if not self._ready and self._began is not None:
            self._ready = busy.isdisjoint(READING_GROUPS) or time.monotonic() > self._began + LOAD_TIMEOUT_S
        return self._ready and ACTION_GROUP not in busy

    def reload(self) -> None:
        """Start loading; a load in progress is completed, and repeated."""
        self._began = self._began or time.monotonic()
        if self._reading:
            self._once_more = True
            return
        self._reading = True
        self.run_worker(self._read_all(), group=LOAD_GROUP)

    async def _read_all(self) -> None:
        self._once_more = True
        try:
            while self._once_more:
                self._once_more = False
                await self.load()
        finally:
            self._reading = False

    async def fetch(self, asked: Awaitable[Answer], on_error: Callable[[str], None] | None = None) -> Answer | None:
        """Return the answer; None after an error, which is shown in the notice, or passed to `on_error`."""
        try:
            return await self.wait_for(asked)
        except FraexpError as error:
            self.fault = error
            (on_error or self.show_error)(str(error))
            return None

    async def read(
        self, question: "Callable[[Store], Answer]", on_error: Callable[[str], None] | None = None
    ) -> Answer | None:
        """Return what the database answers; see `fetch`."""
        return await self.fetch(self.app.backend.read(question), on_error)

    async def compute(
        self, task: "Callable[[WorkspaceService], Answer]", on_error: Callable[[str], None] | None = None
    ) -> Answer | None:
        """Return the result of a task of the workspace; see `fetch`."""
        return await self.fetch(self.app.backend.work(task), on_error)

    async def wait_for(self, asked: Awaitable[Answer]) -> Answer:
        """Return the answer or raise its error; the caller is cancelled if the screen has been removed meanwhile."""
        try:
            return await asked
        finally:
            if not (self.is_running and self.is_attached and self.display):  # it ends, or is being removed
                raise asyncio.CancelledError  # there is nothing to show it in

    async def wait_for_paint(self) -> None:
        """Return when what has changed is drawn."""
        painted = asyncio.Event()
        self.call_after_refresh(painted.set)
        await self.wait_for(painted.wait())

    def show_error(self, text: str) -> None:
        """Show an error in place of the content; notifications then appear at the bottom, not over it."""
        self.query_one(Notice).show(text, error=True)
        self.add_class("-failed")

    def show_notice(self, text: str = "") -> None:
        """Show a text in place of the content; an empty one hides the notice."""
        self.query_one(Notice).show(text)
        self.remove_class("-failed")

    def show_header(self) -> None:
        """Show place, title, marks and command."""
        for header in self.query(PageHeader):  # none before it is mounted, and while the screen is removed
            measuring = self.app.measuring_text
            header.show(self.PLACE, self.heading, len(self.app.marks), self.command, measuring)

    def watch_command(self) -> None:
        """Show the new command."""
        self.show_header()

    def watch_heading(self) -> None:
        """Show the new title."""
        self.show_header()

    def action_back(self) -> None:
        """Close the screen, unless it is the first of its place."""
        if len(self.app.screen_stack) > 1:
            self.app.pop_screen()

    def action_copy_command(self) -> None:
        """Copy the equivalent command line."""
        self.app.copy_to_clipboard(self.command)
        self.app.notify(self.command, title="copied, if the terminal allows it", timeout=3)
