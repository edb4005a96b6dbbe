"""The application: its screens, the queue of keys, those that work everywhere, and the polling of the database."""

import asyncio
import gc
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rich.text import Text
from textual import events, work
from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.css.stylesheet import Stylesheet
from textual.message import Message
from textual.notifications import SeverityLevel
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Input

from fraexp.data.texts import printable
from fraexp.errors import FraexpError, did_you_mean
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import PLACES, DatabaseChanged, Page, shorten
from fraexp.tui.services.plugin_watch import PluginsChanged, PluginWatch, reload_plugins
from fraexp.tui.services.themes import DARK, LIGHT

if TYPE_CHECKING:
    from fraexp.tui.services.database_access import Backend
    from fraexp.tui.services.live_measurement import LiveMeasurement
    from fraexp.tui.widgets.field_list import FormDraft


class Selection:
    """Keys of marked sweeps."""

    def __init__(self) -> None:
        self._keys: dict[str, None] = {}
        self.origin: tuple[str, ...] = ()
        """Arguments of a command line that name the same sweeps, such as a run; empty if only their keys do."""

    def __contains__(self, key: object) -> bool:
        return key in self._keys

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def toggle(self, key: str) -> bool:
        """Mark or unmark a sweep; return whether it is marked now."""
        self.origin = ()
        if key in self._keys:
            del self._keys[key]
            return False
        self._keys[key] = None
        return True

    def add(self, keys: Sequence[str], origin: tuple[str, ...] = ()) -> None:
        """Mark sweeps, which `origin` names in a command line."""
        self._keys |= dict.fromkeys(keys)
        self.origin = origin if list(self._keys) == list(keys) else ()

    def remove(self, keys: Iterable[str]) -> None:
        """Unmark sweeps."""
        for key in keys:
            if key in self._keys:
                self.toggle(key)

    def clear(self) -> None:
        """Unmark all sweeps."""
        self.origin = ()
        self._keys.clear()


SWITCH_INTERVAL_S = 0.5e-3
"""Seconds after which Python switches threads: its own 5 ms would delay each of the many steps of drawing a screen."""
POLL_INTERVAL_S = 0.5
"""Seconds between two polls of the database version."""
POLLS_PER_REFRESH = 4
"""Polls after which a screen refreshes even without a change: a run whose process dies changes nothing."""
PLUGIN_POLL_INTERVAL_S = 2.0
"""Seconds between two polls of the plugins folder."""
MEASUREMENT_POLL_INTERVAL_S = 0.2
"""Seconds between two looks at a measurement that is running."""
STOP_TIMEOUT_S = 10.0
"""Seconds that quitting waits for the machine to come to rest."""
TERMINAL_POLL_INTERVAL_S, HANGUP_EXIT_CODE = 1.0, 129
"""Seconds between two polls of the terminal, and the exit code of a program that was ended by a hangup."""
RELEASE_INTERVAL_S = 0.02
"""Seconds between two attempts to deliver the next key."""
MAX_WAIT_S = 0.25
"""Maximum seconds that a key waits for the effect of the previous one, on a screen that is always busy."""
IMMEDIATE_KEYS = ("ctrl+c", "ctrl+q")
"""Keys that are never queued."""
THEME_VARIABLE = "FRAEXP_TUI_THEME"
"""Environment variable with the name of a theme."""
SCREENS = {
    "studies": ("fraexp.tui.screens.studies_page", "StudiesPage"),
    "runs": ("fraexp.tui.screens.runs_page", "RunsPage"),
    "sweeps": ("fraexp.tui.screens.sweeps_page", "SweepsPage"),
    "compare": ("fraexp.tui.screens.compare_page", "ComparePage"),
    "plugins": ("fraexp.tui.screens.plugins_page", "PluginsPage"),
}
"""Module and class of each place, imported when it is first shown."""


def _screen_factory(place: str) -> Callable[[], Screen[Any]]:
    module, name = SCREENS[place]
    return lambda: getattr(import_module(module), name)()  # noqa: PLW0108 - imported when it is first shown


