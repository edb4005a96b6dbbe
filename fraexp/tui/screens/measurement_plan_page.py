"""The plan of a measurement: what will be played and what that asks of the machine, before anything moves."""

from typing import ClassVar

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import Button, Static

from fraexp.data.terminal_text import printable
from fraexp.errors import ConsentError
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import ACTION_GROUP, Page
from fraexp.tui.screens.measurement_page import LimitGauges, MeasurementPage
from fraexp.tui.services.live_measurement import LiveMeasurement, PlanSummary
from fraexp.tui.widgets.paged_table import PointsTable
from fraexp.views.words import plural

REFRESH_INTERVAL_S = 0.05
"""Time between two looks whether the plan has come."""


class MeasurementPlanPage(Page):
    """The plan of a study's measurement."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = """\
The plan of a measurement: each point in the order in which it is played, with its peak, its time, and the motion that
is predicted for the study's machine, in the linear loop and with friction, whichever is greater.
The bars show the greatest motion beside each limit; │ is where the margin begins that measurement.margin leaves free.
Nothing has been played yet. Enter on Measure, or F5 from anywhere, asks once more, and then the machine moves.
Of an unknown axis, whose study has no excitation, it shows the limits and the stages of an autonomous measurement.
What an earlier, interrupted measurement has stored is kept and continued; F discards it.
To change amplitudes, frequencies or limits, open the study with Enter in Studies, and press F6 there."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f5", "measure(False)", "measure", tooltip="measure, after a question"),
        Binding("F", "measure(True)", "afresh", tooltip="discard what was recorded, and measure anew"),
    ]
    AUTO_FOCUS = "Button"

    def __init__(self, study: str, overrides: list[str]) -> None:
        super().__init__()
        self.study, self.overrides = study, overrides
        self.measurement: LiveMeasurement | None = None
        self._has_begun = False

    def body(self) -> ComposeResult:
        """Put the summary above motion and points."""
        with Horizontal(id="start"):
            yield Button("Measure", variant="primary", compact=True)
            yield Static("planning: the excitation is simulated ...", id="plan")
        yield LimitGauges("Greatest motion that is predicted")
        yield PointsTable()

    def on_mount(self) -> None:
        """Start the process that plans."""
        self.add_class("-none")
        live = LiveMeasurement(self.app.backend.workspace, self.study, self.overrides)
        self.measurement = live
        self.heading, self.command = f"measure {self.study}", f"{live.command} --dry-run"
        self._timer = self.set_interval(REFRESH_INTERVAL_S, self.show_plan)

    def show_plan(self) -> None:
        """Show the plan once it has come, or why there is none."""
        live = self.measurement
        if live is None or live.state == "planning":
            return
        self._timer.stop()
        if live.state != "planned":
            self.query_one("#plan", Static).update("")
            self.show_error(f"{live.message}\nNothing was played. Esc goes back.")
            return
        self.command = live.command
        self.remove_class("-none")
        self.query_one("#plan", Static).update(Text(summary_text(live.plans)))
        if live.is_autonomous:
            self.query_one(LimitGauges).border_title = "Limits, of which no motion is predicted yet"
        greatest = max(live.plans, key=lambda plan: max(of.predicted / of.limit for of in plan.motions))
        self.query_one(LimitGauges).show(greatest.motions, greatest.margin, (), ())
        labelled = len(live.plans) > 1
        heads = [*(["case"] if labelled else []), *greatest.heads]
        rows = [[*([plan.label] if labelled else []), *row] for plan in live.plans for row in plan.rows]
        self.query_one(PointsTable).show_points(heads, rows, are_numbers=not live.is_autonomous)
        self.query_one(Button).focus()

    @on(Button.Pressed)
    def _ask_to_measure(self) -> None:
        self.action_measure(False)

    @work(group=ACTION_GROUP)
    async def action_measure(self, fresh: bool) -> None:
        """Ask whether the machine may move, and measure."""
        live = self.measurement
        if live is None or live.state != "planned":
            self.app.notify("there is no plan yet" if live and live.state == "planning" else "nothing can be measured")
            return
        if not fresh and any(plan.is_other_stored for plan in live.plans):
            text = "a measurement with another machine, excitation or setting is stored; F discards it"
            self.app.notify(text, severity="warning")
            return
        try:
            for consent in live.consents:
                question = f"The study would {consent.action}. Allow it, now and later?"
                if not consent.is_given:
                    if not await self.app.push_screen_wait(ConfirmDialog(question)):
                        return
                    consent.remember()
        except ConsentError as error:
            self.app.notify(str(error), severity="error")
            return
        if await self.app.push_screen_wait(ConfirmDialog(question_text(live, fresh))) and not self._has_begun:
            self._has_begun = True
            live.begin(fresh)
            self.app.measurement = live
            self.app.pop_screen()
            self.app.push_screen(MeasurementPage(live))

    def on_unmount(self) -> None:
        """End the process, unless it measures."""
        if self.measurement is not None and not self._has_begun:
            self.measurement.discard()


def summary_text(plans: tuple[PlanSummary, ...]) -> str:
    """Return what is going to be measured, and what is stored already, in one or two lines that a terminal shows."""
    text = "; ".join(f"{plan.label}: {plan.total}" if plan.label else plan.total for plan in plans)
    first = plans[0]
    text += f" on machine '{first.machine}'"
    text = printable(text + (f", each until its band is ±{first.band:g} dB" if first.band else ""))
    text += f"\n! {printable(first.drive)}" if first.drive else ""
    kept = sum(plan.kept for plan in plans)
    if any(plan.is_other_stored for plan in plans):
        return f"{text}\n! a measurement with another machine, excitation or setting is stored: F discards it"
    return f"{text}\n{plural(kept, 'point')} of an earlier measurement kept: F discards them" if kept else text


def question_text(live: LiveMeasurement, fresh: bool) -> str:
    """Return the question before the machine moves."""
    motions = [of for plan in live.plans for of in plan.motions]
    lost = "What was recorded before is discarded. " if fresh else ""
    if live.is_autonomous:
        return f"{lost}The machine '{live.plans[0].machine}' will move, as far as its limits allow. Is it clear?"
    if not fresh and all(plan.kept == len(plan.rows) for plan in live.plans):
        return "All points are kept: nothing is played, and what was recorded is analysed. Go on?"
    nearest = max(motions, key=lambda motion: motion.predicted / motion.limit)
    share = f"{100 * nearest.predicted / nearest.limit:.0f} % of the limit of {nearest.name}"
    total = "; ".join(plan.total_afresh if fresh else plan.total for plan in live.plans)
    return f"{lost}The machine '{live.plans[0].machine}' will move: {total}, up to {share}. Is it clear?"
