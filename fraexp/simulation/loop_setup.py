"""A machine made ready for simulation: its steps per sample, and whether its friction is explicit or implicit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fraexp.components.kinds import FrictionModel
from fraexp.components.ports import Ports
from fraexp.data.findings import Quantity
from fraexp.errors import ParameterError
from fraexp.simulation.discretisation import DiscreteLoop, discretise, split_dead_time
from fraexp.simulation.experiments import Setup, set_valued_contacts
from fraexp.simulation.machine import MAX_STEPS_PER_SAMPLE, Machine

MAX_STEP_RAD = 1.0
"""Longest step, in radians of the stuck table's resonance."""
REFERENCE_STEP_RAD, REFERENCE_ERROR = 0.08, 1e-3
"""A step, in radians of the stuck table's resonance, and the relative error of a response that comes with it."""
MAX_ACCURACY_STEPS = 10
"""Maximum number of steps per sample for the sake of accuracy: where a machine is merely held, as by Coulomb friction,
its resonance need not be resolved."""
SET_VALUED_STEPS = 9
"""Steps per sample at which a law of velocity causes the error REFERENCE_ERROR at 200 Hz and 0.5 ms."""
EXPLICIT_STIFFNESS_LIMIT = 0.05
"""Greatest product of the law's stiffness and a step's compliance at which explicit friction is as good as implicit."""


def prepare_setup(machine: Machine) -> Setup:
    """Return a machine's loop in numbers: how many steps a sample has, and whether friction is explicit or implicit.

    Raises PluginError for a friction law that breaks its contract, ParameterError for numerics that do not fit.
    """
    loop, frictions = machine.loop, machine.frictions
    models = [*frictions.values(), *([machine.compensation.friction] if machine.compensation else [])]
    for model in models:
        model.check_law()
    discrete = discretise_machine(machine, steps_per_sample(machine))
    for model in frictions.values():
        model.check_law(loop.sample_time / discrete.steps)
    if machine.compensation:
        machine.compensation.friction.check_law(loop.sample_time)
    return Setup(
        frictions=frictions,
        positions=tuple(machine.ports.positions),
        thrusts=tuple(machine.controllers),
        discrete=discrete,
        sample_time=loop.sample_time,
        input_delay=split_dead_time(loop.input_dead_time, loop.sample_time).samples,
        output_delay=split_dead_time(loop.output_dead_time, loop.sample_time).samples,
        delay=loop.delay,
        reference=loop.reference,
        resolution=loop.resolution,
        noise_std=loop.noise,
        seed=loop.seed,
        divergence_limit=loop.divergence_limit,
        is_vectorised=is_friction_soft(frictions, discrete, loop.sample_time)
        and all(model.is_vectorisable for model in models),
        compensation=machine.compensation,
    )


def setup_with_steps(machine: Machine, setup: Setup, steps: int) -> Setup:
    """Return the setup of a machine with another number of steps per sample, run by the same compiled code."""
    return setup if steps == setup.steps else replace(setup, discrete=discretise_machine(machine, steps))


def discretise_machine(machine: Machine, steps: int) -> DiscreteLoop:
    """Return the constants of a machine's loop, with a number of steps per sample."""
    loop, frictions = machine.loop, machine.frictions
    return discretise(
        machine.ports,
        {name: model.viscous for name, model in frictions.items()},
        [controller.transfer_function(loop.sample_time) for controller in machine.controllers.values()],
        sample_time=loop.sample_time,
        steps=steps,
        is_force_held=set_valued_contacts(frictions),
        input_path=loop.input_path,
        output_path=loop.output_path,
    )


