"""The plan of a measurement, before anything moves; and the measurement while it runs, with the key that stops it."""

import asyncio
import time
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Horizontal, Vertical
from textual.content import Content
from textual.widgets import Button, RichLog, Static

from fraexp.data.results import Outcome, Result
from fraexp.data.texts import printable
from fraexp.errors import ConsentError
from fraexp.figures.elements.grouping import ShownResult
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import ACTION_GROUP, Page
from fraexp.tui.plotting.plotted_curves import bode_picture
from fraexp.tui.services.live_measurement import (
    LabelledResponse,
    LimitedMotion,
    LiveMeasurement,
    PlanSummary,
    PlayedPoint,
)
from fraexp.tui.services.themes import state_sign
from fraexp.tui.widgets.paged_table import PointsTable
from fraexp.tui.widgets.preview_plot import PlotsWithNames
from fraexp.views.measurement_texts import band_text
from fraexp.views.run_progress import EMPTY, FULL, bar_text
from fraexp.views.words import duration_text, elapsed_text, plural, prefixed_text

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


MIN_BAR, MAX_BAR = 10, 40
"""Least and most cells of the bar of progress."""
OTHER_CELLS, OTHER_STAGE_CELLS = 62, 84
"""Cells of the other texts in its line, and those where they name a stage."""


class MeasurementState(Static):
    """A line on the progress, one on the point that is played, and one on the last point that was measured."""

    def __init__(self) -> None:
        super().__init__("starting ...")

    def show(self, live: LiveMeasurement) -> None:
        """Show the state; of a measurement that has ended, how."""
        sign, colour = state_sign(live.state)
        last = f"last  {live.last_point}" if live.last_point else ""
        text = Content.assemble(
            (f"{sign} {live.state}", f"bold ${colour}"),
            f"  {self._progress_text(live)}\n{printable(self._point_text(live))}\n{printable(last)}",
        )
        self.set_class(live.has_ended, "-ended")  # a reason may be long
        self.update(text, layout=live.has_ended)

    def _progress_text(self, live: LiveMeasurement) -> str:
        if not live.total and not live.stage:
            doing = live.notices[-1] if live.notices else "connecting to the machine ..."
            return printable(doing) if live.state == "measuring" else ""
        others = OTHER_STAGE_CELLS if live.stage else OTHER_CELLS
        width = min(max(self.screen.size.width - others, MIN_BAR), MAX_BAR)
        played = live.played.seconds if live.played else 0.0
        left = max(live.seconds_left - played, 0.0)
        name = f"{live.plan.label}: " if live.plan and live.plan.label else ""
        time_left = f", about {duration_text(left)} left" if live.state == "measuring" and left else ""
        points = f"{live.done} of {plural(live.total, 'point')}{time_left}" if live.total else ""
        texts = [live.stage, f"{name}{points}"]
        return f"{bar_text(live.done_fraction, width)} {': '.join(filter(None, texts))}"

    def _point_text(self, live: LiveMeasurement) -> str:
        """Return what is played now, or why nothing is played any more."""
        if live.has_ended:
            advice = "R continues with the point that was lost" if live.state == "stopped" else "R tries again"
            return "" if live.state == "complete" else f"{live.message}; {advice}"
        if live.rest:
            return f"now   {live.rest}: {elapsed_text(time.monotonic() - live.rest_since, live.rest_seconds)}"
        if live.played is None:
            rests = "now   the axis rests between two points while what was recorded is evaluated"
            return rests if live.total else ""
        return progress_text(live.played, live.plan.band if live.plan else None)


def progress_text(progress: PlayedPoint, target: float | None) -> str:
    """Return the point that is played: frequency, amplitude, settled or not, periods, band and its target."""
    state = "settled" if progress.is_settled else "settling"
    band = "" if progress.band is None else f", {band_text(progress.band)}"
    aim = "" if target is None else f", target ±{target:g} dB"
    counted = f"{state}, {plural(progress.periods, 'period')}"
    return f"now   {progress.frequency}, {progress.peak} peak: {counted}{band}{aim}, {progress.seconds:.1f} s"


MIN_PANEL_ROWS = 9
"""Least height of a panel: with less the phase is left out, and the magnitude gets its room."""
AXIS_MARGIN = 0.02
"""Part of its length by which the frequency axis extends beyond the plan."""


