"""Models that were identified: fitted to stored responses, and as matrices for other programs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fraexp.components.kinds import Estimator, Plant
from fraexp.components.registry import Registry, create
from fraexp.data import toml
from fraexp.data.results import Fit
from fraexp.data.sweep import Sweep
from fraexp.errors import StudyError, did_you_mean
from fraexp.store import StoredSweep

ROUNDING = 1e-12
"""Coefficients below this share of the greatest one are those of rounding."""
METHOD = "method"
"""Parameter of an estimator that fits: the estimator of the response."""


def estimator(registry: Registry, name: str = "") -> str:
    """Return the name of the estimator that fits a plant: the one of this name, or the one that there is."""
    fitting = [
        known
        for known in registry.names(Estimator.kind)
        if registry.supply(Estimator.kind, known).component.fits  # type: ignore[attr-defined]
    ]
    if name:
        if name not in fitting:
            raise StudyError(f"fit: no estimator that fits is called '{name}'{did_you_mean(name, fitting)}")
        return name
    if len(fitting) != 1:
        raise StudyError(
            f"fit: found {len(fitting)} estimators that fit; choose by --using one of {', '.join(fitting)}"
        )
    return fitting[0]


def wrapped(
    sweeps: Sequence[StoredSweep],
    fitting: str,
    settings: Sequence[str],
    registry: Registry,
    files: Callable[[StoredSweep], Mapping[str, str]],
) -> tuple[Sweep, ...]:
    """Return the sweeps with their estimators inside of the one that fits, which keeps what a study's own fit had set.

    A setting without a value, such as ``modes=``, is the default.
    """
    given = dict(_setting(text) for text in settings)
    found = []
    for sweep in sweeps:
        inner = sweep.estimator[METHOD] if sweep.estimator["name"] == fitting else sweep.estimator
        place = f"fit of {sweep.key[4:12]}"
        environment = {key: value for key, value in sweep.experiment.items() if key != "source"}
        wanted = {"name": fitting, METHOD: inner, **taken_over(sweep, fitting, (), registry), **given}
        wanted = {key: value for key, value in wanted.items() if value is not None}
        spec = registry.create(Estimator.kind, wanted, environment, place).spec()
        labels = sweep.labels or {"fit of": sweep.key[4:12]}
        found.append(Sweep(sweep.experiment, spec, labels, files(sweep)))
    return tuple({sweep.key: sweep for sweep in found}.values())


def taken_over(sweep: StoredSweep, fitting: str, settings: Sequence[str], registry: Registry) -> dict[str, Any]:
    """Return what a sweep's own fit had set other than the default, without what `settings` give anew."""
    if sweep.estimator["name"] != fitting:
        return {}
    anew = {METHOD, *(_setting(text)[0] for text in settings)}
    parameters = registry.supply(Estimator.kind, fitting).component.model_fields
    return {
        name: value
        for name, value in sweep.estimator.items()
        if name in parameters and name not in anew and value is not None and value != parameters[name].default
    }


def _setting(text: str) -> tuple[str, Any]:
    """Return path and value of a setting; None, which stands for the default, if it has none."""
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise StudyError(f"--set {text}: expected PARAMETER=VALUE, such as modes=2")
    if not value.strip():
        return path.strip(), None
    try:
        return path.strip(), toml.value(value)
    except ValueError:
        return path.strip(), value.strip()


def matrices(fit: Fit, registry: Registry) -> dict[str, Any]:
    """Return ẋ = A x + B u, y = C x, and P(s) in descending powers of s, of a fitted plant, and its dead time."""
    plant = create(registry, Plant, fit.component).state_space()  # type: ignore[type-abstract]
    denominator = np.poly(plant.a)
    numerator = np.poly(plant.a - np.outer(plant.b, plant.c)) - denominator  # det(sI - A + BC) - det(sI - A)
    numerator[np.abs(numerator) < ROUNDING * np.abs(numerator).max()] = 0.0  # below the relative degree
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
