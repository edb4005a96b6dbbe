"""``fraexp measure`` and ``fraexp excite``: play a study's excitation on a machine, or write it to a file for one."""

import os
import sys
import time
from argparse import Namespace
from collections.abc import Collection, Generator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, print_outcome
from fraexp.cli.output import ask, print_json, print_path, print_table, say
from fraexp.cli.progress import ProgressLine
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.texts import printable
from fraexp.errors import ConsentError, StudyError
from fraexp.execution.events import Event
from fraexp.measurement.consent import Consent
from fraexp.measurement.excitation_files import excitation_table, write_excitation
from fraexp.measurement.measured_points import kept_points
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.point_measurement import PointProgress
from fraexp.measurement.watched_machine import drive_note
from fraexp.records.study_writer import write_study
from fraexp.simulation.motion_limits import Demand
from fraexp.views import measurement_texts
from fraexp.views.words import duration_text, elapsed_text, plural
from fraexp.workspace.autonomous_service import AutonomousService, EvaluationProgress
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_service import WorkspaceService

MIN_PLANNING_S = 1.0
"""Time after which a plan that is being made is shown."""


class MeasurementMeter(ProgressLine):
    """Shows the events of a measurement, and its plan while it is made."""

    def __init__(self) -> None:
        super().__init__()
        self._done, self._total, self._left = 0, 0, 0.0
        self._plan: MeasurementPlan | None = None
        self._missed = measurement_texts.MissedBands()
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
        say(measurement_texts.begin_text(event))

    def _move(self, event: PointProgress) -> None:
        state = plural(event.periods, "period") if event.is_settled or event.periods else "settling"
        band = "" if event.band is None else f", {measurement_texts.band_text(event.band)}"
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
        say(measurement_texts.point_text(event, self._plan))


def execute(arguments: Namespace) -> ExitCode:
    """Measure, run the study of the record, and print its sweeps."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    if arguments.autonomous:
        return _measure_autonomously(arguments, workspace)
    meter = MeasurementMeter()
    service = MeasurementService(
        workspace, arguments.study, arguments.overrides, meter.show_planning, arguments.trust_program
    )
    if arguments.dry_run:
        with meter.bar:
            plans = service.plans()
        if arguments.json:
            print_json({"plans": [_plan_document(plan) for plan in plans]})
        else:
            for plan in plans:
                kept = kept_points(service.files(plan.task), plan.task)
                _print_plan(plan, {point.number for point in kept} if not arguments.fresh else ())
        return ExitCode.OK
    _ask_consents(service.missing_consents)
    return _follow(service.measure(arguments.fresh), meter, arguments, workspace)


def _ask_consents(consents: Sequence[Consent]) -> None:
    """Ask on a terminal for what the study's machine does; ConsentError if that is not allowed.

    Without a terminal the measurement itself refuses it.
    """
    for consent in consents if sys.stdin.isatty() else ():
        print(printable(f"the study would {consent.action}"), file=sys.stderr)
        if not ask("allow it, now and later?"):
            raise ConsentError("not allowed: nothing was run")
        consent.remember()


def _measure_autonomously(arguments: Namespace, workspace: WorkspaceService) -> ExitCode:
    """Measure an axis of which only the limits are known; the exit code says whether the verdict is ok."""
    if arguments.dry_run:
        raise StudyError("--dry-run: an autonomous measurement plans each stage by the one before; leave it out")
    service = AutonomousService(workspace, arguments.study, arguments.overrides, arguments.trust_program)
    _ask_consents(service.missing_consents)
    code = _follow(service.measure(arguments.fresh), MeasurementMeter(), arguments, workspace)
    return ExitCode.INCOMPLETE if code is ExitCode.OK and not service.is_good else code


def _follow(
    events: Generator[Any, None, None], meter: MeasurementMeter, arguments: Namespace, workspace: WorkspaceService
) -> ExitCode:
    """Show a measurement and the run of its record; return the exit code."""
    try:
        first = meter.follow(events)
    except KeyboardInterrupt:
        say("interrupted: the machine was stopped; measured points are kept, and the same command continues")
        return ExitCode.INTERRUPTED
    followed = follow(_rest(first, events))
    return print_outcome(followed, arguments, workspace)


def _rest(first: Event | None, events: Generator[object, None, None]) -> Generator[Event, None, None]:
    """Yield the events of the run, whose first one has been taken already."""
    if first is not None:
        yield first
    yield from (event for event in events if isinstance(event, Event))


def excite(arguments: Namespace) -> ExitCode:
    """Check the excitation against the limits, write it, and print its plan."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    meter = MeasurementMeter()
    service = MeasurementService(workspace, arguments.study, arguments.overrides, meter.show_planning)
    output: Path = arguments.output
    if os.path.lexists(output) and not arguments.force:
        raise StudyError(f"{output}: already exists; overwrite it with --force, or choose another file")
    with meter.bar:
        plans = service.plans()
    if len(plans) > 1:
        raise StudyError(f"{arguments.study}: it has {len(plans)} experiments; write one at a time, with --set")
    record = arguments.record or output.with_name(f"{output.stem}-record.csv")
    table = excitation_table(plans[0])
    study, content = service.record_study(record, table, arguments.force)
    note = write_excitation(output, table)
    write_study(study, content)
    position = "rad" if table.unit == "N m" else "m"
    _print_plan(plans[0])
    print(f"{table.samples:,} samples, {table.samples * table.sample_time:.1f} s with pauses; {note}")
    print_path(output)
    print_path(study, "study of the record ")
    say(
        f"next: play it, and record y [{position}] and u [{table.unit}] from its first sample on, as columns of "
        f"{record}; then: "
        f"fraexp import {record}{workspace.shown_options()}"
    )
    return ExitCode.OK


def _print_plan(plan: MeasurementPlan, kept: Collection[int] = ()) -> None:
    """Print the points in the order in which they are played, and the greatest demand beside each limit.

    Points that an earlier measurement has kept are given by number.
    """
    if plan.task.label:
        print(plan.task.label)
    print_table(measurement_texts.plan_heads(plan), [measurement_texts.plan_cells(point) for point in plan.points])
    print()
    limits = [getattr(plan.limits, name) for name in Demand._fields]
    units = measurement_texts.demand_units(is_rotary(plan.task.experiment))
    rows = zip(measurement_texts.demand_names(), units, plan.demand, limits, strict=True)
    print_table(
        ["greatest", "predicted", "limit", "of it"],
        [
            [
                name,
                f"{value:.3g} {unit}",
                "none" if limit is None else f"{limit:.3g} {unit}",
                "" if limit is None else f"{100 * value / limit:.0f} %",
            ]
            for name, unit, value, limit in rows
        ],
    )
    print(f"\n{measurement_texts.plan_total(plan, kept)}")
    machine = plan.task.settings.machine if plan.task.settings else None
    if machine is not None and (note := drive_note(machine.name, machine.can_disable)):
        print(note)


def _plan_document(plan: MeasurementPlan) -> dict[str, object]:
    """Return a plan as plain data."""
    return {
        "experiment": plan.task.label,
        "seconds": plan.seconds,
        "limits": plan.limits.plain(),
        "demand": plan.demand._asdict(),
        "points": [
            {
                "number": point.number,
                "frequency": point.frequency,
                "settling": point.settling * point.sample_time,
                "record": point.counts.record * point.sample_time,
                **point.demand._asdict(),
            }
            for point in plan.points
        ],
    }