class MeasuredBode(PlotsWithNames):
    """Magnitude and phase of what the estimators have found so far; a vertical line is at the point that is played."""

    def __init__(self) -> None:
        super().__init__("Response")
        self._marked: float | None = None

    def compose(self) -> ComposeResult:
        """Put a text in place of plots that are not there yet."""
        yield Static("The response appears here, point by point.", id="empty")
        yield from super().compose()

    def on_mount(self) -> None:
        """Give the panels their room."""
        self.stack.min_panel_rows = MIN_PANEL_ROWS

    @work(group="picture", exclusive=True)
    async def show(self, responses: Sequence[LabelledResponse], frequency_range: tuple[float, float]) -> None:
        """Show responses; of several units those of the first one."""
        unit = responses[0][1].unit if responses else ""
        alike = [(label, response) for label, response in responses if response.unit == unit]
        shown = [ShownResult(label, Result(Outcome.OK, response=response)) for label, response in alike]
        picture = await asyncio.to_thread(bode_picture, shown, None) if shown else None
        if not self.is_attached:
            return
        low, high = np.log10(frequency_range)
        room = AXIS_MARGIN * max(high - low, 1.0)
        self.stack.whole_x = float(low - room), float(high + room)
        self.set_class(picture is not None, "-drawn")
        self.show_picture(picture, {place: label for place, (label, _) in enumerate(alike)})
        self.mark(self._marked)
        others = len(responses) - len(alike)
        self.border_subtitle = printable(f"{others} in another unit: after the measurement") if others else ""

    def mark(self, frequency: float | None) -> None:
        """Put the vertical line at a frequency [Hz]."""
        self._marked = frequency
        if self.stack.view_range.cursor != frequency:
            self.stack.view_range.cursor = frequency
            self.stack.draw()


PREDICTED_SIGN, MARGIN_SIGN = "┃", "│"
"""Signs on a bar: what is predicted, and where the margin begins that predicted motion leaves free."""
MIN_GAUGE, MAX_GAUGE = 16, 60
"""Least cells of a bar beside its value: with less room it is below it; and most cells of a bar."""
OTHER_GAUGE_CELLS = 13
"""Cells of a line beside name, value and bar."""


class LimitGauges(Static):
    """A bar for each limited quantity: how much of its limit is used, what is predicted, and where the margin begins.

    No bar depends on its colour: the part of the limit stands beside it, with a sign where the margin is used.
    """

    def __init__(self, title: str) -> None:
        super().__init__(classes="panel")
        self.border_title = title
        self._shown: tuple[Any, ...] = ()

    def show(
        self, motions: Sequence[LimitedMotion], margin: float, used: Sequence[float], predicted: Sequence[float]
    ) -> None:
        """Show what is used of each limit, and what is predicted; both are demands, and may be empty."""
        wanted = (tuple(motions), margin, tuple(used), tuple(predicted), self.content_size.width)
        if wanted != self._shown:
            self._shown = wanted
            text = self._text(motions, margin, used, predicted)
            height = text.plain.count("\n") + 1
            self.update(text, layout=height != self.content_size.height)  # a layout draws the whole screen

    def on_resize(self) -> None:
        """Draw bars of another length."""
        if self._shown:
            motions, margin, used, predicted, _ = self._shown
            self.show(motions, margin, used, predicted)

    def _text(
        self, motions: Sequence[LimitedMotion], margin: float, used: Sequence[float], predicted: Sequence[float]
    ) -> Content:
        names = max((len(motion.name) for motion in motions), default=0)
        values = max((len(_value_text(motion, used)) for motion in motions), default=0)
        width = self.content_size.width or MAX_GAUGE
        bar = width - names - values - OTHER_GAUGE_CELLS
        is_narrow = bar < MIN_GAUGE
        bar = min(width if is_narrow else bar, MAX_GAUGE)
        lines = []
        for motion in motions:
            now = used[motion.place] / motion.limit if used else 0.0
            expected = (predicted[motion.place] if predicted else motion.predicted) / motion.limit
            colour = "$error" if now > 1 else "$warning" if now > 1 - margin else "$success"
            gauge = Content.styled(_bar_text(now, expected, 1 - margin, bar), colour)
            share = f" {100 * (now if used else expected):3.0f} %" if used or expected else ""
            value = Content.assemble(
                f"{_value_text(motion, used):<{values}}{share}",
                ("" if colour == "$success" else " !", f"bold {colour}"),
            )
            parts = (value, "\n", gauge) if is_narrow else (gauge, "  ", value)
            lines.append(Content.assemble((f"{motion.name:<{names}}  ", "bold"), *parts))
        return Content("\n").join(lines)


def _value_text(motion: LimitedMotion, used: Sequence[float]) -> str:
    """Return a value beside its limit; without a value what is predicted, and the limit alone without either."""
    value, limit = used[motion.place] if used else motion.predicted, prefixed_text(motion.limit, motion.unit)
    return f"{prefixed_text(float(f'{value:.3g}'), motion.unit)} of {limit}" if used or value else limit


def _bar_text(used: float, predicted: float, margin: float, width: int) -> str:
    """Return a bar of `width` cells; all are parts of a limit."""
    full = min(round(used * width), width)
    cells = [FULL] * full + [EMPTY] * (width - full)
    for part, sign in ((margin, MARGIN_SIGN), (predicted, PREDICTED_SIGN)):
        place = min(int(part * width), width - 1)
        if cells[place] == EMPTY:
            cells[place] = sign
    return "".join(cells)


REFRESH_INTERVAL_S = 0.1
"""Time between two looks at what was reported."""
MAX_NOTICE_LENGTH = 240
"""Most characters of a notice, of which others shall remain in sight; the run of the record has all of its message."""
POINT_TITLE = "Motion of this point, of its limits"
MAX_NOTICES = 500
"""Most lines of what was repeated or lost."""


