"""The job of a worker: an experiment is simulated or read once, and all its estimators are applied to it."""

import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from fraexp.components.first_trial import first_trial, friction_specs
from fraexp.components.kinds import Estimator, Excitation, FrictionModel
from fraexp.components.registry import Registry, create, discover
from fraexp.data.findings import Finding
from fraexp.data.results import UNUSABLE_OUTCOMES, Result
from fraexp.data.rotary_axes import are_rotary, as_linear, is_rotary, rotary_result, rotary_signals, to_rotary_units
from fraexp.data.signals import Signals
from fraexp.data.sweep import Plain
from fraexp.errors import FraexpError, PluginError, RecordError
from fraexp.execution.sent_jobs import Failure, Job
from fraexp.execution.verdict import certify, judge
from fraexp.kernels.announcement import compilation_listener
from fraexp.kernels.law_error import LawError
from fraexp.simulation import loop
from fraexp.simulation.machine import Numerics, build_machine
from fraexp.study.accuracy import Accuracy

ReportProgress = Callable[[float], None]
"""Called with the fraction of the experiment that is done."""
ReportEstimator = Callable[[int], None]
"""Called with the index of the estimator that begins."""
ReportCompilation = Callable[[str], None]
"""Called with the names of the friction laws that are about to be compiled, and with none when they are."""


def run_job(
    job: Job,
    progress: ReportProgress,
    begins: ReportEstimator = lambda _: None,
    compiles: ReportCompilation = lambda _: None,
) -> list[Result | Failure]:
    """Return the result or the failure of each estimator, in their order."""
    with compilation_listener(lambda begins: compiles(_law_names(job) if begins else "")):
        return _run_job(job, progress, begins)


def _run_job(job: Job, progress: ReportProgress, begins: ReportEstimator) -> list[Result | Failure]:
    began = time.perf_counter()
    try:
        registry = job_registry(job)
        for spec in friction_specs([job.experiment, *job.estimators]):
            first_trial(spec, registry)
        signals = load_signals(job, registry, progress)
    except Exception as error:  # a plugin or a file may raise anything; the other experiments go on
        if is_rotary(job.experiment):
            to_rotary_units(error)
        return [describe_failure(error)] * len(job.estimators)
    shared = (time.perf_counter() - began) / len(job.estimators)
    answers = []
    for number, estimator in enumerate(job.estimators):
        begins(number)
        answers.append(_estimate(registry, estimator, signals, shared, job.experiment))
    return answers


def _law_names(job: Job) -> str:
    """Return the names of the friction laws that a job uses, as the user reads them."""
    names = dict.fromkeys(str(spec["name"]) for spec in friction_specs([job.experiment, *job.estimators]))
    return " and ".join(f"'{name}'" for name in names) or "of the study"


def job_registry(job: Job) -> Registry:
    """Return the components for a job; PluginError if a local plugin that it uses is another than its run has read."""
    if _changed_source(job, registry_of(job.plugins)):
        registry_of.cache_clear()  # this process has read them before they were edited
    registry = registry_of(job.plugins)
    changed = _changed_source(job, registry)
    if changed:
        kind, _, name = changed.partition(":")
        raise PluginError(f"{kind} '{name}' was changed after the run had read it; run the study again")
    return registry


def _changed_source(job: Job, registry: Registry) -> str:
    """Return the first component of a job, as ``kind:name``, whose source is another here; empty if there is none."""
    for name, source in job.sources.items():
        kind, _, of = name.partition(":")
        provider = registry.providers.get((kind, of))
        if provider is None or provider.source_hash != source:
            return name
    return ""


@cache
def registry_of(folder: str) -> Registry:
    """Return the components of a plugins folder, which each process reads once; an empty text stands for no folder."""
    return discover(Path(folder) if folder else None)


def load_signals(job: Job, registry: Registry, progress: ReportProgress) -> Signals:
    """Return the signals of an experiment: a simulated loop, a driven friction model, or a record."""
    if job.experiment["source"] == "record":
        from fraexp import records  # most experiments are simulated

        return records.load(job.experiment, job.files, registry)
    signals = _simulate(job.experiment, registry, progress)
    return rotary_signals(signals) if is_rotary(job.experiment) else signals


def _simulate(experiment: Plain, registry: Registry, progress: ReportProgress) -> Signals:
    excitation = create(registry, Excitation, experiment["excitation"])
    if experiment["source"] == "drive":
        friction = create(registry, FrictionModel, experiment["friction"])
        return loop.drive_friction(friction, excitation, experiment["loop"]["sample_time"])
    return loop.simulate_loop(build_machine(experiment, registry), excitation, progress)


def _estimate(registry: Registry, spec: Plain, signals: Signals, shared: float, experiment: Plain) -> Result | Failure:
    began = time.perf_counter()
    try:
        estimator = create(registry, Estimator, spec)
        result = apply_estimator(estimator, signals, experiment)
    except Exception as error:  # as above: the other estimators go on
        return describe_failure(error)
    return replace(
        result,
        metrics=result.metrics + signals.metrics,
        numerics=signals.numerics,
        elapsed=shared + time.perf_counter() - began,
    )


def apply_estimator(estimator: Estimator, signals: Signals, experiment: Plain) -> Result:
    """Return what an estimator learns from signals, certified and judged as their experiment says.

    Estimators know straight axes only: what they get and return is translated if the signals are those of a rotary one.
    PluginError if an estimator returns no Result.
    """
    if not are_rotary(signals.units.values()):
        return _apply_linear(estimator, signals, experiment)
    try:
        return rotary_result(_apply_linear(estimator, as_linear(signals), experiment))
    except FraexpError as error:
        to_rotary_units(error)
        raise


def _apply_linear(estimator: Estimator, signals: Signals, experiment: Plain) -> Result:
    if signals.are_stated and not estimator.takes_responses:
        raise RecordError(
            f"{estimator.name} needs samples over time, and the record is a response that was measured elsewhere; use "
            "an estimator of responses to sines, such as the one that fraexp import takes by itself"
        )
    if signals.outcome not in UNUSABLE_OUTCOMES:
        signals.check_values()
    estimator = estimator.resolve_for(signals)
    result = estimator.estimate(signals)
    if not isinstance(result, Result):
        raise PluginError(f"{estimator.name} returns {result!r:.60}; expected a Result")
    if not all(isinstance(found, Finding) for found in result.findings):
        raise PluginError(f"{estimator.name} returns findings that are {result.findings!r:.60}; expected Findings")
    wrong = [each for each in signals.findings if each.error and each not in result.findings]
    result = result.with_findings(*wrong)  # an estimator need not pass on what is wrong with its signals
    tolerance = float(experiment.get("numerics", {}).get("tolerance", Numerics().tolerance))
    accuracy = Accuracy.parse(experiment.get("accuracy", {}), "accuracy")
    return judge(certify(estimator, signals, result, tolerance), accuracy, estimator)


def describe_failure(error: BaseException) -> Failure:
    """Return an error as a Failure: its sentence, with the place in the code if it is not an error of fraexp."""
    log = "".join(traceback.format_exception(error))
    text = str(error).splitlines()[0] if str(error) else ""
    if isinstance(error, FraexpError | LawError):
        return Failure(text, log)
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return Failure(f"{type(error).__name__}: {text}{place}", log, isinstance(error, MemoryError))
