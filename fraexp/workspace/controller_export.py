"""The controller of a stored sweep as a file: C99 or Structured Text."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from fraexp.components.kinds import Controller, Excitation, FrictionModel
from fraexp.components.registry import Registry, create
from fraexp.components.translation.c_code import c_text
from fraexp.components.translation.structured_text import st_text
from fraexp.data.results import Outcome, Result
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import components_by_port
from fraexp.errors import FraexpError, StudyError
from fraexp.figures.result_files import write_file
from fraexp.simulation.controller_blocks import ControllerParts
from fraexp.simulation.discretisation import SignalPath
from fraexp.simulation.experiments import Compensation
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.store import StoredSweep
from fraexp.study.study_file import outline
from fraexp.workspace.workspace_folder import WorkspaceFolder

CODE_WRITERS = {".c": c_text, ".h": c_text, ".st": st_text}
"""What writes code, by suffix."""
CONTROLLER_SUFFIXES = tuple(CODE_WRITERS)
STATES_NOTE = "All states are 0 before the first call. Call each block once per sample, with the inputs of that sample."
TUNED_SAMPLE_TIME, TUNED_DEAD_TIME = "loop sample time", "loop dead time"
"""Metrics of tuned gains that say for which sample time and dead time of both directions they are."""
IDENTIFIED_DEAD_TIME = "input_dead_time"
"""Metric of an identification: the dead time that it found before the plant, all of it."""
IDENTIFIED_LAG = "input_time_constant"
"""Metric of an identification: the time constant of a lag before the plant that it found beside the known ones."""
UNTRUSTED = (Outcome.INACCURATE, Outcome.NOT_SETTLED)
"""Outcomes of results whose message is part of what is written."""


def export_controller(
    service: WorkspaceFolder,
    sweep: StoredSweep,
    result: Result,
    path: Path,
    *,
    is_single: bool = False,
    force: bool = False,
) -> None:
    """Write the controller of a sweep in the language of the file's suffix; its limit is that of the sweep's study.

    FraexpError if the sweep has neither friction nor feedback, or the file cannot be written; PluginError names the
    line of a law that cannot be translated.
    """
    limit, origin = stated_force_limit(service, sweep)
    parts = replace(controller_parts(sweep, result, service.registry), force_limit=limit)
    name = re.sub(r"\W+", "_", path.stem, flags=re.ASCII).strip("_").lower() or "axis"
    name = name if name[0].isalpha() else f"axis_{name}"
    blocks = parts.blocks()
    if not blocks:
        raise FraexpError(
            f"{path.name}: sweep {sweep.key[4:12]} has no friction model and no feedback; expected a "
            "simulated machine, or a result that identified friction"
        )
    text = CODE_WRITERS[path.suffix.lower()](blocks, name, [*_notes(sweep, result), *origin, STATES_NOTE], is_single)
    write_file(path, lambda draft: draft.write_text(text, encoding="utf-8"), force=force)


def stated_force_limit(service: WorkspaceFolder, sweep: StoredSweep) -> tuple[float | None, list[str]]:
    """Return `limits.force` [N] of the latest study of the sweep's experiment that states it, and a note of its file.

    None without a note if no study states it.
    """
    with service.open_store() as store:
        for run in sorted(store.runs(), key=lambda run: run.number, reverse=True):
            file = Path(run.study_file)
            if file.is_file() and any(of.experiment == sweep.experiment for of in store.sweeps(run.number)):
                with suppress(StudyError):  # it has changed since
                    cases, _ = outline(file, service.folder)
                    rotary = is_rotary(sweep.experiment)
                    limits = [MotionLimits.parse(case.get("limits", {}), "limits", rotary=rotary) for case in cases]
                    if found := [each.force for each in limits if each.force is not None]:
                        return min(found), [f"The force limit is limits.force of {file.name}, as it is now."]
    return None, []


def _notes(sweep: StoredSweep, result: Result) -> list[str]:
    doubt = [f"Caution: {result.message}"] if result.message and result.outcome in UNTRUSTED else []
    return [f"Sweep {sweep.key}, written by fraexp export. SI units.", *doubt]


def controller_parts(sweep: StoredSweep, result: Result, registry: Registry) -> ControllerParts:
    """Return what a sweep knows of a controller: what it identified or tuned comes before what it was given."""
    fitted = {fit.kind: fit.component for fit in result.fits}
    experiment, estimator = sweep.experiment, _innermost(sweep.estimator)
    loop: Mapping[str, Any] = experiment.get("loop", {})
    excitation = experiment.get("excitation")
    controller = fitted.get(Controller.kind) or experiment.get("controller")
    if several := components_by_port(controller):
        raise FraexpError(
            f"the machine has a controller for each of several thrusts ({', '.join(several)}); expected one: export "
            "each from a study of its own, with it as [controller] and its thrust as loop.thrust"
        )
    metrics = {metric.name: metric.value for metric in result.metrics}
    sample_time = metrics.get(TUNED_SAMPLE_TIME) or loop.get("sample_time")
    motion = create(registry, Excitation, excitation) if excitation else None
    input_path, output_path = _path("input", estimator, loop), _path("output", estimator, loop)
    if TUNED_DEAD_TIME in metrics:
        input_path = input_path._replace(dead_time=metrics[TUNED_DEAD_TIME] - output_path.dead_time)
    elif IDENTIFIED_DEAD_TIME in metrics:
        input_path = input_path._replace(dead_time=metrics[IDENTIFIED_DEAD_TIME])
    if IDENTIFIED_LAG in metrics:
        input_path = input_path._replace(lags=(*input_path.lags, metrics[IDENTIFIED_LAG]))
    compensation = experiment.get("compensation")
    return ControllerParts(
        friction=_friction(fitted.get(FrictionModel.kind), estimator, experiment, registry),
        controller=create(registry, Controller, controller) if controller else None,
        sample_time=sample_time,
        input_path=input_path,
        output_path=output_path,
        feedforward=motion.feedforward(sample_time) if motion and sample_time else None,
        compensation=Compensation.parse(registry.fill_inherited(Compensation, compensation, {}), "compensation")
        if compensation
        else None,
        units=("N m", "rad") if is_rotary(experiment) else ("N", "m"),
    )


def _innermost(estimator: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the estimator of the response that others fit."""
    while isinstance(estimator.get("method"), Mapping):
        estimator = estimator["method"]
    return estimator


def _path(end: str, estimator: Mapping[str, Any], loop: Mapping[str, Any]) -> SignalPath:
    """Return dead time and lags of the input or the output, as the estimator knows them, or else the loop."""
    source = estimator if f"{end}_dead_time" in estimator else loop
    lags = source.get(f"{end}_time_constants", ())
    return SignalPath(float(source.get(f"{end}_dead_time", 0.0)), tuple(map(float, lags)))


def _friction(
    fitted: Mapping[str, Any] | None, estimator: Mapping[str, Any], experiment: Mapping[str, Any], registry: Registry
) -> FrictionModel | None:
    """Return the friction model that was identified, that of the observer, or that of the simulated machine."""
    for spec in (fitted, estimator.get("friction"), experiment.get("friction")):
        if isinstance(spec, Mapping):
            if components_by_port(spec):
                raise FraexpError("the machine has several contacts with friction; expected one: export from its fit")
            return create(registry, FrictionModel, spec)
    return None
