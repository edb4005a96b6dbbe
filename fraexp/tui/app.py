"""The application: its places, the keys that work everywhere, and the look at the database."""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rich.text import Text
from textual import events
from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.filter import LineFilter
from textual.message import Message
from textual.notifications import SeverityLevel
from textual.screen import Screen

from fraexp.errors import FraexpError, did_you_mean
from fraexp.figures.elements.labels import printable
from fraexp.tui.key_queue import Ahead
from fraexp.tui.page import PLACES, Changed, Page, shortened
from fraexp.tui.services import user_settings
from fraexp.tui.services.ascii_filter import AsciiOnly
from fraexp.tui.services.gc_policy import Collector
from fraexp.tui.services.plugin_watch import PluginsChanged, PluginsWatch, loaded_anew
from fraexp.tui.services.selection import Marks
from fraexp.tui.services.terminal_watch import end_with_terminal

if TYPE_CHECKING:
    from fraexp.tui.services.database_access import Desk
    from fraexp.tui.widgets.field_list import Written

TURN = 0.5e-3
"""Seconds after which a thread that computes lets keys have their turn: Python's own 5 ms, at each of the many small
steps in which a screen is drawn, would be felt."""
LOOK = 0.5
"""Seconds between two looks whether the database has changed."""
AGAIN = 4
"""Looks after which a screen is told even so: a run whose process dies changes nothing in the database."""
LOOK_AT_PLUGINS = 2.0
"""Seconds between two looks whether a file in the plugins folder has changed."""
TIDY = 15.0
"""Seconds between two looks whether garbage may be collected."""
SCREENS = {
    "studies": ("fraexp.tui.screens.studies_page", "StudiesPage"),
    "runs": ("fraexp.tui.screens.runs_page", "RunsPage"),
    "sweeps": ("fraexp.tui.screens.sweeps_page", "SweepsPage"),
    "compare": ("fraexp.tui.screens.compare_page", "ComparePage"),
    "plugins": ("fraexp.tui.screens.plugins_page", "PluginsPage"),
}
"""Module and class of each place, imported when it is first shown."""


def _screen(place: str) -> Callable[[], Screen[Any]]:
    module, name = SCREENS[place]
    return lambda: getattr(import_module(module), name)()  # noqa: PLW0108 - imported when it is first shown


class Opening(Page):
    """What is seen until the studies are there: whether anything is installed and at work shall be seen at once."""

    PLACE: ClassVar[str] = "studies"
    ready = False  # keys are meant for what comes

    async def load(self) -> None:
        """Tell what is waited for."""
        self.tell("reading the studies ...")


