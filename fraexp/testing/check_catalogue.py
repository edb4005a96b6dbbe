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
from fraexp.testing.conformance_check import Check, class_check, example_check
from fraexp.testing.examples import strategy
from fraexp.testing.walk import drive_strategy, fixed_path_strategy

ANY_KIND = (
    class_check(component_checks.units),
    class_check(component_checks.source),
    class_check(component_checks.presets),
)
FRICTION = (
    example_check(friction.finite, drive_strategy, 20, quick=6),
    example_check(friction.pure, strategy, 2, quick=1),
    example_check(friction.state_size, drive_strategy, 15, quick=6),
    example_check(friction.rest, strategy, 10, quick=3),
    example_check(friction.trial, drive_strategy, 12, quick=4),
    example_check(friction.odd, drive_strategy, 25, quick=10),
    example_check(friction.present, drive_strategy, 12, quick=5),
    example_check(friction.bound, drive_strategy, 25, quick=6),
    example_check(friction.stiffness, drive_strategy, 15, quick=5),
    example_check(friction.monotone, drive_strategy, 15, quick=5),
    example_check(friction.limits, strategy, 5, quick=2),
    example_check(component_checks.plain_data, strategy, 10, quick=3),
    # from here on the force is the compiled one, unless the check is to be quick
    example_check(friction.compiled, drive_strategy, 20, is_compiled=True),
    example_check(friction.translation, drive_strategy, 12, quick=3, is_compiled=True),
    example_check(friction.order, drive_strategy, 6, quick=3, is_compiled=True),
    example_check(friction.continuous, friction.wave_strategy, 12, quick=2, is_compiled=True),
    example_check(friction.refinement, friction.wave_strategy, 12, quick=2, is_compiled=True),
    example_check(friction.energy, friction.closed_path_strategy, 100, quick=8, is_compiled=True),
    example_check(friction.endurance, strategy, 4, is_compiled=True),
    # each example starts a process: a smaller one is not worth the time
    example_check(friction.elsewhere, fixed_path_strategy, 1, is_compiled=True, shrinks=False),
    example_check(result_checks.observer, result_checks.exposure_strategy, 4, is_compiled=True),
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
        return [*ANY_KIND, *(class_check(body, is_compiled=True) for body in RESULTS)]
    if issubclass(component, RecordReader):
        return [ANY_KIND[0], *map(class_check, READERS)]  # a reader follows a file format, not the literature
    if issubclass(component, MachineDriver):
        return [ANY_KIND[0], *(class_check(body, is_compiled=True) for body in MACHINES)]
    bodies = next((bodies for kind, bodies in PARTS.items() if issubclass(component, kind)), ())
    return [*ANY_KIND, *(example_check(body, strategy, 20, quick=5) for body in (component_checks.plain_data, *bodies))]
