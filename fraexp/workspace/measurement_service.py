"""Measurements of a workspace: planned, played on a machine, and analysed by an ordinary study of the record."""

from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fraexp import records
from fraexp.components.kinds import Estimator
from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.components.registry import Registry, create
from fraexp.data.results import Result
from fraexp.data.rotary_axes import is_rotary, to_rotary_units
from fraexp.errors import FraexpError, MachineError, StudyError
from fraexp.execution.events import Event
from fraexp.execution.job import apply_estimator
from fraexp.measurement.consent import Consent, missing_consent
from fraexp.measurement.excitation_files import ExcitationTable
from fraexp.measurement.measured_points import MeasuredPoint, MeasurementFiles
from fraexp.measurement.measured_study import played_loop, record_section, record_study, relative_file
from fraexp.measurement.measurement import Measurement, MeasurementEvent, MeasurementNotice, PointMeasured
from fraexp.measurement.measurement_plan import MeasurementPlan, plan_measurement
from fraexp.measurement.play_demands import Report
from fraexp.measurement.point_measurement import noise_band
from fraexp.measurement.tasks import MeasurementTask, measurement_tasks
from fraexp.records.study_writer import is_same_study, renew_study
from fraexp.study.study_file import read
from fraexp.workspace.workspace_service import WorkspaceService


@dataclass(frozen=True)
class PointEstimated:
    """What the estimators of the study find at a point that was just measured."""

    measured: PointMeasured
    results: tuple[Result | str, ...]
    """A result of each estimator, or why it needs more than one point."""