def is_friction_soft(frictions: Mapping[str, FrictionModel], discrete: DiscreteLoop, sample_time: float) -> bool:
    """Return whether friction is so soft within a step that it may be explicit, as it is in lanes."""
    if any(set_valued_contacts(frictions)):  # solved in velocities, in lanes as well where there is one contact
        return len(frictions) == 1
    step = sample_time / discrete.steps
    stiffness = [max(model.max_stiffness, model.stiffness_in_step(step)) for model in frictions.values()]
    return bool(np.max(np.abs(discrete.step_compliance) @ stiffness) <= EXPLICIT_STIFFNESS_LIMIT)


def steps_per_sample(machine: Machine) -> int:
    """Return the steps per sample: the number that is asked for, or the one that the tolerance needs.

    Raises ParameterError for steps that are too long to follow the stuck table on its presliding stiffness, and for
    a stiffness that no number of steps follows.
    """
    numerics, fewest = machine.numerics, fewest_steps(machine)
    resonance = stuck_resonance(machine.ports, machine.frictions)
    if fewest > MAX_STEPS_PER_SAMPLE:
        stiffness = max(_presliding_stiffness(machine.frictions))
        raise ParameterError(
            f"stuck on {machine.friction_names} friction, of up to ",
            Quantity(stiffness, "N/m"),
            f", the machine resonates at {resonance / (2 * np.pi):.4g} Hz, which needs {fewest} steps per sample; "
            f"expected at most {MAX_STEPS_PER_SAMPLE}: correct the plant's gain, max_stiffness of the law (check "
            "'stiffness'), or lower loop.sample_time",
        )
    if numerics.steps_per_sample == 0:
        return accurate_steps(machine.ports, machine.frictions, machine.loop.sample_time, numerics.tolerance)
    if numerics.steps_per_sample < fewest:
        raise ParameterError(
            f"numerics.steps_per_sample is {numerics.steps_per_sample}; stuck on {machine.friction_names} friction the "
            f"machine resonates at {resonance / (2 * np.pi):.4g} Hz: expected {fewest} or more, or 0 to "
            "let fraexp choose"
        )
    return numerics.steps_per_sample


def accurate_steps(ports: Ports, frictions: Mapping[str, FrictionModel], sample_time: float, tolerance: float) -> int:
    """Return the steps per sample with which a response has this relative error: it falls with the step's square."""
    resonance = sample_time * stuck_resonance(ports, frictions)
    reference = max(resonance / REFERENCE_STEP_RAD, SET_VALUED_STEPS * any(set_valued_contacts(frictions)))
    accurate = int(np.ceil(reference * np.sqrt(REFERENCE_ERROR / tolerance)))
    return max(min(accurate, MAX_ACCURACY_STEPS), _steps_that_follow(resonance))


def fewest_steps(machine: Machine) -> int:
    """Return the steps per sample that follow the stuck table on its presliding stiffness."""
    return _steps_that_follow(machine.loop.sample_time * stuck_resonance(machine.ports, machine.frictions))


def _steps_that_follow(resonance: float) -> int:
    """Return the steps per sample that follow a resonance [rad per sample]."""
    return max(int(np.ceil(resonance / MAX_STEP_RAD)), 1)


def stuck_resonance(ports: Ports, frictions: Mapping[str, FrictionModel]) -> float:
    """Return the angular frequency [rad/s] at which a machine resonates on the presliding stiffness of its friction.

    Of several contacts it is the highest, and it is 0 where all laws are set-valued.
    """
    forces = np.column_stack([contact.force for contact in ports.contacts.values()])
    displacements = np.array([contact.displacement for contact in ports.contacts.values()])
    stiffness = np.diag(_presliding_stiffness(frictions))
    squares = np.linalg.eigvals(displacements @ ports.a @ forces @ stiffness).real
    return float(np.sqrt(max(squares.max(), 0.0)))


def _presliding_stiffness(frictions: Mapping[str, FrictionModel]) -> list[float]:
    """Return the greatest stiffness of each contact [N/m]; 0 for a set-valued law, which is not a spring at rest."""
    return [0.0 if model.velocity_law else model.max_stiffness for model in frictions.values()]
