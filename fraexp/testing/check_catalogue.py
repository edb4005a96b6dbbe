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
from fraexp.testing import (
    component_checks,
    friction_law_checks,
    friction_motion_checks,
    loop_part_checks,
    machine_checks,
    result_checks,
)
from fraexp.testing.conformance_check import Check, class_check, example_check
from fraexp.testing.examples import strategy
from fraexp.testing.walk import drive_strategy, fixed_path_strategy

ANY_KIND = (
    class_check(component_checks.units),
    class_check(component_checks.source),
    class_check(component_checks.presets),
)
FRICTION = (
    example_check(friction_law_checks.finite, drive_strategy, 20, quick=6),
    example_check(friction_law_checks.pure, strategy, 2, quick=1),
    example_check(friction_law_checks.state_size, drive_strategy, 15, quick=6),
    example_check(friction_law_checks.rest, strategy, 10, quick=3),
    example_check(friction_law_checks.trial, drive_strategy, 12, quick=4),
    example_check(friction_law_checks.odd, drive_strategy, 25, quick=10),
    example_check(friction_law_checks.present, drive_strategy, 12, quick=5),
    example_check(friction_law_checks.bound, drive_strategy, 25, quick=6),
    example_check(friction_law_checks.stiffness, drive_strategy, 15, quick=5),
    example_check(friction_law_checks.monotone, drive_strategy, 15, quick=5),
    example_check(friction_law_checks.limits, strategy, 5, quick=2),
    example_check(component_checks.plain_data, strategy, 10, quick=3),
    # from here on the force is the compiled one, unless the check is to be quick
    example_check(friction_law_checks.compiled, drive_strategy, 20, is_compiled=True),
    example_check(friction_law_checks.translation, drive_strategy, 12, quick=3, is_compiled=True),
    example_check(friction_law_checks.order, drive_strategy, 6, quick=3, is_compiled=True),
    example_check(
        friction_motion_checks.continuous, friction_motion_checks.wave_strategy, 12, quick=2, is_compiled=True
    ),
    example_check(
        friction_motion_checks.refinement, friction_motion_checks.wave_strategy, 12, quick=2, is_compiled=True
    ),
    example_check(
        friction_motion_checks.energy, friction_motion_checks.closed_path_strategy, 100, quick=8, is_compiled=True
    ),
    example_check(friction_motion_checks.endurance, strategy, 4, is_compiled=True),
    # each example starts a process: a smaller one is not worth the time
    example_check(friction_motion_checks.elsewhere, fixed_path_strategy, 1, is_compiled=True, shrinks=False),
    example_check(result_checks.observer, result_checks.exposure_strategy, 4, is_compiled=True),
)
PARTS: dict[type[Component], tuple[Callable[[Any], None], ...]] = {
    Plant: (loop_part_checks.shapes, loop_part_checks.realisation, loop_part_checks.relative_degree),
    Controller: (loop_part_checks.causal, loop_part_checks.coefficients),
    Excitation: (
        loop_part_checks.whole_periods,
        loop_part_checks.schedule,
        loop_part_checks.refuses,
        loop_part_checks.repeatable,
    ),
}
RESULTS = (result_checks.linear_plant, result_checks.result_units, result_checks.covariance, result_checks.outcome)
READERS = (result_checks.suffixes, result_checks.foreign_file)
MACHINES = (machine_checks.description, machine_checks.silence, machine_checks.stop)


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