class MeasurementPage(Page):
    """A measurement that is starting, measuring, or has ended."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = """\
A measurement: a process of its own plays the excitation on the machine, and estimates while it records.
x stops it: the excitation falls within measurement.ramp_out, and measured points are kept. x again kills the process,
after confirmation; the machine then stops by its watchdog.
The bars show how much of each limit this point has used: ┃ is what was predicted, │ where the margin begins.
The measurement goes on if you leave this screen, and m in Studies leads back to it. If you quit, or the connection is
lost, the machine is stopped: nobody would see what it does. The next measurement of the study goes on where it was.
At the end the record is analysed by an ordinary run, which is shown."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("x", "stop", "stop", tooltip="stop the machine softly; again: kill the process"),
        Binding("R", "again", "continue", tooltip="continue a measurement that was stopped"),
    ]

    def __init__(self, live: LiveMeasurement) -> None:
        super().__init__()
        self.measurement = live
        self._shown = -1
        self._drawn: tuple[LabelledResponse, ...] = ()
        self._state = ""
        self._notices = 0

    def body(self) -> ComposeResult:
        """Put the state above plot and gauges."""
        yield MeasurementState()
        with Container(id="split"):
            yield MeasuredBode()
            with Vertical(id="side"):
                yield LimitGauges(POINT_TITLE)
                yield RichLog(max_lines=MAX_NOTICES, wrap=True, min_width=1, classes="panel")

    def on_mount(self) -> None:
        """Look at what is reported."""
        self.heading, self.command = self.measurement.study, self.measurement.command
        self.query_one(RichLog).can_focus = False
        self.set_interval(REFRESH_INTERVAL_S, self.show_measurement)

    def on_resize(self) -> None:
        """Write the notices again, whose lines were broken for another width."""
        self.query_one(RichLog).clear()
        self._notices, self._shown = 0, -1

    async def load(self) -> None:
        """Show what was reported."""
        self.show_measurement()

    def show_measurement(self) -> None:
        """Show what has changed since the last look."""
        live = self.measurement
        if not self.is_current:
            return
        if live.version == self._shown:
            if live.rest and live.is_moving:
                self.query_one(MeasurementState).show(live)  # how long it has rested
            return
        self._shown = live.version
        if live.state != self._state:
            self._state = live.state
            self.refresh_bindings()
        self.query_one(MeasurementState).show(live)
        self._show_notices()
        plan, played, bode = live.plan, live.played, self.query_one(MeasuredBode)
        if plan is None:
            return
        self._show_motion(plan, played)
        bode.mark(played.at if played else None)
        if live.responses is not self._drawn:
            self._drawn = live.responses
            bode.show(live.responses, plan.frequency_range)

    def _show_motion(self, plan: PlanSummary, played: PlayedPoint | None) -> None:
        """Show the motion of the point that is played; at the end the greatest one."""
        gauges, live = self.query_one(LimitGauges), self.measurement
        if played is not None:
            gauges.border_title = POINT_TITLE
            gauges.show(plan.motions, plan.margin, played.demand, played.predicted)
        elif live.has_ended and live.greatest:
            gauges.border_title = "Greatest motion, of its limits"
            gauges.show(plan.motions, plan.margin, live.greatest, ())

    def _show_notices(self) -> None:
        log, notices = self.query_one(RichLog), self.measurement.notices
        for text in notices[self._notices :]:
            log.write(Text(f"{'·' if self.measurement.is_autonomous else '↻'} {printable(_shorten_notice(text))}"))
        self._notices = len(notices)
        if self.measurement.is_autonomous:
            log.border_title = "Stages, and what they found"
        else:
            log.border_title = f"Repeated or lost: {self._notices or 'nothing'}"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer to stop while the machine may move, and to continue when nothing is reported any more."""
        if action == "again":
            return self.measurement.has_ended
        return self.measurement.is_moving if action == "stop" else super().check_action(action, parameters)

    @work(group=ACTION_GROUP)
    async def action_stop(self) -> None:
        """Stop the machine softly; the second time, kill the process after confirmation."""
        live = self.measurement
        if live.state == "measuring":
            live.stop()
            self.app.notify("stopping: the excitation falls; x again kills the process")
        elif live.state == "stopping":
            question = "Kill the measuring process? The machine then stops by its watchdog; measured points are kept."
            if await self.app.push_screen_wait(ConfirmDialog(question)):
                live.kill()
        self.show_measurement()

    def action_again(self) -> None:
        """Plan the study again, to continue with the point that was lost."""
        live = self.measurement
        self.app.pop_screen()
        self.app.open_measurement(live.study, live.overrides)

    def action_back(self) -> None:
        """Close the screen; the measurement goes on."""
        if self.measurement.is_moving:
            self.app.notify("the measurement goes on; m in Studies shows it")
        super().action_back()


def _shorten_notice(text: str) -> str:
    return text if len(text) <= MAX_NOTICE_LENGTH else f"{text[: MAX_NOTICE_LENGTH - 4]} ..."
