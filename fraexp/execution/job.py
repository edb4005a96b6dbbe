"""The one function that is sent to workers: an experiment is simulated or read once, and estimated by all that ask."""

import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from fraexp import records
from fraexp.components.first_trial import first_trial
from fraexp.components.kinds import Estimator, Excitation, FrictionModel
from fraexp.components.registry import Registry, create, discover
from fraexp.data.results import Result, Timing
from fraexp.data.signals import Signals
from fraexp.data.sweep import Plain, component_names
from fraexp.errors import FraexpError, PluginError
from fraexp.kernels.announcement import announced
from fraexp.kernels.law_error import LawError
from fraexp.simulation import loop
from fraexp.simulation.machine import build_machine

Progress = Callable[[float], None]
"""Is told the fraction of the experiment that is done."""
Begins = Callable[[int], None]
"""Is told which estimator begins."""
Compiles = Callable[[str], None]
"""Is told which friction law is about to be compiled."""


@dataclass(frozen=True)
class Job:
    """The sweeps that share an experiment, as plain data."""

    experiment: Plain
    estimators: tuple[Plain, ...]
    files: Mapping[str, str] = field(default_factory=dict)
    plugins: str = ""
    """Folder of the workspace's own plugins; empty for none."""


@dataclass(frozen=True)
class Failure:
    """Why a sweep gave no result: a sentence for people, and the traceback for the log."""

    message: str
    log: str


def perform(
    job: Job, progress: Progress, begins: Begins = lambda _: None, compiles: Compiles = lambda _: None
) -> list[Result | Failure]:
    """Return a result or a failure per estimator, in their order."""
    with announced(lambda: compiles(_laws(job))):
        return _performed(job, progress, begins)


def _performed(job: Job, progress: Progress, begins: Begins) -> list[Result | Failure]:
    began, computing = time.perf_counter(), time.thread_time()
    is_warm = _has_done(job.experiment)
    try:
        registry = registry_of(job.plugins)
        for spec in _friction_models([job.experiment, *job.estimators]):
            first_trial(spec, registry)
        signals = source(job, registry, progress)
    except Exception as error:  # whatever a plugin or a file does, the other experiments go on
        return [failure(error)] * len(job.estimators)
    shared = (time.perf_counter() - began) / len(job.estimators)
    timing = Timing(time.thread_time() - computing, len(job.estimators), 0.0, (is_warm, False))
    answers = []
    for number, estimator in enumerate(job.estimators):
        begins(number)
        answers.append(_estimate(registry, estimator, signals, shared, timing))
    return answers


def _laws(job: Job) -> str:
    """Return the names of the friction laws that a job uses, for people."""
    names = dict.fromkeys(str(spec["name"]) for spec in _friction_models([job.experiment, *job.estimators]))
    return " and ".join(f"'{name}'" for name in names) or "of the study"


def _friction_models(value: Any) -> Iterator[Plain]:
    """Yield all friction models in plain data."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            if key == "friction" and isinstance(part, Mapping) and "name" in part:
                yield part
            yield from _friction_models(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _friction_models(part)


_DONE: set[tuple[str, ...]] = set()
"""Names of the components with which this process has computed something."""


def _has_done(spec: Plain) -> bool:
    """Say whether this process has computed with these components before, and remember that it has now."""
    names = tuple(component_names(spec))
    if names in _DONE:
        return True
    _DONE.add(names)
    return False


@cache
def registry_of(folder: str) -> Registry:
    """Return the components of a plugins folder, found once by each process; an empty folder stands for none."""
    return discover(Path(folder) if folder else None)


def source(job: Job, registry: Registry, progress: Progress) -> Signals:
    """Return the signals of an experiment: of the simulated loop, of a driven friction model, or of a record."""
    experiment = job.experiment
    if experiment["source"] == "record":
        return records.load(experiment, job.files, registry)
    excitation = create(registry, Excitation, experiment["excitation"])  # type: ignore[type-abstract]
    if experiment["source"] == "drive":
        friction = create(registry, FrictionModel, experiment["friction"])
        return loop.drive_friction(friction, excitation, experiment["loop"]["sample_time"])
    return loop.simulate_loop(build_machine(experiment, registry), excitation, progress)


def _estimate(registry: Registry, spec: Plain, signals: Signals, shared: float, timing: Timing) -> Result | Failure:
    began, computing = time.perf_counter(), time.thread_time()
    is_warm = _has_done(spec)
    try:
        estimator = create(registry, Estimator, spec)  # type: ignore[type-abstract]
        result = estimator.estimate(signals)
        if not isinstance(result, Result):
            raise PluginError(f"{estimator.name} returns {result!r:.60}; expected a Result")
    except Exception as error:  # as above: one estimator's failure is its own
        return failure(error)
    return replace(
        result,
        metrics=result.metrics + signals.metrics,
        numerics=signals.numerics,
        elapsed=shared + time.perf_counter() - began,
        timing=replace(timing, estimator=time.thread_time() - computing, is_warm=(timing.is_warm[0], is_warm)),
    )


def failure(error: BaseException) -> Failure:
    """Return what an error is to people: its sentence, with the place if it is none of ours."""
    log = "".join(traceback.format_exception(error))
    text = str(error).splitlines()[0] if str(error) else ""
    if isinstance(error, FraexpError | LawError):
        return Failure(text, log)
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return Failure(f"{type(error).__name__}: {text}{place}", log)
