"""What a study asks to be measured: its experiments, each with its limits, its machine and its estimators."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.components.registry import Registry
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import Plain, Sweep
from fraexp.errors import FraexpError, StudyError
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.study.study_file import ResolvedStudy, outline

REQUIRED_LIMITS = ("stroke", "velocity", "force")
"""Limits without which nothing is played."""


@dataclass(frozen=True)
class MeasurementTask:
    """An experiment of a study that is played on a machine."""

    study: str
    """Name of the study."""
    title: str
    label: str
    """What tells it from the other experiments of the study; empty if it is the only one."""
    experiment: Plain
    key: str
    """Key of the experiment."""
    limits: MotionLimits
    """Limits that the study states."""
    settings: MeasurementSettings | None
    """None if the study has no section [measurement]."""
    estimators: tuple[Plain, ...]

    @property
    def stem(self) -> str:
        """Name of its files."""
        return self.study.replace("/", "-")


def measurement_tasks(
    study: ResolvedStudy, folder: Path, registry: Registry, overrides: Sequence[str] = ()
) -> list[MeasurementTask]:
    """Return the experiments of a study, in its order; StudyError if one of them cannot be played."""
    cases, grid = outline(study.file, folder, overrides)
    for path in grid:
        if path.partition(".")[0] in ("limits", "measurement"):
            raise StudyError(f"{study.file}, [grid]: '{path}' cannot vary within one measurement; leave it out")
    groups: dict[str, list[Sweep]] = {}
    for sweep in study.sweeps:
        groups.setdefault(sweep.experiment_key, []).append(sweep)
    labelled = {case.get("label", ""): case for case in cases}
    return [
        _task(study, sweeps, _sections(cases, labelled, sweeps[0]), len(groups), registry) for sweeps in groups.values()
    ]


def _sections(cases: Sequence[Plain], labelled: Plain, sweep: Sweep) -> Plain:
    return labelled.get(sweep.labels.get("case", ""), cases[0])


def _task(
    study: ResolvedStudy, sweeps: Sequence[Sweep], sections: Plain, experiments: int, registry: Registry
) -> MeasurementTask:
    first, place = sweeps[0], str(study.file)
    if first.experiment["source"] != "loop":
        raise StudyError(f"{place}: a {first.experiment['source']} cannot be played; expected an excitation of a loop")
    varied = {path: value for path, value in first.labels.items() if path.partition(".")[0] != "estimator"}
    label = ", ".join(f"{path.rpartition('.')[2]} {value}" for path, value in varied.items()) if experiments > 1 else ""
    return MeasurementTask(
        study=study.name,
        title=study.title,
        label=label,
        experiment=first.experiment,
        key=first.experiment_key,
        limits=MotionLimits.parse(sections.get("limits", {}), "limits", rotary=is_rotary(first.experiment)),
        settings=_settings(sections.get("measurement"), first.experiment, registry, place),
        estimators=tuple(sweep.estimator for sweep in sweeps),
    )


def _settings(section: Any, experiment: Plain, registry: Registry, place: str) -> MeasurementSettings | None:
    if section is None:
        return None
    try:
        filled = registry.fill_inherited(MeasurementSettings, section, experiment)
        return MeasurementSettings.parse(filled, "measurement", rotary=is_rotary(experiment))
    except FraexpError as error:
        raise error.at(f"{place}, [measurement]: ", "measurement") from None
