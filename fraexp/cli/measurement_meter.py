"""A measurement while it runs: a line for each point, and on a terminal a bar for the one that is played."""

import time
from collections.abc import Generator
from contextlib import closing
from typing import Any

from fraexp.cli.output import say
from fraexp.cli.progress import ProgressLine
from fraexp.execution.events import Event
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.point_measurement import PointProgress
from fraexp.views.measurement_texts import MissedBands, band_text, begin_text, point_text
from fraexp.views.words import duration_text, elapsed_text, plural
from fraexp.workspace.autonomous_service import EvaluationProgress
from fraexp.workspace.measurement_service import PointEstimated

MIN_PLANNING_S = 1.0
"""Time after which a plan that is being made is shown."""


class MeasurementMeter(ProgressLine):
    """Shows the events of a measurement, and its plan while it is made."""

    def __init__(self) -> None:
        super().__init__()
        self._done, self._total, self._left = 0, 0, 0.0
        self._plan: MeasurementPlan | None = None
        self._missed = MissedBands()
        self._planning: float | None = None

    def show_planning(self, share: float) -> None:
        """Show how far the plan is, if it takes some time."""
        now = time.monotonic()
        if self._planning is None or share == 1:  # one plan after the other
            self._planning = self._said = now
        spent = now - self._planning
        if spent < MIN_PLANNING_S and share < 1:
            return
        left = f"about {duration_text(spent * (1 / share - 1))} left" if share > 0 else ""
        if not self.draw("planning", share, left, visible=share < 1):
            self.tell([f"planning near the limits: {100 * share:.0f} %", left])

    def follow(self, events: Generator[Any, None, None]) -> Event | None:
        """Show events up to the first one of the run that analyses the record, and return that; Ctrl-C stops all."""
        try:
            with self.bar:
                for event in events:
                    if isinstance(event, Event):
                        if self._missed.text:
                            say(self._missed.text)
                        return event
                    self._show(event)
        except BaseException:
            with closing(events):
                raise
        return None

    def _show(self, event: object) -> None:
        match event:
            case MeasurementBegun():
                self._begin(event)
            case MeasurementNotice():
                say(event.what)
            case EvaluationProgress():
                self._wait(event)
            case PointProgress():
                self._move(event)
            case PointEstimated():
                self._end_point(event)

    def _begin(self, event: MeasurementBegun) -> None:
        self._plan, left = event.plan, event.plan.seconds_without(event.kept_numbers)
        self._done, self._total, self._left = len(event.kept), len(event.plan.points), left
        self._missed.begin(event)
        say(begin_text(event))

    def _move(self, event: PointProgress) -> None:
        state = plural(event.periods, "period") if event.is_settled or event.periods else "settling"
        band = "" if event.band is None else f", {band_text(event.band)}"
        left = f"about {duration_text(self._left)} left"
        text = f"{self._done}/{self._total}, {state}{band}, {100 * event.used:.0f} % of a limit, {left}"
        self.draw(event.point.frequency, self._done / self._total, text)

    def _wait(self, event: EvaluationProgress) -> None:
        share = min(event.elapsed / event.seconds, 1.0) if event.seconds else 0.0
        self.draw("evaluated", share, elapsed_text(event.elapsed, event.seconds))

    def _end_point(self, event: PointEstimated) -> None:
        measured = event.measured
        self._done, self._total, self._left = measured.done, measured.total, measured.seconds_left
        self._missed.add(measured.point)
        assert self._plan is not None
        say(point_text(event, self._plan))
