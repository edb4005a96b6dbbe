"""The work of an experiment on a simulated loop: rows of samples, and steps of the friction law within them.

An experiment is its periods: each rises, settles over about four stretches and is recorded. In lanes eight of them
are computed side by side, so that their number counts less than the longest one.
"""

import dis
import inspect
from collections.abc import Sequence
from math import ceil
from time import thread_time
from typing import Any

from fraexp.components.kinds import Excitation, FrictionModel, Period, Schedule
from fraexp.components.registry import Registry, create
from fraexp.data.sweep import Plain, component_names
from fraexp.execution.estimates.reference_costs import cost, law_cost
from fraexp.execution.estimates.speeds import SETTLING
from fraexp.execution.estimates.work import LANES, SCALAR, VECTOR, Counted, Shape, Work
from fraexp.simulation.discretisation import discretise
from fraexp.simulation.experiments import LEAST_COMPARED
from fraexp.simulation.loop import SOFT, chosen_steps
from fraexp.simulation.machine import Machine, build_machine

STRETCHES = 4
"""Stretches over which a machine settles that settles soon."""
QUICK = 0.02
"""Time [s] of making periods that need not be measured again."""


def loop_work(experiment: Plain, registry: Registry) -> Counted:
    """Return the work of an experiment on a simulated loop."""
    machine = build_machine(experiment, registry)
    excitation = create(registry, Excitation, experiment[Excitation.kind])  # type: ignore[type-abstract]
    periods, made = timed_periods(excitation, machine.loop.sample_time)
    schedule, loop = excitation.schedule, machine.loop
    samples = [samples_of(period, schedule, loop.sample_time, loop.delay) for period in periods]
    wholes = [sum(pair) for pair in samples]
    is_wide = _is_wide(machine)
    rows = max(sum(wholes) / LANES, *wholes) if is_wide else sum(wholes)
    kind = f"loop/{_laws(experiment)}/{VECTOR if is_wide else SCALAR}"
    settling = f"{SETTLING}/{excitation.name}/{machine.friction.name}" if schedule.settle_limit > 0 else ""
    setup = cost("loop", "setup") + cost("loop", "period") * len(periods)
    work = (
        Work(kind, excitation.rounds * rows * _row_cost(machine), settling),
        Work("setup", setup),
        Work("", made),
    )
    shape = Shape(
        segments=len(periods),
        lines=sum(period.lines.size for period in periods),
        recorded=sum(recorded for _, recorded in samples),
        lead_in=sum(before for before, _ in samples),
        repeated=any(recorded > period.waveform.size for period, (_, recorded) in zip(periods, samples, strict=True)),
    )
    return Counted(work, shape, float(sum(wholes)), loop.sample_time, excitation.rounds)


def _is_wide(machine: Machine) -> bool:
    """Guess whether the loop is computed in lanes; the same condition as for the run, but for the compiler's word."""
    loop, friction = machine.loop, machine.friction
    discrete = discretise(
        machine.plant.state_space(),
        friction,
        machine.controller.transfer_function(loop.sample_time),
        sample_time=loop.sample_time,
        steps=chosen_steps(machine),
        input_path=(loop.input_dead_time, loop.input_lags),
        output_path=(loop.output_dead_time, loop.output_lags),
    )
    models = [friction, *([machine.compensation.friction] if machine.compensation else [])]
    soft = friction.greatest_stiffness * discrete.gain <= SOFT
    return bool(soft and all(looks_vectorised(model.law) for model in models))


def _row_cost(machine: Machine) -> float:
    """Return the time of a row on the reference core [s]."""
    each = cost("loop", "sample") + (cost("loop", "noise") if machine.loop.noise else 0.0)
    fed_back = step_cost(machine.compensation.friction) if machine.compensation else 0.0
    return each + fed_back + chosen_steps(machine) * step_cost(machine.friction)


def step_cost(friction: FrictionModel) -> float:
    """Return the time of a law for each step on the reference core [s]."""
    found = law_cost(friction.name)
    return found.step + found.state * friction.state_size


def _laws(experiment: Plain) -> str:
    """Return the names of the laws of a loop: of its friction, and of the model that is fed back."""
    sections = [experiment[FrictionModel.kind], experiment.get("compensation")]
    return "~".join("+".join(component_names(section)) for section in sections if section is not None)


def timed_periods(excitation: Excitation, sample_time: float) -> tuple[Sequence[Period], float]:
    """Return the periods, and the time that it takes to make them [s]: the experiment takes it, too."""
    took: list[float] = []
    while len(took) < 2 and not (took and took[0] < QUICK):  # the first time may load a library
        began = thread_time()
        periods = excitation.periods(sample_time)
        took.append(thread_time() - began)
    return periods, min(took)


def samples_of(period: Period, schedule: Schedule, sample_time: float, delay: float) -> tuple[int, int]:
    """Return the samples before the record, in a loop that settles soon, and those that are recorded."""
    block = period.waveform.size
    count = max(schedule.periods, ceil(schedule.record_time / (block * sample_time)), 1)
    if schedule.settle_limit == 0:
        return 0, count * block
    ramp = ceil((schedule.ramp + delay) / sample_time)
    stretch = block * max(1, ceil(max(LEAST_COMPARED, delay) / (block * sample_time)))
    shared = count * block if count * block <= stretch else 0  # the last stretch is record enough
    return ramp + STRETCHES * stretch - shared, count * block


def looks_vectorised(law: Any) -> bool:
    """Guess whether a law can be computed in lanes, without the compiler: it has no branches but those of loops."""
    jumps = any("JUMP" in found.opname and "_IF_" in found.opname for found in dis.get_instructions(law))
    names = law.__code__.co_names
    called = [law.__globals__[name] for name in names if name in law.__globals__]
    closed = [cell.cell_contents for cell in law.__closure__ or ()]
    helpers = [one for one in called + closed if inspect.isfunction(one) and not _chooses(one)]
    return not jumps and "int" not in names and all(looks_vectorised(helper) for helper in helpers)


def _chooses(function: Any) -> bool:
    """Say whether this is the choice between two values that lanes can make."""
    return bool(function.__module__ == "fraexp.kernels.choice")