class MeasurementService:
    """The measurement of one study."""

    def __init__(
        self,
        service: WorkspaceService,
        study: str,
        overrides: Sequence[str] = (),
        report: Report = lambda _: None,
        is_trusted: bool = False,
    ) -> None:
        """Read a study; `report` is told how far each plan is, from 0 to 1.

        `is_trusted` allows its machine to run programs and to reach controllers without a question.
        """
        self._report, self._is_trusted = report, is_trusted
        self._service, self._folder = service, service.folder
        self.tasks = measurement_tasks(service.study(study, overrides), service.folder, service.registry, overrides)
        self.path = service.folder / "studies" / f"{self.tasks[0].stem}-measured.toml"
        """The study that analyses the record; once it is written, its own file beside one that was edited."""

    def plans(self) -> list[MeasurementPlan]:
        """Return the plan of each experiment, by the limits that the study states; nothing is connected or played."""
        found = []
        for task in self.tasks:
            with _words_of_its_axis(task):
                found.append(plan_measurement(task, self._service.registry, report=self._report))
        return found

    def files(self, task: MeasurementTask) -> MeasurementFiles:
        """Return the files of an experiment."""
        number = self.tasks.index(task) + 1
        name = task.stem if len(self.tasks) == 1 else f"{task.stem}-{number}"
        return MeasurementFiles(self._folder / "measurements", name)

    def measure(self, fresh: bool = False) -> Generator[MeasurementEvent | PointEstimated | Event, None, None]:
        """Measure all experiments, write the study of the record, and run it.

        What an interrupted measurement has stored is kept, unless `fresh`. Closing the generator stops the machine.
        """
        usual = self.path
        yield from self.measure_points(fresh)
        if self.path != usual:
            yield MeasurementNotice(kept_text(usual, self.path))
        yield from self._service.run([str(self.path.resolve())])

    def measure_points(self, fresh: bool = False) -> Generator[MeasurementEvent | PointEstimated, None, None]:
        """Do the same without running the study of the record."""
        self.check()
        with self.files(self.tasks[0]).locked():
            try:
                for task in self.tasks:
                    yield from self._measure(task, fresh)
            finally:
                self._write_study()

    @property
    def missing_consents(self) -> list[Consent]:
        """What its user has to allow before it can be measured."""
        settings = [task.settings for task in self.tasks if task.settings and not self._is_trusted]
        return missing_consents(settings, self._folder)

    def check(self) -> None:
        """Raise StudyError if the study names no machine, or if that of the record would replace another one."""
        self._check_target()
        for task in self.tasks:
            if task.settings is None:
                missing = StudyError(f"{task.study}: lacks the section [measurement], which names the machine")
                raise missing.at("", "measurement")

    def record_study(self, record: Path, table: ExcitationTable, force: bool) -> tuple[Path, dict[str, Any]]:
        """Return the study that analyses the record of an excitation that is written to a file, and its own file.

        StudyError if a different study is in that file, unless it may be replaced.
        """
        task = self.tasks[0]
        path = self._folder / "studies" / f"{record.stem}.toml"
        rotary = bool(task.experiment["loop"].get("rotary"))
        section = {
            "file": relative_file(record, path.parent),
            "sample_rate": 1 / table.sample_time,
            "channels": {"u": f"u [{table.unit}]", "y": "y [rad]" if rotary else "y [m]"},
            **played_loop(task, table.segments()),
        }
        data = record_study([task], [section], f"{task.title}, recorded")
        if path.exists() and not is_same_study(path, data) and not force:
            raise StudyError(f"{path}: a different study is in this file; choose another record, or use --force")
        return path, data

    def _measure(self, task: MeasurementTask, fresh: bool) -> Generator[MeasurementEvent | PointEstimated, None, None]:
        files, results = self.files(task), list[Result | str]()

        def judge(point: MeasuredPoint) -> float | None:
            results[:] = self.estimate_point(task, point)
            responses = [one.response for one in results if isinstance(one, Result) and one.response is not None]
            bands = [noise_band(response) for response in responses]
            return max((band for band in bands if band is not None), default=None)

        assert task.settings is not None
        measurement = Measurement(task, task.settings, files, self._folder, self._is_trusted)
        with (
            _words_of_its_axis(task),
            closing(measurement.events(self._service.registry, judge, fresh=fresh, report=self._report)) as events,
        ):
            for event in events:
                yield PointEstimated(event, tuple(results)) if isinstance(event, PointMeasured) else event

    def estimate_point(self, task: MeasurementTask, point: MeasuredPoint) -> list[Result | str]:
        """Return what each estimator of the study finds at one point; else why it does not."""
        return results_at(point, self.files(task), self.path.parent, task, self._service.registry)

    def _check_target(self) -> None:
        """Raise StudyError if the study of the record would replace another one."""
        if not self.path.exists():
            return
        data = read(self.path)
        given = [data, *data.get("case", [])]
        names = {str(one.get("record", {}).get("file", "")) for one in given if isinstance(one, dict)}
        if not any(name.endswith(".samples") for name in names):
            raise StudyError(f"{self.path}: another study is in this file; move it away")

    def _write_study(self) -> None:
        """Write the study of all points that have been measured."""
        each = [(task, self.files(task)) for task in self.tasks]
        measured = [(task, files) for task, files in each if files.are_of(task) and files.points()]
        if not measured:
            return
        sections = [record_section(files.samples, files.points(), self.path.parent, task) for task, files in measured]
        data = record_study([task for task, _ in measured], sections, f"{self.tasks[0].title}, measured")
        self.path = renew_study(self.path, data)


def missing_consents(settings: Iterable[MeasurementSettings], folder: Path) -> list[Consent]:
    """Return what a user has to allow before machines can be measured, each once."""
    found = (missing_consent(of.machine, folder) for of in settings)
    return list(dict.fromkeys(consent for consent in found if consent is not None))


def kept_text(edited: Path, written: Path) -> str:
    """Return that an edited study was kept."""
    return f"{edited.name} was edited and is kept; the study of this record is {written.name}"


def results_at(
    point: MeasuredPoint, files: MeasurementFiles, folder: Path, task: MeasurementTask, registry: Registry
) -> list[Result | str]:
    """Return what each estimator of a task finds at one point, read from its file like any record; else why not.

    `folder` is that of the study of the record.
    """
    section = record_section(files.samples, [point], folder, task)
    experiment, paths = records.resolve(records.RecordSettings.parse(section, "record"), folder, registry)
    signals = records.load(experiment, paths, registry)
    found: list[Result | str] = []
    for spec in task.estimators:
        try:
            estimator = create(registry, Estimator, spec)
            found.append(apply_estimator(estimator, signals, task.experiment))
        except FraexpError as error:
            found.append(str(error))
    return found


@contextmanager
def _words_of_its_axis(task: MeasurementTask) -> Iterator[None]:
    """Have errors speak of angles and torques if the axis turns."""
    try:
        yield
    except MachineError as error:
        if is_rotary(task.experiment):
            to_rotary_units(error)
        raise
