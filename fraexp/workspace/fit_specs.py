"""Estimators that fit stored responses, fitted plants as matrices, and the study of a designed excitation."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.kinds import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.components.registry import Registry, create
from fraexp.data import toml
from fraexp.data.results import Fit, Result
from fraexp.data.sweep import Sweep
from fraexp.errors import FraexpError, StudyError, did_you_mean
from fraexp.measurement.measured_study import without_versions
from fraexp.records.study_writer import is_same_study, write_study
from fraexp.store import StoredSweep

COEFFICIENT_ROUNDING = 1e-12
"""Coefficients below this fraction of the greatest one are rounding."""
METHOD_PARAMETER = "method"
"""Parameter of a fitting estimator that holds the estimator of the response."""


def fit_estimator(registry: Registry, name: str = "", kind: str = Plant.kind) -> str:
    """Return the name of the estimator that fits a component of a kind: the given one, or the only one."""
    estimators = {known: registry.provider(Estimator.kind, known).component for known in registry.names(Estimator.kind)}
    fitting = [
        known for known, component in estimators.items() if issubclass(component, Estimator) and component.fits == kind
    ]
    if name:
        if name not in fitting:
            raise StudyError(f"fit: no fitting estimator is called '{name}'{did_you_mean(name, fitting)}")
        return name
    if len(fitting) != 1:
        raise StudyError(
            f"fit: found {len(fitting)} fitting estimators; choose one with --estimator: {', '.join(fitting)}"
        )
    return fitting[0]


def as_fit_sweeps(
    sweeps: Sequence[StoredSweep],
    fitting: str,
    settings: Sequence[str],
    registry: Registry,
    files: Callable[[StoredSweep], Mapping[str, str]],
) -> tuple[Sweep, ...]:
    """Return the sweeps with their estimators inside the fitting one, which inherits the settings of a study's own fit.

    A setting without a value, such as ``modes=``, restores the default.
    """
    given = dict(_parse_setting(text) for text in settings)
    found = []
    for sweep in sweeps:
        inner = sweep.estimator[METHOD_PARAMETER] if sweep.estimator["name"] == fitting else sweep.estimator
        place = f"fit of {sweep.key[4:12]}"
        environment = {key: value for key, value in sweep.experiment.items() if key != "source"}
        wanted = {
            "name": fitting,
            METHOD_PARAMETER: inner,
            **inherited_fit_settings(sweep, fitting, (), registry),
            **given,
        }
        wanted = {key: value for key, value in wanted.items() if value is not None}
        spec = registry.create(Estimator.kind, wanted, environment, place).spec()
        labels = sweep.labels or {"fit of": sweep.key[4:12]}
        found.append(Sweep(sweep.experiment, spec, labels, files(sweep)))
    return tuple({sweep.key: sweep for sweep in found}.values())


def inherited_fit_settings(
    sweep: StoredSweep, fitting: str, settings: Sequence[str], registry: Registry
) -> dict[str, object]:
    """Return the settings of a sweep's own fit that differ from the defaults and are not in `settings`."""
    if sweep.estimator["name"] != fitting:
        return {}
    anew = {METHOD_PARAMETER, *(_parse_setting(text)[0] for text in settings)}
    parameters = registry.provider(Estimator.kind, fitting).component.model_fields
    return {
        name: value
        for name, value in sweep.estimator.items()
        if name in parameters and name not in anew and value is not None and value != parameters[name].default
    }


def _parse_setting(text: str) -> tuple[str, object]:
    """Return path and value of a setting; the value None stands for the default."""
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise StudyError(f"--set {text}: expected PARAMETER=VALUE, such as modes=2")
    return path.strip(), toml.value(value) if value.strip() else None


def matrices(fit: Fit, registry: Registry) -> dict[str, object]:
    """Return ẋ = A x + B u, y = C x, P(s) in descending powers of s, and the dead time of a fitted plant."""
    plant = create(registry, Plant, fit.component).state_space()
    denominator = np.poly(plant.a)
    numerator = np.poly(plant.a - np.outer(plant.b, plant.c)) - denominator  # det(sI - A + BC) - det(sI - A)
    numerator[np.abs(numerator) < COEFFICIENT_ROUNDING * np.abs(numerator).max()] = 0.0  # below the relative degree
    known = dict(zip(fit.parameters, fit.values, strict=True))
    return {
        "a": plant.a,
        "b": plant.b[:, None],
        "c": plant.c[None, :],
        "d": np.zeros((1, 1)),
        "numerator": numerator,
        "denominator": denominator,
        "dead_time": float(known.get("dead_time", 0.0)),
    }


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
