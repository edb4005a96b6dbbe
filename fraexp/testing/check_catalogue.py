"""Which checks apply to which kind of component: the one list, the cheap ones and those that say most come first."""

from collections.abc import Callable
from typing import Any

from fraexp.components.kinds import (
    Component,
    Controller,
    Estimator,
    Excitation,
    FrictionModel,
    MachineDriver,
    Plant,
    RecordReader,
)
from fraexp.testing import component_checks, result_checks
from fraexp.testing import friction_law_checks as friction
from fraexp.testing.conformance_check import Check
from fraexp.testing.examples import strategy
from fraexp.testing.walk import drive_strategy

ANY_KIND = (Check(component_checks.units), Check(component_checks.source), Check(component_checks.presets))
FRICTION = (
    Check(friction.finite, drive_strategy, 20, 6),
    Check(friction.pure, strategy, 2, 1),
    Check(friction.state_size, drive_strategy, 15, 6),
    Check(friction.rest, strategy, 10, 3),
    Check(friction.trial, drive_strategy, 12, 4),
    Check(friction.odd, drive_strategy, 25, 10),
    Check(friction.present, drive_strategy, 12, 5),
    Check(friction.bound, drive_strategy, 25, 6),
    Check(friction.stiffness, drive_strategy, 15, 5),
    Check(friction.monotone, drive_strategy, 15, 5),
    Check(friction.limits, strategy, 5, 2),
    Check(component_checks.plain_data, strategy, 10, 3),
    # from here on the force is the compiled one, unless the check is to be quick
    Check(friction.compiled, drive_strategy, 20, 0, is_compiled=True),
    Check(friction.translation, drive_strategy, 12, 3, is_compiled=True),
    Check(friction.continuous, friction.wave_strategy, 12, 2, is_compiled=True),
    Check(friction.refinement, friction.wave_strategy, 12, 2, is_compiled=True),
    Check(friction.energy, friction.closed_path_strategy, 100, 8, is_compiled=True),
    Check(friction.endurance, strategy, 4, 0, is_compiled=True),
    Check(result_checks.observer, result_checks.exposure_strategy, 4, 0, is_compiled=True),
)
PARTS: dict[type[Component], tuple[Callable[[Any], None], ...]] = {
    Plant: (component_checks.shapes, component_checks.realisation, component_checks.relative_degree),
    Controller: (component_checks.causal, component_checks.coefficients),
    Excitation: (
        component_checks.whole_periods,
        component_checks.schedule,
        component_checks.refuses,
        component_checks.repeatable,
    ),
}
RESULTS = (result_checks.linear_plant, result_checks.result_units, result_checks.covariance, result_checks.outcome)
READERS = (result_checks.suffixes, result_checks.foreign_file)
MACHINES = (result_checks.description, result_checks.silence, result_checks.stop)


def quick_checks_for(component: type[Component]) -> list[Check]:
    """Return the checks that apply to a component class and take plain Python no time worth mentioning."""
    return [check.quick() for check in checks_for(component) if check.quick_examples]


def checks_for(component: type[Component]) -> list[Check]:
    """Return the checks that apply to a component class, the cheap ones first."""
    if issubclass(component, FrictionModel):
        return [*ANY_KIND, *FRICTION]
    if issubclass(component, Estimator):
        return [*ANY_KIND, *(Check(body, quick_examples=0, is_compiled=True) for body in RESULTS)]
    if issubclass(component, RecordReader):
        return [ANY_KIND[0], *map(Check, READERS)]  # a reader follows a file format, not the literature
    if issubclass(component, MachineDriver):
        return [ANY_KIND[0], *(Check(body, quick_examples=0, is_compiled=True) for body in MACHINES)]
    bodies = next((bodies for kind, bodies in PARTS.items() if issubclass(component, kind)), ())
    return [*ANY_KIND, *(Check(body, strategy, 20, 5) for body in (component_checks.plain_data, *bodies))]
