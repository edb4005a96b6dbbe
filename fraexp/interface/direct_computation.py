"""Experiments that are computed in this process, and what estimators make of them; no database is involved."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from fraexp.components.first_trial import first_trial, friction_specs
from fraexp.components.kinds import Estimator
from fraexp.components.registry import create
from fraexp.data import fit_references
from fraexp.data.results import Result
from fraexp.data.signals import Signals
from fraexp.data.sweep import Plain, Sweep, component_names
from fraexp.errors import StudyError
from fraexp.execution.job import apply_estimator, load_signals
from fraexp.execution.scheduler import StoredFits
from fraexp.execution.sent_jobs import Job
from fraexp.interface.datasets import signals_dataset
from fraexp.interface.run_monitor import computing_meter
from fraexp.interface.sweep_results import SweepResult
from fraexp.store import StoredSweep
from fraexp.study.resolution import resolve_estimator
from fraexp.study.study_file import ResolvedStudy
from fraexp.views.words import plural
from fraexp.workspace.workspace_service import WorkspaceService

if TYPE_CHECKING:
    import xarray

    from fraexp.workspace.workspace_service import WorkspaceService


@dataclass(frozen=True, eq=False)
class Recording:
    """Sampled channels of one experiment: what `fraexp.estimate` takes."""

    signals: Signals
    """The samples, as an estimator gets them (see `fraexp.api.Signals`)."""
    experiment: Plain
    """What was simulated or read, completely resolved."""
    service: "WorkspaceService"
    files: Mapping[str, str] = field(default_factory=dict)
    """Files of a measured record."""

    @property
    def channels(self) -> dict[str, str]:
        """Units of the channels, by name."""
        return dict(self.signals.units)

    @property
    def outcome(self) -> str:
        """``ok``, or what went wrong in the experiment, such as ``diverged``."""
        return self.signals.outcome.name.lower()

    def to_xarray(self) -> "xarray.Dataset":
        """Return all samples over ``sample``, with the coordinates ``time`` [s], ``segment`` and ``period``.

        Each channel is a variable with its unit in the attribute ``units``. FraexpError if xarray is not installed.
        """
        attributes = {"outcome": self.outcome, "message": self.signals.message, "experiment": self.experiment}
        return signals_dataset(self.signals, attributes)

    def __repr__(self) -> str:
        channels = ", ".join(f"{name} [{unit}]" for name, unit in self.signals.units.items())
        source = {"loop": "simulated", "drive": "driven friction law", "record": "measured"}
        kind = source.get(str(self.experiment.get("source")), "")
        return f"<Recording: {kind}, {plural(len(self.signals.segments), 'segment')}, {channels}; {self.outcome}>"


def single_sweep(study: ResolvedStudy) -> Sweep:
    """Return the only sweep of a study; StudyError if it has several."""
    if len(study.sweeps) != 1:
        raise StudyError(f"{study.name}: it has {len(study.sweeps)} sweeps; expected one, run a Study for a grid")
    return study.sweeps[0]


def used_names(sweeps: Iterable[Sweep]) -> set[str]:
    """Return the names of all components that sweeps use."""
    sections: dict[int, object] = {}
    for sweep in sweeps:
        sections |= {id(section): section for section in (*sweep.experiment.values(), sweep.estimator)}
    return {name for section in sections.values() for name in component_names(section)}


def record_signals(experiment: Plain, files: Mapping[str, str], service: WorkspaceService) -> Recording:
    """Simulate or read an experiment; a line of progress is shown while it lasts."""
    experiment = _with_fits(experiment, service)
    with computing_meter(experiment) as progress:
        for spec in friction_specs([experiment]):
            first_trial(spec, service.registry)
        signals = load_signals(Job(experiment, (), files), service.registry, progress)
    return Recording(signals, experiment, service, files)


def _with_fits(experiment: Plain, service: WorkspaceService) -> Plain:
    """Return an experiment in which the components that other sweeps have identified stand for their references."""
    if not any(True for _ in fit_references.references_in(experiment)):
        return experiment
    with service.open_store() as store:
        found: Plain = fit_references.replace_references(experiment, StoredFits(store).component)
        return found


def estimate_signals(recording: Recording, spec: Plain) -> SweepResult:
    """Return the result of an estimator with its numerical certificate."""
    experiment, service = recording.experiment, recording.service
    resolved = resolve_estimator(spec, experiment, service.registry, "estimate")
    estimator = create(service.registry, Estimator, resolved)
    with computing_meter({"estimator": resolved}):
        for friction in friction_specs([resolved]):
            first_trial(friction, service.registry)
        result = apply_estimator(estimator, recording.signals, experiment)
    sweep = Sweep(experiment, resolved, {}, recording.files)
    return SweepResult(_as_stored(sweep, result), result, service)


def _as_stored(sweep: Sweep, result: Result) -> StoredSweep:
    """Return a sweep as the database would, though it is not stored."""
    return StoredSweep(
        key=sweep.key,
        experiment=dict(sweep.experiment),
        estimator=dict(sweep.estimator),
        labels={},
        outcome=result.outcome,
        findings=result.findings,
        elapsed=result.elapsed,
        created=datetime.now(UTC),
        state="computed",
    )