class FraexpApp(App[None]):
    """fraexp in a terminal."""

    TITLE = "fraexp"
    CSS_PATH = "look.tcss"
    MODES: ClassVar[dict[str, str | Callable[[], Screen[Any]]]] = {place: _screen(place) for place in SCREENS}
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (110, "-wide")]  # noqa: RUF012 - as Textual declares it
    VERTICAL_BREAKPOINTS = [(0, "-low"), (32, "-high")]  # noqa: RUF012
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "place('studies')", "Studies", show=False, id="studies", tooltip="what can be run"),
        Binding("r", "place('runs')", "Runs", show=False, id="runs", tooltip="what has been run, and what runs"),
        Binding("w", "place('sweeps')", "Sweeps", show=False, id="sweeps", tooltip="all sweeps in the database"),
        Binding("c", "place('compare')", "Compare", show=False, id="compare", tooltip="the marked sweeps together"),
        Binding("p", "place('plugins')", "Plugins", show=False, id="plugins", tooltip="components and their state"),
        Binding("colon", "command_palette", "commands", show=False, id="palette", tooltip="find a command by name"),
        Binding("q", "quit", "quit", show=False, id="quit", tooltip="leave; runs go on"),
    ]

    def __init__(
        self, folder: str | Path, database: str | None = None, plain: bool | None = None, tracing: bool = False
    ) -> None:
        """Open a workspace; FraexpError if the settings are wrong.

        `plain` draws with ASCII alone, `tracing` shows the traceback of an error of its own.
        """
        super().__init__()
        self.settings = user_settings.read(user_settings.place())
        self._place = (folder, database)
        self.marks = Marks()
        self.drafts: dict[str, Written] = {}
        """What is written in the forms of studies, and not launched yet, by study."""
        self._plugins = PluginsWatch(Path(folder) / "plugins")
        wished = self.settings.ascii if plain is None else plain
        self._ascii = AsciiOnly(user_settings.plain_terminal(os.environ) if wished is None else wished)
        self._tracing = tracing
        self._version: object = "not looked yet"
        self._looks = 0
        self._collector = Collector()
        self._ahead = Ahead(self)
        self._choose()

    @cached_property
    def desk(self) -> "Desk":
        """The workspace and its database; FraexpError if there is no such folder."""
        from fraexp.tui.services.database_access import (
            Desk,  # and with it all that computes and stores: what is seen first need not wait
        )

        return Desk(*self._place)

    def _choose(self) -> None:
        """Take the user's theme and keys."""
        if self.settings.theme:
            if self.settings.theme not in self.available_themes:
                known = did_you_mean(self.settings.theme, self.available_themes)
                raise FraexpError(f"{user_settings.place()}: there is no theme '{self.settings.theme}'{known}")
            self.theme = self.settings.theme
        if self.settings.keys:
            from fraexp.tui.services import (
                key_bindings,  # and with it all screens: only where somebody has keys of their own
            )

            key_bindings.check(self.settings.keys, str(user_settings.place()))
            self.set_keymap(dict(self.settings.keys))

    @property
    def plain(self) -> bool:
        """Whether all is drawn with ASCII characters."""
        return self._ascii.enabled

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return what every line goes through before it is shown."""
        return [*super().get_line_filters(), *([self._ascii] if self._ascii.enabled else [])]

    def get_default_screen(self) -> Screen[Any]:
        """Return what is seen first."""
        return Opening()

    def on_mount(self) -> None:
        """Show a first frame, then begin."""
        sys.setswitchinterval(TURN)
        if not self.is_headless:
            end_with_terminal()
        self.call_after_refresh(self._begin)

    def _begin(self) -> None:
        """Begin with the studies, and look at the database from now on."""
        self.switch_mode("studies")
        self.set_interval(LOOK, self.look)
        self.set_interval(LOOK_AT_PLUGINS, self.look_at_plugins)
        self.set_interval(TIDY, self._collector.look)

    async def on_event(self, event: events.Event) -> None:
        """Take what the terminal tells."""
        if isinstance(event, events.Key) and not event.is_forwarded:  # else it comes back from a screen
            self._collector.typed()
            key = events.Key("enter", "\r") if event.key == "ctrl+j" else event  # as Enter comes until all keys do
            if not self._ahead.takes(key, super().on_event):
                await super().on_event(key)
            return
        await super().on_event(event)

    async def look(self) -> None:
        """Tell the screen if the database has changed since the last look, or a while has passed."""
        try:
            version: object = (await self.desk.read(lambda store: store.version()), self.desk.opened)
        except FraexpError:
            version = None  # none yet, or gone: the screen will say so when it asks
        self._looks += 1
        changed, self._version = version != self._version, version
        if changed or self._looks % AGAIN == 0:
            self._tell(Changed(changed))

    def _tell(self, message: Message) -> None:
        """Tell the screen that is seen; there is none while places are changed, and when all ends."""
        if self.screen_stack and isinstance(self.screen_stack[-1], Page):
            self.screen_stack[-1].post_message(message)

    async def look_at_plugins(self) -> None:
        """Load plugins anew if their files have changed, and tell what became of them."""
        changes = self._plugins.changes()
        if not changes:
            return
        found = await self.desk.work(lambda workspace: loaded_anew(workspace, changes))
        text = "\n".join(printable(shortened(str(change))) for change in found)
        broken = any(change.reason for change in found)
        self.notify(text, title="plugins", severity="warning" if broken else "information", markup=False)
        self._tell(PluginsChanged())

    def action_place(self, place: str) -> None:
        """Go to a place: to its list, as it was left."""
        self.switch_mode(place)
        while len(self.screen_stack) > 1:  # not awaited: what is typed next is for the list
            self.pop_screen()

    def notify(
        self,
        message: str,
        *,
        title: str = "",
        severity: SeverityLevel = "information",
        timeout: float | None = None,
        markup: bool = True,
    ) -> None:
        """Tell something for a moment; of what is long the begin."""
        super().notify(shortened(message), title=title, severity=severity, timeout=timeout, markup=markup)

    def on_notify(self) -> None:
        """Take away what was told before: two messages would cover what is drawn."""
        self.clear_notifications()

    def get_key_display(self, binding: Binding) -> str:
        """Return how a key is written; the sign for Enter has nothing like it in ASCII."""
        text = super().get_key_display(binding)
        return text.replace("⏎", "Enter") if self.plain else text

    def action_keys(self) -> None:
        """Show what the screen is for, and its keys."""
        from fraexp.tui.screens.help_screen import HelpPage

        if isinstance(self.screen, Page):
            self.push_screen(HelpPage(self.screen))

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """Return what the command palette offers: the places, the screen's keys, and themes."""
        for place, name in PLACES.items():
            yield SystemCommand(name, f"go to {name}", lambda place=place: self.action_place(place))
        for binding in screen.active_bindings.values():
            key = binding.binding
            ours = key.id and key.description  # not what the toolkit has on every screen
            if binding.node is screen and ours and key.action not in ("back", "app.keys"):
                text = f"{key.tooltip or key.description} (key {self.get_key_display(key)})"
                yield SystemCommand(key.description, text, lambda action=key.action: self._act(action))
        yield SystemCommand("Theme", "choose colours", self.action_change_theme)
        yield SystemCommand("ASCII", "draw with ASCII characters alone, or with all", self.action_ascii)
        yield SystemCommand("Quit", "leave; runs go on", self.exit)

    def _act(self, action: str) -> None:
        self.call_later(self.screen.run_action, action)

    def action_ascii(self) -> None:
        """Draw with ASCII characters alone, or with all of them."""
        self._ascii.enabled = not self._ascii.enabled
        self.refresh_css(animate=False)
        self.screen.refresh_bindings()
        self.screen.refresh(layout=True)

    def _fatal_error(self) -> None:
        """End with one line after an error that nobody has foreseen; what runs goes on."""
        if self._tracing or self.is_headless:
            super()._fatal_error()
            return
        what = f"{type(self._exception).__name__}: {printable(str(self._exception))}"
        advice = "runs go on; fraexp tui --debug shows the traceback"
        self._exit_renderables.append(Text(f"fraexp: internal error: {what}; {advice}"))
        self._close_messages_no_wait()

    def on_unmount(self) -> None:
        """Leave the database."""
        self.desk.close()
