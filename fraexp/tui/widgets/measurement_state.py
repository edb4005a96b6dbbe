"""The state of a measurement above its plot: progress, the point that is played, and the last one that was measured."""

import time

from textual.content import Content
from textual.widgets import Static

from fraexp.data.terminal_text import printable
from fraexp.tui.services.live_measurement import LiveMeasurement
from fraexp.tui.services.measurement_feed import ProgressReport
from fraexp.tui.services.themes import state_sign
from fraexp.views.measurement_texts import band_text
from fraexp.views.run_progress import bar_text
from fraexp.views.words import duration_text, elapsed_text, plural

MIN_BAR, MAX_BAR = 10, 40
"""Least and most cells of the bar of progress."""
OTHER_CELLS, OTHER_STAGE_CELLS = 62, 84
"""Cells of the other texts in its line, and those where they name a stage."""


class MeasurementState(Static):
    """A line on the progress, one on the point that is played, and one on the last point that was measured."""

    DEFAULT_CSS = """
    MeasurementState { height: 3; padding: 0 1; text-wrap: nowrap; text-overflow: ellipsis; }
    MeasurementState.-ended { height: auto; min-height: 3; max-height: 8; }
    """

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
        played = live.progress.seconds if live.progress else 0.0
        left = max(live.seconds_left - played, 0.0)
        name = f"{live.plan.label}: " if live.plan and live.plan.label else ""
        time_left = f", about {duration_text(left)} left" if live.state == "measuring" and left else ""
        points = f"{live.done} of {plural(live.total, 'point')}{time_left}" if live.total else ""
        texts = [live.stage.name if live.stage else "", f"{name}{points}"]
        return f"{bar_text(live.done_fraction, width)} {': '.join(filter(None, texts))}"

    def _point_text(self, live: LiveMeasurement) -> str:
        """Return what is played now, or why nothing is played any more."""
        if live.has_ended:
            advice = "R continues with the point that was lost" if live.state == "stopped" else "R tries again"
            return "" if live.state == "complete" else f"{live.message}; {advice}"
        if live.stage and live.stage.rest:
            return (
                f"now   {live.stage.rest}: {elapsed_text(time.monotonic() - live.rest_since, live.stage.rest_seconds)}"
            )
        if live.progress is None:
            return (
                "" if not live.total else "now   the axis rests between two points while what was recorded is evaluated"
            )
        return progress_text(live.progress, live.plan.band if live.plan else None)


def progress_text(progress: ProgressReport, target: float | None) -> str:
    """Return the point that is played: frequency, amplitude, settled or not, periods, band and its target."""
    state = "settled" if progress.is_settled else "settling"
    band = "" if progress.band is None else f", {band_text(progress.band)}"
    aim = "" if target is None else f", target ±{target:g} dB"
    counted = f"{state}, {plural(progress.periods, 'period')}"
    return f"now   {progress.frequency}, {progress.peak} peak: {counted}{band}{aim}, {progress.seconds:.1f} s"
