"""The launch form of a study: its values can be changed, its plan is always shown, one key starts the run."""

from contextlib import suppress
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import Button, Static
from textual.worker import WorkerCancelled

from fraexp.data.texts import printable
from fraexp.errors import FraexpError, StoreError
from fraexp.execution.background import BackgroundRun
from fraexp.study.catalogue import StudyEntry
from fraexp.tui.page import shorten
from fraexp.tui.services import launch_form
from fraexp.tui.widgets.field_list import FieldList, FormDraft, FormPage
from fraexp.views.study import plan_summary, survey_plan
from fraexp.views.words import plural


class LaunchPage(FormPage):
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
    CHECK_DELAY_S = 0.3
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
        super().__init__(written)
        self.entry = entry
        self.groups: list[launch_form.FieldGroup] = []
        self._texts: dict[str, str] = {}  # values in the study file, by path
        self._error = ""
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
        await self.check()

    async def check(self) -> None:
        """Show the fields of the components that are named, and the plan."""
        named = [field for field in self.form.fields if field.chooses and field.choices]
        if self._built_for != self._overrides and all(self.written.text(of) in (*of.choices, "") for of in named):
            await self._build(self._overrides)
        await self._plan()

    @property
    def _overrides(self) -> list[str]:
        return launch_form.override_texts(self.written.changes)

    @property
    def _options(self) -> tuple[str | None, str | None]:
        changes = self.written.changes
        return changes.get(launch_form.EXECUTOR_OPTION) or None, changes.get(launch_form.RERUN_OPTION) or None

    async def _build(self, changed: list[str]) -> None:
        """Show the fields of the study with the changes; invalid changes are reported by the plan."""
        name, random = self.entry.name, self.entry.data.get("monte_carlo")
        groups = await self.compute(
            lambda workspace: launch_form.build_form(*workspace.outline(name, changed), random, workspace.registry),
            lambda error: self._show_plan(str(error), error=True),
        )
        if groups is None:
            return
        self._built_for = changed
        fields = {field.path: field for group in groups for field in group.fields}
        if list(fields) != [field.path for group in self.groups for field in group.fields]:
            self.groups = groups
            self._texts = self._texts or {path: field.text for path, field in fields.items()}
            self.form.show(groups)

    def write(self, field: launch_form.FormField, text: str) -> None:
        """Take note of a text; the values of another component do not apply."""
        changes = self.written.changes
        owner = field.path.rpartition(".")[0] if field.chooses else field.path
        for path in [path for path in changes if path == field.path or path.startswith(f"{owner}.")]:
            del changes[path]
        if text and text != self._texts.get(field.path, ""):
            changes[field.path] = text
        self._show_command()
        self._show_plan("checking ...")

    async def _plan(self) -> None:
        """Show the plan of a launch, or why it is impossible."""
        name, changed, (executor, rerun) = self.entry.name, self._overrides, self._options
        self._error, fault = "", None
        try:
            _, (planned,) = await self.wait_for(self.app.backend.work(lambda w: w.plan(name, changed, rerun, executor)))
            self._show_plan(plan_summary(survey_plan(name, planned)))
        except StoreError as error:  # the run itself may repair it
            self._show_plan(str(error), error=True)
        except Exception as error:  # a plugin may raise anything
            fault = error
            is_told = isinstance(error, FraexpError)
            self._error = str(error) if is_told else f"{type(error).__name__}: {' '.join(str(error).split())}"
            self._show_plan(self._error.removeprefix(f"{self.entry.file}, "), error=True)
        self._planned_for = (changed, rerun)
        wrong = self.mark_fault(fault)
        if wrong and self.form.field is None:  # else the user is editing another line
            self.form.see(wrong)

    def _show_plan(self, text: str, error: bool = False) -> None:
        plan = self.query_one("#plan", Static)
        plan.update(Text(printable(shorten(f"! {text}" if error else text))))
        plan.set_class(error, "-error")

    def _show_command(self) -> None:
        executor, rerun = self._options
        self.command = self.app.backend.workspace.command(self.entry.name, self._overrides, executor, rerun)

    def on_descendant_focus(self) -> None:
        """Show the hint of the button."""
        if isinstance(self.focused, Button):
            self.form.leave()
            text = "Enter launches the run; arrow down edits values, F5 launches from there."
            self.query_one("#hint", Static).update(text)

    def action_restore(self) -> None:
        """Restore the value of the line; on the button, of all lines."""
        if self.form.field is not None:
            self.form.write(self._texts.get(self.form.field.path, ""))
        elif self.written.changes:
            self.written.changes.clear()
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
        if self._error:
            self.app.notify(self._error, title="not planned", severity="error")
        else:
            self.app.open_measurement(self.entry.name, self._overrides)

    async def _launch(self) -> BackgroundRun | None:
        """Start the run, unless a value is invalid, which is reported."""
        self.workers.cancel_group(self, "check")
        if self._planned_for != (self._overrides, self._options[1]):
            await self._plan()
        if self._error:
            self.app.notify(self._error, title="not launched", severity="error")
            return None
        name, changed, options = self.entry.name, self._overrides, self._options
        return await self.compute(lambda w: w.launch(name, changed, *options))
