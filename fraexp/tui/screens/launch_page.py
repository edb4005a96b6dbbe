"""Launching a study: what it says can be changed, what running it would do is always told, one key starts it."""

from contextlib import suppress
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.timer import Timer
from textual.widgets import Button, Input, Static
from textual.worker import WorkerCancelled

from fraexp.errors import FraexpError, StoreError
from fraexp.execution.background import BackgroundRun
from fraexp.figures.elements.labels import printable
from fraexp.study.catalogue import StudyEntry
from fraexp.tui.page import Page, shortened
from fraexp.tui.services.launch_form import EXECUTOR, RERUN, FieldGroup, FormField, concerned, form, overrides
from fraexp.tui.widgets.field_list import FieldList, Written
from fraexp.views.study import surveyed_plan, would_do
from fraexp.views.words import plural

PAUSE = 0.3
"""Seconds without a key after which the whole study is checked."""
SOON = 0.05
"""Seconds after a key in which others may follow, until what is typed is checked: text may come all at once."""


class LaunchPage(Page):
    """A study's form."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = """\
What a study says, to be changed before it is launched. Nothing here changes its file.
Each line is a parameter by its path, as --set takes it; (in brackets) is what holds where nothing is written,
* is changed, ! is wrong.
A value is written as in a study: 12, "1 um", [12, 75]. The line at the top is what will be run.
An axis of the grid is a list: all its values are run, with all those of the other axes.
Another name of a component brings its parameters. --executor and --rerun are those of fraexp run.
The run is a process of its own: it goes on when this is closed, or when the line to it is lost."""
    DEFAULT_CSS = """
    LaunchPage #start { height: auto; padding: 0 1; }
    LaunchPage #start Button { min-width: 12; margin: 0 2 0 0; }
    LaunchPage #plan { width: 1fr; height: auto; max-height: 6; }
    LaunchPage #plan.-error { color: $text-error; }
    LaunchPage FieldList { margin: 1 0 0 0; }
    LaunchPage #hint { height: 3; padding: 0 1; background: $panel; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f5", "launch", "launch", id="launch.start", tooltip="launch, from any line"),
        Binding("down,enter", "next(1)", "next", show=False, id="launch.next", tooltip="next line"),
        Binding("up", "next(-1)", "line before", show=False, id="launch.before", tooltip="line before"),
        Binding("pagedown", "next(8)", "on", show=False, id="launch.on", tooltip="eight lines on"),
        Binding("pageup", "next(-8)", "back", show=False, id="launch.back", tooltip="eight lines back"),
        Binding(
            "ctrl+r",
            "restore",
            "as it was",
            id="launch.restore",
            tooltip="give a line its first text again; on Launch, all lines",
        ),
    ]
    AUTO_FOCUS = "Button"

    def __init__(self, entry: StudyEntry, written: Written) -> None:
        """Show a study's form, with what was written in it before."""
        super().__init__()
        self.entry = entry
        self.written = written
        written.faults.clear()  # what was wrong is found again
        self.groups: list[FieldGroup] = []
        self._texts: dict[str, str] = {}  # what the study itself has, by path
        self._timer: Timer | None = None
        self._typing: Timer | None = None
        self._error: FraexpError | None = None
        self._built_for: object = None
        self._planned_for: object = None
        self._launched = False

    def body(self) -> ComposeResult:
        """Put what would be done above the form, and what a line means below it."""
        with Horizontal(id="start"):
            yield Button("Launch", variant="primary", compact=True)
            yield Static("reading ...", id="plan")
        yield FieldList(self.written)
        yield Static(id="hint")

    def on_mount(self) -> None:
        """Show the study."""
        super().on_mount()
        self.heading = self.entry.name
        self._show_command()

    async def load(self) -> None:
        """Make the form, then look what launching would do, also when the database has changed since."""
        if not self.groups:
            await self._build([])  # what the study itself says
        if self._built_for != self._overrides and not self.written.faults:
            await self._build(self._overrides)
        await self._plan()

    @property
    def _overrides(self) -> list[str]:
        return overrides(self.written.changes)

    @property
    def _options(self) -> tuple[str | None, str | None]:
        changes = self.written.changes
        return changes.get(EXECUTOR) or None, changes.get(RERUN) or None

    async def _build(self, changed: list[str]) -> None:
        """Show the fields of the study with what is changed; a change that does not fit is told by the plan."""
        name, random = self.entry.name, self.entry.data.get("random")
        asked = self.app.desk.work(lambda w: form(*w.outline(name, changed), random, w.registry))
        groups = await self.fetch(asked, lambda text: self._tell(text, error=True))
        if groups is None:
            return
        self._built_for = changed
        fields = {field.path: field for group in groups for field in group.fields}
        if list(fields) != [field.path for group in self.groups for field in group.fields]:
            self.groups = groups
            self._texts = self._texts or {path: field.text for path, field in fields.items()}
            self.query_one(FieldList).show(groups)

    @on(Input.Changed)
    def _typed(self, event: Input.Changed) -> None:
        field = self.query_one(FieldList).field
        if field is None or event.value.strip() == self.written.text(field):
            return
        text, changes = event.value.strip(), self.written.changes
        if field.chooses:  # what was written for another component is not for this one
            owner = field.path.rpartition(".")[0]
            for path in [path for path in changes if path.startswith(f"{owner}.")]:
                del changes[path]
        changes.pop(field.path, None)
        if text and text != self._texts.get(field.path, ""):
            changes[field.path] = text
        faults = self.written.faults
        faults.clear() if self._error else faults.pop(field.path, None)  # what the whole study said of it is old
        for timer in (self._typing, self._timer):
            if timer:
                timer.stop()
        self._typing = self.set_timer(SOON, lambda: self._look_at(field))
        self._timer = self.set_timer(PAUSE, self._check)

    def _look_at(self, field: FormField) -> None:
        """Tell what is wrong with what stands in a field, and show what comes of it."""
        text = self.written.changes.get(field.path, "")
        fault = field.fault(text) if text else ""
        if fault:
            self.written.faults[field.path] = fault
        self.query_one(FieldList).redraw()
        self._show_command()
        if field is self.query_one(FieldList).field:
            self._show_hint(field)
        self._tell(fault or "checking ...", bool(fault))

    def _check(self) -> None:
        self.reload()

    async def _plan(self) -> None:
        """Tell what launching would do, or why it cannot be done."""
        if self._error:
            self.written.faults.clear()
        wrong = next(iter(self.written.faults.values()), "")
        if wrong:
            self._tell(wrong, error=True)
            return
        name, changed, (executor, rerun) = self.entry.name, self._overrides, self._options
        self._error = None
        try:
            _, (planned,) = await self.here(self.app.desk.work(lambda w: w.plan(name, changed, rerun, executor)))
        except StoreError as error:  # the run may well bring the database up to date
            self._tell(str(error), error=True)
        except FraexpError as error:
            self._blame(error)
        except Exception as error:  # a stranger's plugin may raise anything
            self._blame(FraexpError(f"{type(error).__name__}: {' '.join(str(error).split())}"))
        else:
            self._tell(would_do(surveyed_plan(name, planned)))
        self._planned_for = (changed, rerun)
        self.query_one(FieldList).redraw()

    def _blame(self, error: FraexpError) -> None:
        """Tell an error, also at the line that it names."""
        self._error = error
        self._tell(str(error).removeprefix(f"{self.entry.file}, "), error=True)
        lines = self.query_one(FieldList)
        field = concerned(str(error), lines.fields)
        if field:
            self.written.faults[field.path] = str(error)
            if lines.field is None:  # else one writes elsewhere
                lines.see(field)

    def _tell(self, text: str, error: bool = False) -> None:
        plan = self.query_one("#plan", Static)
        plan.update(Text(printable(shortened(f"! {text}" if error else text))))
        plan.set_class(error, "-error")

    def _show_command(self) -> None:
        executor, rerun = self._options
        self.command = self.app.desk.workspace.command(self.entry.name, self._overrides, executor, rerun)

    @on(FieldList.Chosen)
    def _chosen(self, event: FieldList.Chosen) -> None:
        self._show_hint(event.field)

    def on_descendant_focus(self) -> None:
        """Tell what Enter does where the button is."""
        if isinstance(self.focused, Button):
            self.query_one(FieldList).leave()
            self._show_hint(None)

    def _show_hint(self, field: FormField | None) -> None:
        if field is None:
            text = Text("Enter launches; arrow down leads to what can be changed, F5 launches from there.")
        else:
            fault = self.written.faults.get(field.path, "")
            text = Text(printable(field.path), style="bold")
            text.append(f"  {printable(field.hint)}", style="not bold")
            text.append(f"\n! {printable(shortened(fault))}" if fault else "", style="not bold")
        self.query_one("#hint", Static).update(text)

    def action_next(self, lines: int) -> None:
        """Go some lines on; before the first one is the button."""
        form_ = self.query_one(FieldList)
        fields = form_.fields
        if not fields:
            return  # the study cannot be read
        at = lines + (fields.index(form_.field) if form_.field in fields else -1)
        if at < 0:
            self.query_one(Button).focus()
        else:
            form_.choose(fields[min(at, len(fields) - 1)])

    def action_restore(self) -> None:
        """Give the line its first text again; from the button, all lines."""
        form_ = self.query_one(FieldList)
        if form_.field is not None:
            form_.query_one(Input).value = self._texts.get(form_.field.path, "")
        elif self.written.changes:
            self.written.changes.clear()
            self.written.faults.clear()
            self._show_command()
            self.reload()

    def action_back(self) -> None:
        """Leave; what is written stays for the next time."""
        if self.written.changes:
            changed = plural(len(self.written.changes), "changed line")
            self.app.notify(f"{changed} kept until fraexp tui is left; ^r on Launch restores all", markup=False)
        super().action_back()

    @on(Button.Pressed)
    async def _pressed(self) -> None:
        await self.action_launch()

    async def action_launch(self) -> None:
        """Start the run; keys wait until it is shown, as they are meant for it."""
        from fraexp.tui.screens.run_page import show_run

        if self._launched:
            return  # it was pressed twice
        with suppress(WorkerCancelled):
            started = await self.run_worker(self._launch(), group="launch").wait()
            self._launched = started is not None
            if self._launched:
                self.app.drafts.pop(self.entry.name, None)
            if started is not None and self.is_current:
                self.app.pop_screen()
                await show_run(self.app, started).wait()
            elif started is not None:  # a key that was typed before has led elsewhere
                self.app.notify(f"{self.entry.name} is launched; r shows the runs", markup=False)

    async def _launch(self) -> BackgroundRun | None:
        """Start the run, unless something is wrong, which is told."""
        for timer in (self._typing, self._timer):
            if timer:
                timer.stop()
        if self._planned_for != (self._overrides, self._options[1]):
            await self._plan()
        wrong = next(iter(self.written.faults.values()), "") or self._error
        if wrong:
            self.app.notify(printable(str(wrong)), title="not launched", severity="error", markup=False)
            return None
        name, changed, options = self.entry.name, self._overrides, self._options
        return await self.fetch(self.app.desk.work(lambda w: w.launch(name, changed, *options)))
