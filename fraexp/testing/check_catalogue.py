"""Which checks apply to which kind of component: the one list, the cheap ones and the most telling ones first."""

from collections.abc import Callable
from typing import Any

from fraexp.components.kinds import (
    Component,
    Controller,
    Estimator,
    Excitation,
    FrictionModel,
    Plant,
    RecordReader,
)
from fraexp.testing import of_any, of_friction, of_laws, of_observers, of_parts, of_results
from fraexp.testing.conformance_check import Check, of_class, of_examples
from fraexp.testing.examples import strategy
from fraexp.testing.walk import drives, turns

ANY = (
    of_class(of_any.units),
    of_class(of_any.source),
    of_class(of_any.presets),
)
FRICTION = (
    of_examples(of_laws.finite, drives, 20, quick=6),
    of_examples(of_laws.state_size, drives, 15, quick=6),
    of_examples(of_laws.rest, strategy, 10, quick=3),
    of_examples(of_laws.trial, drives, 12, quick=4),
    of_examples(of_laws.odd, drives, 25, quick=10),
    of_examples(of_laws.present, drives, 12, quick=5),
    of_examples(of_laws.bound, drives, 25, quick=6),
    of_examples(of_laws.stiffness, drives, 15, quick=5),
    of_examples(of_laws.monotone, drives, 15, quick=5),
    of_examples(of_laws.limits, strategy, 5, quick=2),
    of_examples(of_any.plain_data, strategy, 10, quick=3),
    # from here on the force is the compiled one, unless the check is to be quick
    of_examples(of_laws.compiled, drives, 20, is_compiled=True),
    of_examples(of_laws.translation, drives, 12, quick=3, is_compiled=True),
    of_examples(of_laws.order, drives, 6, quick=3, is_compiled=True),
    of_examples(of_friction.continuous, of_friction.waves, 12, quick=2, is_compiled=True),
    of_examples(of_friction.refinement, of_friction.waves, 12, quick=2, is_compiled=True),
    of_examples(of_friction.energy, of_friction.closed, 100, quick=8, is_compiled=True),
    of_examples(of_friction.elsewhere, turns, 1, is_compiled=True),
    of_examples(of_observers.observer, of_observers.exposures, 4, is_compiled=True),
)
PARTS: dict[type[Component], tuple[Callable[[Any], None], ...]] = {
    Plant: (of_parts.shapes, of_parts.realisation, of_parts.relative_degree),
    Controller: (of_parts.causal, of_parts.coefficients),
    Excitation: (of_parts.whole_periods, of_parts.schedule, of_parts.refuses, of_parts.repeatable),
}
RESULTS = (of_results.linear_plant, of_results.result_units, of_results.covariance, of_results.outcome)
READERS = (of_results.suffixes, of_results.foreign_file)


def quick_checks_for(component: type[Component]) -> list[Check]:
    """Return the checks that apply to a component class and take plain Python no time worth mentioning."""
    return [check.quick() for check in checks_for(component) if check.quick_examples]


def checks_for(component: type[Component]) -> list[Check]:
    """Return the checks that apply to a component class, the cheap ones first."""
    if issubclass(component, FrictionModel):
        return [*ANY, *FRICTION]
    if issubclass(component, Estimator):
        return [*ANY, *(of_class(body, is_compiled=True) for body in RESULTS)]
    if issubclass(component, RecordReader):
        return [ANY[0], *map(of_class, READERS)]  # a reader follows a file format, not the literature
    bodies = next((bodies for kind, bodies in PARTS.items() if issubclass(component, kind)), ())
    return [*ANY, *(of_examples(body, strategy, 20, quick=5) for body in (of_any.plain_data, *bodies))]
