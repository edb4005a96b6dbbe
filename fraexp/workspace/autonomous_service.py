"""An autonomous measurement: from an axis with limits to plant, friction, bands and a verdict, stage by stage."""

import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from typing import Any

from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.data.results import Outcome, Result
from fraexp.data.rotary_axes import is_rotary, rotary_unit
from fraexp.data.sample_file import SampleHeader
from fraexp.errors import FraexpError, MachineError, StudyError
from fraexp.execution.events import Event, Finished, Noticed, Planned, Progress
from fraexp.figures.elements.scales import displacement_unit
from fraexp.measurement.autonomous_points import LEVEL_RATIOS, PointDesign
from fraexp.measurement.consent import Consent
from fraexp.measurement.friction_loop import LOOP_HZ, FrictionLoop, measure_friction_loop
from fraexp.measurement.measured_points import PLAY_COLUMN, MeasuredPoint, MeasurementFiles
from fraexp.measurement.measured_study import record_section, record_study
from fraexp.measurement.measurement import Measurement, MeasurementEvent, MeasurementNotice, check_description
from fraexp.measurement.measurement_plan import PlannedPoint
from fraexp.measurement.tasks import MeasurementTask
from fraexp.measurement.unknown_axis import UnknownAxis
from fraexp.measurement.watched_machine import connect_watched
from fraexp.records.study_writer import renew_study
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.study.accuracy import Accuracy
from fraexp.study.resolution import Resolver
from fraexp.study.study_file import describe_study, find_study, outline
from fraexp.workspace.measurement_service import kept_text, missing_consents, results_at
from fraexp.workspace.workspace_service import WorkspaceService

ESTIMATOR = {"name": "plant_and_friction", "law": "any", "estimate_dead_time": True}
"""Estimator that needs to know nothing of a machine but units; a study may state further parameters, such as laws."""
LIVE_ESTIMATOR = {"name": "conventional", "refer_to_plant": False}
"""Estimator of what is shown of each point while the measurement goes on."""
SUMMARY = ("k0", "f1", "Coulomb force", "input_dead_time", "input_time_constant", "validation error")
"""Metrics in the line of a stage."""
LAW_METRIC = "friction law"
"""Metric that is 1 if a friction law explains the records."""
NOTE = "friction loop"
"""Name under which the log has what the friction loop shows."""

STAGES = ("friction loop", "coarse frequencies", "fine frequencies", "validation")
"""Stages of an autonomous measurement."""


@dataclass(frozen=True)
class StageBegun(MeasurementNotice):
    """A stage begins, or one of its levels."""

    stage: int
    """Its place in STAGES."""
    label: str
    """What its points have in common."""
    level: int = 0
    """Place of the level in it."""
    levels: int = 1


@dataclass(frozen=True)
class EvaluationBegun(MeasurementNotice):
    """All that was recorded so far is evaluated, after a stage; the axis rests."""

    stage: int
    seconds: float = 0.0
    """Time that this is expected to take [s]; 0 if it is not known."""


@dataclass(frozen=True)
class EvaluationProgress:
    """How long an evaluation has taken so far."""

    elapsed: float
    """Time since its begin [s]."""
    seconds: float
    """Time that it is expected to take [s]; 0 if it is not known."""


AutonomousEvent = MeasurementEvent | EvaluationProgress | Event