class OpeningPage(Page):
    """The first frame, shown at once until the studies are loaded."""

    PLACE: ClassVar[str] = "studies"
    ready = False  # keys are meant for the next screen

    async def load(self) -> None:
        """Show what is being loaded."""
        self.show_notice("loading the studies ...")


class KeptStylesheet(Stylesheet):
    """A stylesheet that is parsed again only for other colours: to enter a place parses all of it twice otherwise."""

    def set_variables(self, variables: dict[str, str]) -> None:
        if variables != self._variables:
            super().set_variables(variables)

    def reparse(self) -> None:
        self.parse()


class KeyQueue:
    """Delivers keys in order, and not before the screen has loaded.

    A letter goes straight to the focused input; a key with a binding passes through its ancestors first. A letter that
    followed it at once would overtake it.
    """

    def __init__(self, app: App[None]) -> None:
        self._app = app
        self._held: deque[events.Key] = deque()
        self._timer: Timer | None = None
        self._before: events.Key | None = None
        self._since = 0.0

    def holds(self, key: events.Key, deliver: Callable[[events.Key], Awaitable[None]]) -> bool:
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

    async def _release(self, deliver: Callable[[events.Key], Awaitable[None]]) -> None:
        while self._held and self._is_ready() and self._is_handled():
            key = self._held.popleft()
            self._note_delivered(key)
            await deliver(key)
        if not self._held and self._timer:
            self._timer.stop()
            self._timer = None

    def _note_delivered(self, key: events.Key) -> None:
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


