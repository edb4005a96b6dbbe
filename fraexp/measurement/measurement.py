"""A measurement: all points of a plan on a machine, repeated where that helps, and continued after an interruption."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from fraexp.components.machine_session import MachineDescription
from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.components.registry import Registry
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sample_file import SampleHeader, SampleWriter
from fraexp.errors import ConnectionLostError, LimitError, MachineError, PlanError
from fraexp.measurement.measured_points import PLAY_COLUMN, MeasuredPoint, MeasurementFiles
from fraexp.measurement.measurement_plan import (
    SETTLING_RESERVE,
    MeasurementPlan,
    PlannedPoint,
    check_points,
    plan_measurement,
)
from fraexp.measurement.motion_guard import LimitExceededError
from fraexp.measurement.play_demands import Report, simulate_demands
from fraexp.measurement.point_measurement import PointMeasurement, PointProgress, RecordAim, UnsettledError
from fraexp.measurement.tasks import MeasurementTask
from fraexp.measurement.watched_machine import WatchedMachine, connect_watched

AMPLITUDE_AFTER_LIMIT, MAX_LOWERED = 0.8, 0.7
"""Part of a limit at which a point is played again that exceeded it, and the greatest factor on its amplitude."""
MAX_RAISED = 2.0
"""Greatest factor on an amplitude at once: friction may give way."""
MIN_RAISED = 1.1
"""Least factor that is worth another play."""
REMEDY_AFTER_LIMIT = (
    ": check the nominal machine, of which less was predicted; with measurement.adapt_amplitude=true the same command "
    "goes on with a lower amplitude, and with another excitation --fresh begins anew"
)
STRONGEST_SHARE = 0.99
"""Part of the strongest excitation of a plan from which a point counts as one with it."""
RECORD_RESERVE = 1.1
"""Factor on the record that a band asks for."""


@dataclass(frozen=True)
class MeasurementBegun:
    """A machine is connected, and the plan is within its limits."""

    plan: MeasurementPlan
    kept: tuple[MeasuredPoint, ...]
    """Points of an earlier, interrupted measurement, which are not played again."""

    @property
    def kept_numbers(self) -> frozenset[int]:
        """The numbers of the points that are kept."""
        return frozenset(point.number for point in self.kept)


@dataclass(frozen=True)
class MeasurementNotice:
    """Something that the user should know, such as a point that is repeated."""

    what: str


@dataclass(frozen=True)
class PointMeasured:
    """A point whose record is stored."""

    point: MeasuredPoint
    done: int
    total: int
    machine_time: float
    """Machine time of all points so far [s]."""
    seconds_left: float
    """Machine time that the others are expected to take [s]."""


MeasurementEvent = MeasurementBegun | MeasurementNotice | PointProgress | PointMeasured
JudgeBand = Callable[[MeasuredPoint], float | None]
"""Takes a point and returns the half-width of its 95 % band [dB] by the study's estimators; None if it is not known."""