class AutonomousService:
    """The autonomous measurement of one study.

    Of the study it takes sample time, kind of axis, limits, the machine, and parameters of its estimator; plant,
    friction and controller that the study may state are for a simulated machine alone.
    """

    def __init__(
        self, service: WorkspaceService, study: str, overrides: Sequence[str] = (), is_trusted: bool = False
    ) -> None:
        """Read a study; `is_trusted` allows its machine to run programs and to reach controllers without a question."""
        self._is_trusted = is_trusted
        (self._name, self._file), self._service = find_study(study, service.folder), service
        cases, grid = outline(self._file, service.folder, overrides)
        if len(cases) > 1 or grid:
            raise StudyError(f"{self._file}: an autonomous measurement has one machine; leave out cases and grid")
        self._sections = cases[0]
        for name in ("loop", "limits", "measurement"):
            if name not in self._sections:
                raise StudyError(f"{self._file}: lacks the section [{name}]; an autonomous measurement needs it")
        if "sample_time" not in self._sections["loop"]:
            raise StudyError(f"{self._file}, [loop]: lacks sample_time")
        self._sections = {**self._sections, **Resolver(self._file, service.registry).machine(cases[0], str(self._file))}
        self.settings = self._parsed_settings()
        self.is_rotary = is_rotary(self._sections)
        try:
            self.limits = MotionLimits.parse(self._sections["limits"], "limits", rotary=self.is_rotary)
            self.accuracy = Accuracy.parse(self._sections.get("accuracy", {}), "accuracy")
        except FraexpError as error:
            raise error.at(f"{self._file}, ") from None
        stem = f"{self._name.replace('/', '-')}-autonomous"
        self.files = MeasurementFiles(service.folder / "measurements", stem)
        self.path = service.folder / "studies" / f"{stem}.toml"
        """The study of the record."""
        self.result: Result | None = None
        """What the last measurement has found."""

    @property
    def missing_consents(self) -> list[Consent]:
        """What its user has to allow before it can be measured."""
        return [] if self._is_trusted else missing_consents([self.settings], self._service.folder)

    @property
    def is_good(self) -> bool:
        """Whether the last measurement has ended with a result that is ok."""
        return _is_good(self.result)

    def measure(self, fresh: bool = False) -> Generator[AutonomousEvent, None, None]:
        """Measure in stages, and yield what happens; the events of the last run end it.

        What an interrupted measurement has stored is kept, unless `fresh`. Closing the generator stops the machine.
        """
        with self.files.locked():
            yield from self._measure(fresh)

    def _measure(self, fresh: bool) -> Generator[AutonomousEvent, None, None]:
        yield _stage_begun(0, f"a sine of {LOOP_HZ:g} Hz that rises until friction is overcome")
        axis, task, loop = yield from self._begin(fresh)
        axis = replace(axis, noise=loop.position_noise)
        force = "N m" if axis.is_rotary else "N"
        closes = f"closes at {loop.force:.4g}" if loop.has_closed else f"does not close up to {loop.amplitude:.4g}"
        noise, resolution = (_length_text(of, axis.is_rotary) for of in (loop.noise, loop.resolution))
        yield MeasurementNotice(f"friction loop: {closes} {force}; noise {noise}, encoder {resolution}")
        design = PointDesign(axis, loop, self._service.registry)
        coarse = design.coarse()
        yield from self._levels(axis, task, design, coarse, 0, 1)
        rough = yield from self._evaluated(task, loop, 1)
        near = design.fine(*_modes(rough))
        if not (_is_good(rough) or (near and _knows_law(rough))):
            near = sorted([*near, *design.between(coarse)])
        first = len(LEVEL_RATIOS) * len(coarse)
        yield from self._levels(axis, task, design, near, first, 2)
        number = first + len(LEVEL_RATIOS) * len(near)
        begun = _stage_begun(3, "a multisine with random phases")
        yield from self._play(axis, task, [design.validation(number)], begun)
        self.result = yield from self._evaluated(task, loop, 3, validation=1)

    def estimate_point(self, task: MeasurementTask, point: MeasuredPoint) -> list[Result | str]:
        """Return the response at one point, of machine and friction together, for whoever watches."""
        watched = replace(task, estimators=(LIVE_ESTIMATOR,))
        return results_at(point, self.files, self.path.parent, watched, self._service.registry)

    def _estimator(self) -> dict[str, Any]:
        """Return the estimator of the record, with what the study states of it."""
        own = self._sections.get("estimator", {})
        return {**ESTIMATOR, **own} if own.get("name", ESTIMATOR["name"]) == ESTIMATOR["name"] else {**ESTIMATOR}

    def _parsed_settings(self) -> MeasurementSettings:
        registry, sections = self._service.registry, self._sections
        rotary = is_rotary(sections)
        try:
            filled = registry.fill_inherited(MeasurementSettings, sections["measurement"], sections)
            return MeasurementSettings.parse(filled, "measurement", rotary=rotary)
        except FraexpError as error:
            raise error.at(f"{self._file}, [measurement]: ", "measurement") from None

    def _begin(
        self, fresh: bool
    ) -> Generator[MeasurementNotice, None, tuple[UnknownAxis, MeasurementTask, FrictionLoop]]:
        """Connect, check what the machine says of itself, and measure the friction loop unless it is known already."""
        title = describe_study(self._name, self._file).title
        share = 1 - self.settings.margin
        with connect_watched(
            self.settings, self._service.folder, self.is_rotary, self.limits, share, self._is_trusted
        ) as machine:
            description = machine.description
            for remark in machine.remarks(self.settings.machine.name):
                yield MeasurementNotice(remark)
            if not description.is_live:
                raise MachineError(
                    f"{self._file}: of an unknown axis nothing can be predicted, and '{self.settings.machine.name}' "
                    "shows its samples after a play; expected a machine that shows them while it plays, such as ads or "
                    "a plugin of your own (fraexp new machine)"
                )
            sample_time = description.sample_time
            loop = {"sample_time": sample_time, "rotary": self.is_rotary}
            axis = UnknownAxis.from_sections(self._name, title, loop, self.limits, description.limits, self.settings)
            task = axis.task([self._estimator()])
            check_description(description, task)
            header = SampleHeader(sample_time, {PLAY_COLUMN: "", **description.channels})
            with self.files.open_samples(task, header, fresh) as writer:
                self.files.drop_lost(writer.rows)
                noted = self.files.noted(NOTE)
                if noted is not None:
                    return axis, task, FrictionLoop(**noted)
                (period,) = axis.sines([LOOP_HZ], self._service.registry)
                found = measure_friction_loop(axis, machine, writer, period)
        self.files.note(NOTE, asdict(found))
        return axis, task, found

    def _levels(
        self,
        axis: UnknownAxis,
        task: MeasurementTask,
        design: PointDesign,
        frequencies: Sequence[float],
        first: int,
        stage: int,
    ) -> Generator[MeasurementEvent, None, None]:
        """Measure the frequencies of a stage at all levels, each by what the one below has shown."""
        below: dict[int, MeasuredPoint] = {}
        for level in range(len(LEVEL_RATIOS) if frequencies else 0):
            begin = first + level * len(frequencies)
            points = design.level(frequencies, level, begin, below)
            yield from self._play(axis, task, points, _level_begun(stage, level, len(points)))
            below = {point.number - begin: point for point in self.files.points() if point.number >= begin}

    def _play(
        self, axis: UnknownAxis, task: MeasurementTask, points: Sequence[PlannedPoint], begun: StageBegun
    ) -> Generator[MeasurementEvent, None, None]:
        kept = {point.number for point in self.files.points()}
        if all(point.number in kept for point in points):
            return
        yield begun
        measurement = Measurement(task, axis.settings, self.files, self._service.folder, self._is_trusted)
        plan = axis.plan(task, points)
        with closing(measurement.events(self._service.registry, lambda _: None, plan)) as events:
            yield from events

    def _evaluated(
        self, task: MeasurementTask, loop: FrictionLoop, stage: int, validation: int = 0
    ) -> Generator[AutonomousEvent, None, Result | None]:
        """Run the study of what was recorded so far, and return its result; None if it has failed.

        With `validation` records it is the last one, whose events are all yielded.
        """
        yield from self._write_study(task, loop, validation)
        result, expected, begun = None, 0.0, time.monotonic()
        for event in self._service.run([str(self.path.resolve())]):
            if isinstance(event, Planned):
                expected = event.time.seconds or 0.0
                yield _evaluation_begun(stage, expected)
            if validation:
                yield event
            elif isinstance(event, Progress):
                yield EvaluationProgress(time.monotonic() - begun, expected)
            if isinstance(event, Finished):
                result = self._result_of(event)
                found = _summary(result, event.error)
                next_ones = f"{STAGES[stage]}, which the next ones correct: {found}"
                yield Noticed(f"verdict: {found}") if validation else MeasurementNotice(next_ones)
        return result

    def _result_of(self, event: Finished) -> Result | None:
        """Return the result of a sweep; one that is reused is in the store alone."""
        if event.result is not None or event.state != "reused":
            return event.result
        with self._service.open_store() as store:
            return store.result(event.sweep.key)

    def _write_study(self, task: MeasurementTask, loop: FrictionLoop, validation: int) -> Iterator[MeasurementNotice]:
        points = self.files.points()
        spec = {**self._estimator(), "resolution": loop.resolution, "noise": loop.noise}
        if validation:
            spec["validation"] = validation
        section = record_section(self.files.samples, points, self.path.parent, task)
        asked = {"accuracy": self.accuracy.plain()} if self.accuracy != Accuracy() else {}
        task = replace(task, estimators=(spec,), experiment={**task.experiment, **asked})
        data = record_study([task], [section], f"{task.title}, measured autonomously")
        usual, self.path = self.path, renew_study(self.path, data)
        if self.path != usual:
            yield MeasurementNotice(kept_text(usual, self.path))


