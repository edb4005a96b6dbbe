"""The launch form of a study: its values can be changed, its plan is always shown, one key starts the run."""

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

from fraexp.data.terminal_text import printable
from fraexp.errors import FraexpError, StoreError
from fraexp.execution.background import BackgroundRun
from fraexp.study.catalogue import StudyEntry
from fraexp.tui.page import Page, shorten
from fraexp.tui.services.launch_form import (
    EXECUTOR_OPTION,
    RERUN_OPTION,
    FieldGroup,
    FormField,
    build_form,
    find_concerned,
    override_texts,
)
from fraexp.tui.widgets.field_list import FieldList, FormDraft
from fraexp.views.study import plan_summary, survey_plan
from fraexp.views.words import plural

CHECK_DELAY_S = 0.3
"""Seconds without a key after which the whole study is checked."""
TYPING_DELAY_S = 0.05
"""Seconds without a key after which a value is checked: a text may arrive as a burst of keys."""


class LaunchPage(Page):
    """The launch form of a study."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = """\
The values of a study, which can be changed before the run. Its file stays unchanged.
Each line is a parameter by its path, as --set takes it; a value (in brackets) is the default,
* marks a changed value, ! an invalid one.
Write values as in a study: 12, "1 um", [12, 75]. The line at the top is the command that will run.
A grid axis is a list: the run covers all combinations of the values of all axes.
Another component name shows the parameters of that component. --executor and --rerun are options of fraexp run.
F6 measures the study with these values on its machine, if it names one: first the plan, then a question.
The run is a separate process: it continues if you quit or the connection is lost."""
    DEFAULT_CSS = """
    LaunchPage #start { height: auto; padding: 0 1; }
    LaunchPage #start Button { min-width: 12; margin: 0 2 0 0; }
    LaunchPage #plan { width: 1fr; height: auto; max-height: 6; }
    LaunchPage #plan.-error { color: $text-error; }
    LaunchPage FieldList { margin: 1 0 0 0; }
    LaunchPage #hint { height: 3; padding: 0 1; background: $panel; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f5", "launch", "launch", tooltip="launch, from any line"),
        Binding("f6", "measure", "measure", tooltip="measure with these values, from any line"),
        Binding("down,enter", "next(1)", "next", show=False, tooltip="next line"),
        Binding("up", "next(-1)", "previous", show=False, tooltip="previous line"),
        Binding("pagedown", "next(8)", "on", show=False, tooltip="eight lines down"),
        Binding("pageup", "next(-8)", "back", show=False, tooltip="eight lines up"),
        Binding("ctrl+r", "restore", "restore", tooltip="restore the value of the line; on Launch, of all lines"),
    ]
    AUTO_FOCUS = "Button"

    def __init__(self, entry: StudyEntry, written: FormDraft) -> None:
        """Show the form of a study, with the user's earlier changes."""
        super().__init__()
        self.entry = entry
        self.written = written
        written.faults.clear()  # faults are found again
        self.groups: list[FieldGroup] = []
        self._texts: dict[str, str] = {}  # values in the study file, by path
        self._timer: Timer | None = None
        self._typing: Timer | None = None
        self._error: FraexpError | None = None
        self._built_for: object = None
        self._planned_for: object = None
        self._launched = False

    def body(self) -> ComposeResult:
        """Put the plan above the form, and the meaning of a line below it."""
        with Horizontal(id="start"):
            yield Button("Launch", variant="primary", compact=True)
            yield Static("loading ...", id="plan")
        yield FieldList(self.written)
        yield Static(id="hint")

    def on_mount(self) -> None:
        """Show the study."""
        self.heading = self.entry.name
        self._show_command()

    async def load(self) -> None:
        """Build the form, then the plan, which may change with the database."""
        if not self.groups:
            await self._build([])  # the study as it is
        if self._built_for != self._overrides and not self.written.faults:
            await self._build(self._overrides)
        await self._plan()

    @property
    def _overrides(self) -> list[str]:
        return override_texts(self.written.changes)

    @property
    def _options(self) -> tuple[str | None, str | None]:
        changes = self.written.changes
        return changes.get(EXECUTOR_OPTION) or None, changes.get(RERUN_OPTION) or None

    async def _build(self, changed: list[str]) -> None:
        """Show the fields of the study with the changes; invalid changes are reported by the plan."""
        name, random = self.entry.name, self.entry.data.get("monte_carlo")
        asked = self.app.backend.work(lambda w: build_form(*w.outline(name, changed), random, w.registry))
        groups = await self.fetch(asked, lambda text: self._show_plan(text, error=True))
        if groups is None:
            return
        self._built_for = changed
        fields = {field.path: field for group in groups for field in group.fields}
        if list(fields) != [field.path for group in self.groups for field in group.fields]:
            self.groups = groups
            self._texts = self._texts or {path: field.text for path, field in fields.items()}
            self.query_one(FieldList).show(groups)

    @on(Input.Changed)
    def _handle_input(self, event: Input.Changed) -> None:
        field = self.query_one(FieldList).field
        if field is None or event.value.strip() == self.written.text(field):
            return
        text, changes = event.value.strip(), self.written.changes
        if field.chooses:  # changes for the previous component do not apply
            owner = field.path.rpartition(".")[0]
            for path in [path for path in changes if path.startswith(f"{owner}.")]:
                del changes[path]
        changes.pop(field.path, None)
        if text and text != self._texts.get(field.path, ""):
            changes[field.path] = text
        faults = self.written.faults
        faults.clear() if self._error else faults.pop(field.path, None)  # faults of the whole study are outdated
        for timer in (self._typing, self._timer):
            if timer:
                timer.stop()
        self._typing = self.set_timer(TYPING_DELAY_S, lambda: self._check_field(field))
        self._timer = self.set_timer(CHECK_DELAY_S, self._check)

    def _check_field(self, field: FormField) -> None:
        """Check the text of a field, and show fault, command and hint."""
        text = self.written.changes.get(field.path, "")
        fault = field.fault(text) if text else ""
        if fault:
            self.written.faults[field.path] = fault
        self.query_one(FieldList).redraw()
        self._show_command()
        if field is self.query_one(FieldList).field:
            self._show_hint(field)
        self._show_plan(fault or "checking ...", bool(fault))

    def _check(self) -> None:
        self.reload()

    async def _plan(self) -> None:
        """Show the plan of a launch, or why it is impossible."""
        if self._error:
            self.written.faults.clear()
        wrong = next(iter(self.written.faults.values()), "")
        if wrong:
            self._show_plan(wrong, error=True)
            return
        name, changed, (executor, rerun) = self.entry.name, self._overrides, self._options
        self._error = None
        try:
            _, (planned,) = await self.wait_for(self.app.backend.work(lambda w: w.plan(name, changed, rerun, executor)))
        except StoreError as error:  # the run itself may migrate the database
            self._show_plan(str(error), error=True)
        except FraexpError as error:
            self._show_error_at_field(error)
        except Exception as error:  # a plugin may raise anything
            self._show_error_at_field(FraexpError(f"{type(error).__name__}: {' '.join(str(error).split())}"))
        else:
            self._show_plan(plan_summary(survey_plan(name, planned)))
        self._planned_for = (changed, rerun)
        self.query_one(FieldList).redraw()

    def _show_error_at_field(self, error: FraexpError) -> None:
        """Show an error, also at the line that it names."""
        self._error = error
        self._show_plan(str(error).removeprefix(f"{self.entry.file}, "), error=True)
        lines = self.query_one(FieldList)
        field = find_concerned(str(error), lines.fields)
        if field:
            self.written.faults[field.path] = str(error)
            if lines.field is None:  # else the user is editing another line
                lines.see(field)

    def _show_plan(self, text: str, error: bool = False) -> None:
        plan = self.query_one("#plan", Static)
        plan.update(Text(printable(shorten(f"! {text}" if error else text))))
        plan.set_class(error, "-error")

    def _show_command(self) -> None:
        executor, rerun = self._options
        self.command = self.app.backend.workspace.command(self.entry.name, self._overrides, executor, rerun)

    @on(FieldList.Chosen)
    def _show_chosen_hint(self, event: FieldList.Chosen) -> None:
        self._show_hint(event.field)

    def on_descendant_focus(self) -> None:
        """Show the hint of the button."""
        if isinstance(self.focused, Button):
            self.query_one(FieldList).leave()
            self._show_hint(None)

    def _show_hint(self, field: FormField | None) -> None:
        if field is None:
            text = Text("Enter launches the run; arrow down edits values, F5 launches from there.")
        else:
            fault = self.written.faults.get(field.path, "")
            text = Text(printable(field.path), style="bold")
            text.append(f"  {printable(field.hint)}", style="not bold")
            text.append(f"\n! {printable(shorten(fault))}" if fault else "", style="not bold")
        self.query_one("#hint", Static).update(text)

    def action_next(self, lines: int) -> None:
        """Move by lines; the button is before the first line."""
        form_ = self.query_one(FieldList)
        fields = form_.fields
        if not fields:
            return  # the study is invalid
        at = lines + (fields.index(form_.field) if form_.field in fields else -1)
        if at < 0:
            self.query_one(Button).focus()
        else:
            form_.choose(fields[min(at, len(fields) - 1)])

    def action_restore(self) -> None:
        """Restore the value of the line; on the button, of all lines."""
        form_ = self.query_one(FieldList)
        if form_.field is not None:
            form_.query_one(Input).value = self._texts.get(form_.field.path, "")
        elif self.written.changes:
            self.written.changes.clear()
            self.written.faults.clear()
            self._show_command()
            self.reload()

    def action_back(self) -> None:
        """Close the form; changes are kept for the next time."""
        if self.written.changes:
            changed = plural(len(self.written.changes), "changed line")
            self.app.notify(f"{changed} kept until you quit; ^r on Launch restores all")
        super().action_back()

    @on(Button.Pressed)
    async def _launch_pressed(self) -> None:
        await self.action_launch()

    async def action_launch(self) -> None:
        """Start the run; keys wait until its screen is shown, as they are meant for it."""
        from fraexp.tui.screens.run_page import show_run

        if self._launched:
            return  # pressed twice
        with suppress(WorkerCancelled):
            started = await self.run_worker(self._launch(), group="launch").wait()
            self._launched = started is not None
            if self._launched:
                self.app.drafts.pop(self.entry.name, None)
            if started is not None and self.is_current:
                self.app.pop_screen()
                await show_run(self.app, started).wait()
            elif started is not None:  # an earlier key has switched to another screen
                self.app.notify(f"{self.entry.name} launched; r shows the runs")

    def action_measure(self) -> None:
        """Plan the measurement of the study with these values, or show the one that is running."""
        fault = next(iter(self.written.faults.values()), "")
        if fault:
            self.app.notify(fault, title="not planned", severity="error")
        else:
            self.app.open_measurement(self.entry.name, self._overrides)

    async def _launch(self) -> BackgroundRun | None:
        """Start the run, unless a value is invalid, which is reported."""
        for timer in (self._typing, self._timer):
            if timer:
                timer.stop()
        if self._planned_for != (self._overrides, self._options[1]):
            await self._plan()
        wrong = next(iter(self.written.faults.values()), "") or self._error
        if wrong:
            self.app.notify(printable(str(wrong)), title="not launched", severity="error")
            return None
        name, changed, options = self.entry.name, self._overrides, self._options
        return await self.fetch(self.app.backend.work(lambda w: w.launch(name, changed, *options)))