class Measurement:
    """All points of a task."""

    def __init__(
        self,
        task: MeasurementTask,
        settings: MeasurementSettings,
        files: MeasurementFiles,
        folder: Path,
        is_trusted: bool = False,
    ) -> None:
        """Take what is measured, where it is stored, and whether the machine may run programs without being asked."""
        self._task, self._settings, self._files, self._folder = task, settings, files, folder
        self._is_trusted = is_trusted
        self._machine: WatchedMachine

    def events(
        self,
        registry: Registry,
        judge: JudgeBand,
        planned: MeasurementPlan | None = None,
        fresh: bool = False,
        report: Report = lambda _: None,
    ) -> Generator[MeasurementEvent, None, None]:
        """Measure and yield what happens; closing the generator stops the machine, and measured points are kept.

        The plan is that of the task, unless another one is given. With `fresh`, points of an earlier measurement are
        discarded as soon as the machine is there and the plan is within its limits. `report` is told how far a plan is.
        """
        self._share = planned.limit_share if planned else 1.0
        self._machine = self._connect()
        try:
            description = self._machine.description
            check_description(description, self._task)
            plan = planned or plan_measurement(self._task, registry, description.limits, report)
            for remark in self._machine.remarks(self._settings.machine.name) if planned is None else ():
                yield MeasurementNotice(remark)
            header = SampleHeader(description.sample_time, {PLAY_COLUMN: "", **description.channels})
            with self._files.open_samples(self._task, header, fresh) as writer:
                yield from self._all_points(plan, writer, judge)
        finally:
            self._machine.close()

    def _all_points(self, plan: MeasurementPlan, writer: SampleWriter, judge: JudgeBand) -> Iterator[MeasurementEvent]:
        lost = self._files.drop_lost(writer.rows)
        numbers = {point.number for point in plan.points}
        kept = [point for point in self._files.points() if point.number in numbers]
        yield MeasurementBegun(plan, tuple(kept))
        for each in lost:
            yield MeasurementNotice(f"{each.frequency}: measured again, because its samples never reached the disk")
        self._plays, self._limits = writer.last_play(), plan.limits
        self._strongest = max(point.rms for point in plan.points)
        spent, total = sum(point.machine_time for point in kept), len(plan.points)
        done = {point.number for point in kept}
        waiting = [point for point in plan.points if point.number not in done]
        if waiting:
            self._machine.await_rest()  # nobody has watched it while the plan was made
        played = expected = 0.0
        for place, point in enumerate(waiting):
            found = yield from self._point(point, writer, judge)
            self._files.add(found)
            spent, played, expected = spent + found.machine_time, played + found.machine_time, expected + point.seconds
            left = sum(each.seconds for each in waiting[place + 1 :]) * played / expected
            yield PointMeasured(found, len(kept) + place + 1, total, spent, left)
        if waiting and self._machine.description.is_live:
            self._machine.await_rest()

    def _point(
        self, point: PlannedPoint, writer: SampleWriter, judge: JudgeBand
    ) -> Generator[MeasurementEvent, None, MeasuredPoint]:
        """Play a point until its record is good enough, and return it."""
        repeats: list[str] = []
        spent, reason = 0.0, ""
        failure: type[MachineError] = MachineError
        aim = self._aim(point)
        for attempt in range(self._settings.attempts):
            if reason:
                repeats.append(reason)
                yield MeasurementNotice(f"{point.frequency}: played again, because {reason}")
            self._plays += 1
            reserve = SETTLING_RESERVE * 2**attempt  # of a machine that must know before how long to play
            play = PointMeasurement(point, self._machine, writer, aim, self._plays, reserve)
            try:
                yield from play
            except (ConnectionLostError, UnsettledError) as error:
                reason, spent, failure = str(error), spent + play.seconds, MachineError
                if isinstance(error, ConnectionLostError):
                    self._reconnect()
                continue
            except LimitExceededError as error:
                if not self._settings.adapt_amplitude:
                    raise LimitError(*error.args, REMEDY_AFTER_LIMIT) from error
                reason, spent, failure = str(error), spent + play.seconds, LimitError
                point = point.with_amplitude(point.amplitude * min(AMPLITUDE_AFTER_LIMIT / error.reached, MAX_LOWERED))
                continue
            for note in gathered(play.notes):
                yield MeasurementNotice(f"{point.frequency}: {note}")
            found = play.result(spent, tuple(repeats))
            band = judge(found)
            found = replace(found, band=found.band if band is None else band)
            better = self._improved(point, aim, play, found) if attempt + 1 < self._settings.attempts else None
            if better is None:
                if play.hides_motion and point.rms >= STRONGEST_SHARE * self._strongest:
                    raise play.standstill_error()
                return found
            point, aim, reason = better
            spent += play.seconds
        plays = f"{self._settings.attempts} plays (measurement.attempts)"
        raise failure(f"{point.frequency}: given up after {plays}; the last: {reason}")

    def _aim(self, point: PlannedPoint) -> RecordAim:
        shortest, settings = point.counts.record, self._settings
        if settings.band is None:
            return RecordAim(None, shortest, shortest, is_patient=True)
        longest = max(round(settings.max_record_time / point.sample_time), shortest)
        return RecordAim(settings.band, shortest, longest, is_patient=not settings.adapt_amplitude)

    def _improved(
        self, point: PlannedPoint, aim: RecordAim, play: PointMeasurement, found: MeasuredPoint
    ) -> tuple[PlannedPoint, RecordAim, str] | None:
        """Return how to play a point again that has not reached its band, and why; None if that would not help."""
        if aim.band is None or found.band is None or found.band <= aim.band:
            return None
        width = f"its band is {found.band:.3g} dB wide"
        if play.is_hopeless and self._settings.adapt_amplitude:
            raised = self._raised(point, min(found.band / aim.band, MAX_RAISED))
            if raised is not None:
                return raised, aim, f"{width}, and the amplitude can be {raised.amplitude / point.amplitude:.2f} times"
            if not aim.is_patient:
                return point, aim._replace(is_patient=True), f"{width}, and limits allow no higher amplitude"
        recorded = found.periods * found.samples
        needed = int(min(RECORD_RESERVE * recorded * (found.band / aim.band) ** 2, aim.longest))
        if needed < recorded + found.samples:
            return None
        return point, aim._replace(shortest=needed), f"{width} by the study's estimator"

    def _raised(self, point: PlannedPoint, factor: float) -> PlannedPoint | None:
        """Return a point with a higher amplitude that the limits allow; None if none is worth it."""
        while factor >= MIN_RAISED:
            higher = point.with_amplitude(point.amplitude * factor)
            higher = replace(higher, demand=higher.demand.maximum_with(*simulate_demands([higher.simulated_play])))
            with suppress(PlanError):
                return check_points([higher], self._limits, self._settings.margin)[0]
            factor *= 0.9
        return None

    def _reconnect(self) -> None:
        with suppress(MachineError):
            self._machine.close()
        self._machine = self._connect()

    def _connect(self) -> WatchedMachine:
        rotary = is_rotary(self._task.experiment)
        limits = self._task.limits
        return connect_watched(self._settings, self._folder, rotary, limits, self._share, self._is_trusted)


def gathered(notes: Sequence[str]) -> list[str]:
    """Return the first note of a play, with the number of the others, in a list of one text; empty without a note."""
    more = f" (and {len(notes) - 1} more)" if len(notes) > 1 else ""
    return [f"{note}{more}" for note in notes[:1]]


def check_description(description: MachineDescription, task: MeasurementTask) -> None:
    """Raise PlanError if a machine does not fit the study."""
    sample_time = task.experiment["loop"]["sample_time"]
    if abs(description.sample_time / sample_time - 1) > 1e-9:
        raise PlanError(
            f"the machine has a sample time of {description.sample_time:g} s; loop.sample_time is {sample_time:g} s: "
            "let them agree"
        )
