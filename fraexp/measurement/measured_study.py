"""The study that analyses what was measured: an ordinary study of a record."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fraexp.data.sample_file import read_header
from fraexp.errors import StudyError
from fraexp.measurement.measured_points import PLAY_COLUMN, MeasuredPoint
from fraexp.measurement.tasks import MeasurementTask

CHANNEL_ORDER = ("u", "y")
"""Channels that come first: the input, then the output."""


def record_section(
    samples: Path, points: Sequence[MeasuredPoint], folder: Path, task: MeasurementTask
) -> dict[str, Any]:
    """Return the section [record] for points of a task in a file of samples, of a study in `folder`."""
    names = [name for name in read_header(samples)[0].units if name != PLAY_COLUMN]
    names.sort(key=lambda name: CHANNEL_ORDER.index(name) if name in CHANNEL_ORDER else len(CHANNEL_ORDER))
    segments = [point.as_segment() for point in points]
    channels = {name: name for name in names}
    return {"file": relative_file(samples, folder), "channels": channels, **played_loop(task, segments)}


def played_loop(task: MeasurementTask, segments: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the keys of [record] with the segments that were played, and the controller whose answer to y is in u.

    If more than that is in u, nothing can be compared: then neither controller nor excitation is stated.
    """
    controller = task.experiment.get("controller", {})
    if "name" in controller and "compensation" not in task.experiment:
        return {"controller": without_versions(controller), "segments": [dict(one) for one in segments]}
    return {"segments": [{key: one[key] for key in one if key != "excitation"} for one in segments]}


def relative_file(file: Path, folder: Path) -> str:
    """Return the name of a file as a study in a folder writes it."""
    return Path(os.path.relpath(file.absolute(), folder.resolve())).as_posix()


def record_study(tasks: Sequence[MeasurementTask], records: Sequence[Mapping[str, Any]], title: str) -> dict[str, Any]:
    """Return the study that analyses the record of each task by the estimators, and to the accuracy, of its study."""
    estimators = tasks[0].estimators
    if any(task.estimators != estimators for task in tasks):
        raise StudyError(
            f"{tasks[0].study}: its experiments have different estimators; measure them one at a time, with --set"
        )
    specs = [without_versions(spec) for spec in estimators]
    limits = {name: value for name, value in tasks[0].limits.plain().items() if value is not None}
    several = {"grid": {"estimator": specs}} if len(specs) > 1 else {"estimator": specs[0]}
    several |= {"limits": limits} if limits else {}
    several |= {name: dict(tasks[0].experiment[name]) for name in ("accuracy",) if name in tasks[0].experiment}
    if len(tasks) == 1:
        return {"title": title, "record": dict(records[0]), **several}
    cases = [{"label": task.label, "record": dict(record)} for task, record in zip(tasks, records, strict=True)]
    return {"title": title, **several, "case": cases}


def without_versions(spec: Any) -> Any:
    """Return components in plain data as a study writes them: without versions, and without what is not given."""
    if isinstance(spec, Mapping):
        named = "name" in spec
        kept = {key: value for key, value in spec.items() if value is not None and not (named and key == "version")}
        return {key: without_versions(value) for key, value in kept.items()}
    return [without_versions(one) for one in spec] if isinstance(spec, list | tuple) else spec