def _stage_begun(stage: int, what: str) -> StageBegun:
    return StageBegun(f"stage {stage + 1} of {len(STAGES)}, {STAGES[stage]}: {what}", stage, STAGES[stage])


def _level_begun(stage: int, level: int, count: int) -> StageBegun:
    """Return the begin of a level of a stage with so many frequencies."""
    label, levels = f"up to {LEVEL_RATIOS[level]:g} times friction", len(LEVEL_RATIOS)
    place = f"stage {stage + 1} of {len(STAGES)}, {STAGES[stage]}, level {level + 1} of {levels}"
    return StageBegun(f"{place}: {count} frequencies at {label}", stage, label, level, levels)


def _evaluation_begun(stage: int, seconds: float) -> EvaluationBegun:
    what = f"stage {stage + 1} of {len(STAGES)}, {STAGES[stage]}: evaluated while the axis rests"
    what += f", about {seconds:.0f} s" if seconds >= 1 else ""
    return EvaluationBegun(what, stage, seconds)


def _length_text(length: float, is_rotary: bool) -> str:
    if not length:
        return "none"
    factor, unit = displacement_unit(length)
    return f"{factor * length:.3g} {rotary_unit(unit) if is_rotary else unit}"


def _modes(result: Result | None) -> tuple[list[float], list[float]]:
    """Return natural frequencies [Hz] and damping ratios of the plant in a result; none if there is no plant."""
    fits = [fit for fit in result.fits if fit.kind == "plant"] if result else []
    if not fits:
        return [], []
    component = fits[0].component
    return list(component.get("frequencies", ())), list(component.get("damping_ratios", ()))


def _is_good(result: Result | None) -> bool:
    """Return whether there is a result, and it is ok."""
    return result is not None and result.outcome is Outcome.OK


def _knows_law(result: Result | None) -> bool:
    """Return whether a friction law explains the records: what is then still uncertain is near the modes."""
    metrics = result.metrics if result else ()
    return any(metric.name == LAW_METRIC and metric.value == 1 for metric in metrics)


def _summary(result: Result | None, error: str) -> str:
    """Return what was found in one line."""
    if result is None:
        return f"not ok; {error}"
    metrics = {metric.name: metric for metric in result.metrics}
    texts = [
        f"{name} {metrics[name].value:.5g} {metrics[name].unit}".removesuffix(" 1")
        for name in SUMMARY
        if name in metrics
    ]
    return "; ".join(filter(None, ["ok" if _is_good(result) else "not ok", ", ".join(texts), result.message]))