class FraexpApp(App[None]):
    """fraexp in a terminal."""

    TITLE = "fraexp"
    CSS_PATH = "look.tcss"
    MODES: ClassVar[dict[str, str | Callable[[], Screen[Any]]]] = {place: _screen_factory(place) for place in SCREENS}
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (110, "-wide")]  # noqa: RUF012 - as Textual declares it
    VERTICAL_BREAKPOINTS = [(0, "-low"), (32, "-high")]  # noqa: RUF012
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "place('studies')", "Studies", show=False, tooltip="the studies that can be run"),
        Binding("r", "place('runs')", "Runs", show=False, tooltip="finished and running runs"),
        Binding("w", "place('sweeps')", "Sweeps", show=False, tooltip="all sweeps in the database"),
        Binding("c", "place('compare')", "Compare", show=False, tooltip="compare the marked sweeps"),
        Binding("p", "place('plugins')", "Plugins", show=False, tooltip="components and their state"),
        Binding("colon", "command_palette", "commands", show=False, tooltip="search for a command"),
        Binding("q", "quit", "quit", show=False, tooltip="quit; runs continue, a measurement is stopped"),
    ]

    def __init__(self, folder: str | Path, database: str | None = None, tracing: bool = False) -> None:
        """Open a workspace; `tracing` shows the traceback of an internal error. FraexpError for an unknown theme."""
        super().__init__()
        self.stylesheet = KeptStylesheet(variables=self.get_css_variables())
        self._place = (folder, database)
        self.marks = Selection()
        self.measurement: LiveMeasurement | None = None
        """The measurement that is running, or the last one."""
        self._measuring_text = ""
        self.drafts: dict[str, FormDraft] = {}
        """Unlaunched changes in the forms of studies, by study."""
        self._plugins = PluginWatch(Path(folder) / "plugins")
        self._tracing = tracing
        self._version: object = "not looked yet"
        self._looks = 0
        self._key_queue = KeyQueue(self)
        self._choose_theme()

    @cached_property
    def backend(self) -> "Backend":
        """The workspace and its database; FraexpError if there is no such folder."""
        from fraexp.tui.services.database_access import (
            Backend,  # it imports all that computes and stores: the first frame must not wait for it
        )

        backend = Backend(*self._place)
        gc.freeze()  # a full collection that visits all imported objects takes tenths of a second, for which keys wait
        return backend

    def _choose_theme(self) -> None:
        """Apply the theme that the user has named in the environment."""
        for theme in (DARK, LIGHT):
            self.register_theme(theme)
        chosen = os.environ.get(THEME_VARIABLE) or DARK.name
        if chosen not in self.available_themes:
            known = did_you_mean(chosen, self.available_themes)
            raise FraexpError(f"{THEME_VARIABLE}: unknown theme '{printable(chosen)}'{known}")
        self.theme = chosen

    def get_default_screen(self) -> Screen[Any]:
        """Return the first frame."""
        return OpeningPage()

    def on_mount(self) -> None:
        """Show the first frame, then load."""
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        if not self.is_headless:
            end_with_terminal()
        self.call_after_refresh(self._begin)

    def _begin(self) -> None:
        """Show the studies, and start polling."""
        self.switch_mode("studies")
        self.set_interval(POLL_INTERVAL_S, self.poll_database)
        self.set_interval(PLUGIN_POLL_INTERVAL_S, self.poll_plugins)
        self.set_interval(MEASUREMENT_POLL_INTERVAL_S, self.poll_measurement)

    async def on_event(self, event: events.Event) -> None:
        """Handle an event of the terminal."""
        if isinstance(event, events.Key) and not event.is_forwarded:  # a forwarded key comes back from a screen
            key = (
                events.Key("enter", "\r") if event.key == "ctrl+j" else event
            )  # Enter before the terminal is in raw mode
            if not self._key_queue.holds(key, super().on_event):
                await super().on_event(key)
            return
        await super().on_event(event)

    async def poll_database(self) -> None:
        """Notify the screen if the database has changed, or at every few polls."""
        try:
            version: object = (await self.backend.read(lambda store: store.version()), self.backend.opened)
        except FraexpError:
            version = None  # missing: the screen reports it when it reads
        self._looks += 1
        changed, self._version = version != self._version, version
        if changed or self._looks % POLLS_PER_REFRESH == 0:
            self._post_to_page(DatabaseChanged(changed))

    def _post_to_page(self, message: Message) -> None:
        """Post a message to the current screen; there is none during a switch, and at the end."""
        if self.screen_stack and isinstance(self.screen_stack[-1], Page):
            self.screen_stack[-1].post_message(message)

    async def poll_plugins(self) -> None:
        """Reload plugins if their files have changed, and report the result."""
        changes = self._plugins.changes()
        if not changes:
            return
        lines, is_broken = await self.backend.work(lambda workspace: reload_plugins(workspace, changes))
        text = "\n".join(map(shorten, lines))
        self.notify(text, title="plugins", severity="warning" if is_broken else "information")
        self._post_to_page(PluginsChanged())

    @property
    def measuring_text(self) -> str:
        """What every screen says of a measurement that is running."""
        live = self.measurement
        return f"▶ {live.state} {live.count_text}".rstrip() if live and live.is_moving else ""

    def open_measurement(self, study: str, overrides: Sequence[str]) -> None:
        """Show the measurement that is running, or plan that of a study."""
        from fraexp.tui.screens.measurement_page import MeasurementPage, MeasurementPlanPage

        live = self.measurement
        if live is None or not live.is_moving:
            self.push_screen(MeasurementPlanPage(study, list(overrides)))
            return
        if live.study != study:
            self.notify(f"{live.study} is being measured; x stops it", severity="warning")
        self.push_screen(MeasurementPage(live))

    async def poll_measurement(self) -> None:
        """Show on every screen that a machine moves; at the end of its measurement, run the study of the record."""
        live, text = self.measurement, self.measuring_text
        if text != self._measuring_text:
            self._measuring_text = text
            if self.screen_stack and isinstance(self.screen, Page):
                self.screen.show_header()
        if live is None or live.is_end_shown or not live.has_ended:
            return
        live.is_end_shown = True
        if live.state == "complete":
            if live.message:
                self.notify(f"{live.study}: {live.message}", severity="warning", timeout=20)
            await self._analyse(live)
        else:
            self.notify(f"{live.study}: {live.state}; {live.message}", severity="warning")

    async def _analyse(self, live: "LiveMeasurement") -> None:
        """Run the study of a record, and show the run where its measurement was being watched."""
        from fraexp.tui.screens.measurement_page import MeasurementPage
        from fraexp.tui.screens.run_page import show_run

        try:
            started = await self.backend.work(lambda workspace: workspace.launch(live.result_study))
        except FraexpError as error:
            self.notify(str(error), title="not analysed", severity="error")
            return
        if isinstance(self.screen, MeasurementPage) and self.screen.measurement is live:
            show_run(self, started)
        else:
            self.notify(f"{live.study} is measured; r shows the run that analyses it")

    @work
    async def action_quit(self) -> None:  # type: ignore[override]
        """Quit; a machine that moves is stopped first, after a question."""
        if self.measurement is None or not self.measurement.is_moving:
            self.exit()
            return
        question = f"{self.measurement.study} is being measured. Stop the machine and quit? Measured points are kept."
        if await self.push_screen_wait(ConfirmDialog(question)):
            self.measurement.stop()
            await asyncio.to_thread(self.measurement.join, STOP_TIMEOUT_S)
            self.exit()

    def action_place(self, place: str) -> None:
        """Switch to a place: to its list, as the user left it."""
        self.switch_mode(place)
        while len(self.screen_stack) > 1:  # not awaited, as the next keys are for the list
            self.pop_screen()

    def notify(
        self,
        message: str,
        *,
        title: str = "",
        severity: SeverityLevel = "information",
        timeout: float | None = None,
        markup: bool = False,
    ) -> None:
        """Show a notification for a moment, shortened if it is long."""
        text = "\n".join(map(printable, shorten(message).splitlines()))
        super().notify(text, title=title, severity=severity, timeout=timeout, markup=markup)

    def on_notify(self) -> None:
        """Remove the previous notification: two of them would cover the plots."""
        self.clear_notifications()

    def action_keys(self) -> None:
        """Show the help of the screen and its keys."""
        from fraexp.tui.screens.help_screen import HelpPage

        if isinstance(self.screen, Page):
            self.push_screen(HelpPage(self.screen))

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Return the entries of the command palette: places, keys of the screen, theme and quit."""
        for place, name in PLACES.items():
            yield SystemCommand(name, f"go to {name}", lambda place=place: self.action_place(place))
        for binding in screen.active_bindings.values():
            key = binding.binding
            ours = key.tooltip and key.description  # those of Textual have no description or no tooltip
            if binding.node is screen and ours and key.action not in ("back", "app.keys"):
                text = f"{key.tooltip or key.description} (key {self.get_key_display(key)})"
                yield SystemCommand(key.description, text, lambda action=key.action: self._act(action))
        yield SystemCommand("Theme", "choose colours", self.action_change_theme)
        yield SystemCommand("Quit", "quit; runs continue, a measurement is stopped", self.action_quit)

    def _act(self, action: str) -> None:
        self.call_later(self.screen.run_action, action)

    def _fatal_error(self) -> None:
        """End with one line after an unexpected error; runs continue."""
        # private in Textual, which has no public place for unhandled errors; tests/tui/test_toolkit.py watches it
        if self._tracing or self.is_headless:
            super()._fatal_error()
            return
        what = f"{type(self._exception).__name__}: {printable(str(self._exception))}"
        advice = "runs continue; fraexp tui --debug shows the traceback"
        self.panic(Text(f"fraexp: internal error: {what}; {advice}"))

    def on_unmount(self) -> None:
        """Stop a machine that moves, and close the database."""
        if self.measurement is not None:
            self.measurement.stop()
        self.backend.close()


def end_with_terminal() -> None:
    """End the program when its terminal is gone and no signal has ended it.

    A thread does it, as the others block on the terminal. Nothing is lost: runs are separate processes, and incomplete
    transactions are rolled back.
    """
    stream = sys.__stdin__
    if stream is None or not stream.isatty():
        return  # a session in a browser, which the server ends
    file, pause = stream.fileno(), threading.Event()

    def watch() -> None:
        while not pause.wait(TERMINAL_POLL_INTERVAL_S):
            if not os.isatty(file):
                os._exit(HANGUP_EXIT_CODE)

    threading.Thread(target=watch, name="terminal", daemon=True).start()
