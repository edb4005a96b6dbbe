"""The study of a designed excitation: the machine of a sweep, and the excitation that an estimator chose for it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fraexp.components.kinds import Controller, Excitation, FrictionModel, Plant
from fraexp.data.results import Result
from fraexp.errors import FraexpError, StudyError
from fraexp.measurement.measured_study import without_versions
from fraexp.records.study_writer import is_same_study, write_study
from fraexp.store import StoredSweep

MACHINE_SECTIONS = (Plant.kind, FrictionModel.kind, Controller.kind, "loop", "numerics", "compensation")


def write_designed_study(sweep: StoredSweep, result: Result, title: str, path: Path, *, force: bool = False) -> None:
    """Write the study that runs the excitation of a result.

    The machine is that of the sweep; of a measured record, the one that was identified. FraexpError if the result has
    no excitation; StudyError if the file holds another study.
    """
    fitted = {fit.kind: fit.component for fit in result.fits}
    if Excitation.kind not in fitted:
        raise FraexpError(f"design: sweep {sweep.key[4:12]} has no excitation ({result.message}); nothing is written")
    machine = {key: sweep.experiment[key] for key in MACHINE_SECTIONS if sweep.experiment.get(key)}
    for key in MACHINE_SECTIONS:
        if key not in machine and (found := fitted.get(key) or sweep.estimator.get(key)):
            machine[key] = found
    data: dict[str, Any] = {
        "title": title,
        **without_versions(machine),
        Excitation.kind: without_versions(fitted[Excitation.kind]),
        "estimator": without_versions(_method(sweep.estimator)),
    }
    if path.exists() and not is_same_study(path, data) and not force:
        raise StudyError(f"{path}: a different study is in this file; choose another one, or use --force")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_study(path, data)


def _method(estimator: Mapping[str, Any]) -> Mapping[str, Any]:
    method = estimator.get("method")
    return method if isinstance(method, Mapping) else estimator
