"""The friction model of a law that was fitted, with the covariance of its parameters."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Fit, FrictionModel
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE
from fraexp_plugins.identification.autonomous._shared.law_fit import LawDictionaryFit

DIFFERENCE = 1e-4
"""Relative difference for derivatives."""
UNCERTAIN = {"viscous_coefficient"}
"""Parameters that are not the law's own."""


def law_component(found: LawDictionaryFit, viscous: float, viscous_std: float) -> Fit:
    """Return the friction model with a viscous coefficient [N s/m] and its standard deviation.

    The covariance follows from that of shape and sizes by finite differences. It is as much wider as the interval of
    the Coulomb force is than the one that follows so: errors of a law, as those by the encoder's steps, are not
    independent, and the covariance of records that are says too little of all parameters.
    """
    from dataclasses import replace

    law, sizes = found.choice.best, found.forces
    model, shape = law.elements.model(sizes, viscous), law.elements.shape
    names, units, values = zip(*_numbers(model), strict=True)

    def vary(place: int) -> NDArray[np.float64]:
        """Return the values with one parameter of the fit a little larger."""
        changed = np.concatenate([shape, sizes])
        changed[place] += _step(changed, place, shape.size)
        elements = replace(law.elements, shape=changed[: shape.size])
        return np.array([value for _, _, value in _numbers(elements.model(changed[shape.size :], viscous))])

    whole = np.concatenate([shape, sizes])
    varied = [place for place in range(whole.size) if place < shape.size or whole[place] > 0]
    slopes = np.zeros((len(values), whole.size))
    for place in varied:
        slopes[:, place] = (vary(place) - np.array(values)) / _step(whole, place, shape.size)
    covariance = slopes @ found.choice.covariance @ slopes.T
    if "coulomb_force" in names:  # a sum of elements has none of its own
        force = names.index("coulomb_force")
        known, whole_variance = covariance[force, force], (found.coulomb_error / NORMAL_QUANTILE) ** 2
        covariance *= max(whole_variance / known, 1.0) if known > 0 else 1.0
    own = names.index("viscous_coefficient")
    covariance[own], covariance[:, own] = 0.0, 0.0
    covariance[own, own] = viscous_std**2
    return Fit("friction", model.spec(), names, units, np.array(values), covariance)


def _step(values: NDArray[np.float64], place: int, shapes: int) -> float:
    return DIFFERENCE * (1.0 if place < shapes else max(float(values[place]), 1e-300))


def _numbers(model: FrictionModel) -> Iterator[tuple[str, str, float]]:
    """Yield name, unit and value of each number of a model."""
    for name, field in type(model).model_fields.items():
        declared, value = field.json_schema_extra, getattr(model, name)
        unit = str(declared.get("unit", "")) if isinstance(declared, dict) else ""
        if isinstance(value, tuple):
            yield from ((f"{name}.{place}", unit, float(each)) for place, each in enumerate(value))
        elif isinstance(value, float):
            yield name, unit, value
