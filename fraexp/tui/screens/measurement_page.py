"""A measurement while it runs: the response that grows, motion beside its limits, and the key that stops it."""

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Vertical
from textual.widgets import RichLog

from fraexp.data.terminal_text import printable
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import Page
from fraexp.tui.services.live_measurement import LiveMeasurement
from fraexp.tui.services.measurement_feed import PlanReport, ProgressReport
from fraexp.tui.widgets.limit_gauges import LimitGauges
from fraexp.tui.widgets.measured_bode import MeasuredBode
from fraexp.tui.widgets.measurement_state import MeasurementState

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
    DEFAULT_CSS = """
    MeasurementPage #split { layout: vertical; height: 1fr; }
    MeasurementPage.-wide #split { layout: horizontal; }
    MeasurementPage MeasuredBode { width: 1fr; }
    MeasurementPage #side { height: auto; }
    MeasurementPage.-wide #side { width: 46; height: 1fr; }
    MeasurementPage RichLog {
        height: 2; background: $background; padding: 0 1; scrollbar-size-horizontal: 0;
        border-top: solid $border-blurred;
    }
    MeasurementPage.-high RichLog { height: 8; }
    MeasurementPage.-wide RichLog { height: 1fr; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("x", "stop", "stop", tooltip="stop the machine softly; again: kill the process"),
        Binding("R", "again", "continue", tooltip="continue a measurement that was stopped"),
    ]

    def __init__(self, live: LiveMeasurement) -> None:
        super().__init__()
        self.measurement = live
        self._shown = self._drawn = -1
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
            if live.stage and live.stage.rest and live.is_moving:
                self.query_one(MeasurementState).show(live)  # how long it has rested
            return
        self._shown = live.version
        if live.state != self._state:
            self._state = live.state
            self.refresh_bindings()
        self.query_one(MeasurementState).show(live)
        self._show_notices()
        plan, progress, bode = live.plan, live.progress, self.query_one(MeasuredBode)
        if plan is None:
            return
        self._show_motion(plan, progress)
        bode.mark(progress.at if progress else None)
        if live.response_version != self._drawn:
            self._drawn = live.response_version
            bode.show(live.responses(), plan.frequency_range)

    def _show_motion(self, plan: PlanReport, progress: ProgressReport | None) -> None:
        """Show the motion of the point that is played; at the end the greatest one."""
        gauges, live = self.query_one(LimitGauges), self.measurement
        if progress is not None:
            gauges.border_title = POINT_TITLE
            gauges.show(plan.motions, plan.margin, progress.demand, progress.predicted)
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

    def action_stop(self) -> None:
        """Stop the machine softly; the second time, kill the process after confirmation."""
        live = self.measurement
        if live.state == "measuring":
            live.stop()
            self.app.notify("stopping: the excitation falls; x again kills the process", markup=False)
        elif live.state == "stopping":
            question = "Kill the measuring process? The machine then stops by its watchdog; measured points are kept."
            self.app.push_screen(ConfirmDialog(question), lambda yes: live.kill() if yes else None)
        self.show_measurement()

    def action_again(self) -> None:
        """Plan the study again, to continue with the point that was lost."""
        live = self.measurement
        self.app.pop_screen()
        self.app.open_measurement(live.study, live.overrides)

    def action_back(self) -> None:
        """Close the screen; the measurement goes on."""
        if self.measurement.is_moving:
            self.app.notify("the measurement goes on; m in Studies shows it", markup=False)
        super().action_back()


def _shorten_notice(text: str) -> str:
    return text if len(text) <= MAX_NOTICE_LENGTH else f"{text[: MAX_NOTICE_LENGTH - 4]} ..."
