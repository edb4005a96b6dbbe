"""A measurement while it runs: a line for each point, and on a terminal a bar for the one that is played."""

import sys
from collections.abc import Generator
from contextlib import closing, nullcontext
from typing import Any

from fraexp.cli.output import say
from fraexp.cli.progress import make_bar
from fraexp.data.results import Result
from fraexp.execution.events import Event
from fraexp.figures.elements.scales import decibel, degrees, readable_unit
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice
from fraexp.measurement.point_measurement import PointProgress
from fraexp.views.words import duration_text, fixed_text, plural
from fraexp.workspace.measurement_service import PointEstimated


class MeasurementMeter:
    """Shows the events of a measurement."""

    def __init__(self) -> None:
        self._bar = make_bar() if sys.stderr.isatty() else None
        self._task = self._bar.add_task("", total=1.0, count="", visible=False) if self._bar else None
        self._done, self._total, self._left = 0, 0, 0.0

    def follow(self, events: Generator[Any, None, None]) -> Event | None:
        """Show events up to the first one of the run that analyses the record, and return that; Ctrl-C stops all."""
        try:
            with self._bar or nullcontext():
                for event in events:
                    if isinstance(event, Event):
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
            case PointProgress():
                self._move(event)
            case PointEstimated():
                self._end_point(event)

    def _begin(self, event: MeasurementBegun) -> None:
        plan, kept = event.plan, len(event.kept)
        self._done, self._total, self._left = kept, len(plan.points), plan.seconds
        name = f"{plan.task.study} ({plan.task.label})" if plan.task.label else plan.task.study
        before = f", {kept} kept" if kept else ""
        say(f"{name}: {plural(self._total, 'point')}{before}, about {duration_text(plan.seconds)} of machine time")

    def _move(self, event: PointProgress) -> None:
        if self._bar is None or self._task is None:
            return
        state = plural(event.periods, "period") if event.is_settled or event.periods else "settling"
        band = "" if event.band is None else f", band ±{event.band:.2g} dB"
        left = f"about {duration_text(self._left)} left"
        text = f"{self._done}/{self._total}, {state}{band}, {100 * event.used:.0f} % of a limit, {left}"
        self._bar.update(
            self._task, description=event.point.frequency, completed=self._done / self._total, count=text, visible=True
        )

    def _end_point(self, event: PointEstimated) -> None:
        measured, point = event.measured, event.measured.point
        self._done, self._total, self._left = measured.done, measured.total, measured.seconds_left
        settled = "settled" if point.settled else "not settled"
        band = "" if point.band is None else f", band ±{point.band:.2g} dB"
        factor = "" if point.amplitude == 1 else f", amplitude × {point.amplitude:.2f}"
        found = "".join(f", {_response_text(result)}" for result in event.results if isinstance(result, Result))
        left = f", about {duration_text(self._left)} left" if self._left else ""
        say(
            f"{self._done}/{self._total}  {point.frequency}: {settled}, {plural(point.periods, 'period')}{band}{factor}"
            f"{found}; {duration_text(point.machine_time)}{left}"
        )


def _response_text(result: Result) -> str:
    """Return a response at one frequency, or how many frequencies a response has."""
    response = result.response
    if response is None:
        return result.message or "no response"
    if response.frequency.size > 1:
        return f"{response.output}/{response.input} at {plural(response.frequency.size, 'frequency', 'frequencies')}"
    factor, unit = readable_unit(response.unit)
    level, phase = decibel(factor * response.response)[0], degrees(response.response)[0]
    return f"{response.output}/{response.input} {fixed_text(level, 2)} dB re 1 {unit}, {fixed_text(phase, 1)}°"
