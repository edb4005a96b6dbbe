"""The work of an experiment on a simulated loop: rows of samples, and steps of the friction law within them.

An experiment consists of periods: each rises, settles over about four segments, and is recorded. In lanes eight of them
are computed at the same time, so that the longest one matters more than their number.
"""

import dis
import inspect
from collections.abc import Sequence
from math import ceil
from time import thread_time
from typing import Any

from fraexp.components.kinds import Excitation, FrictionModel
from fraexp.components.periods import Period, Schedule
from fraexp.components.registry import Registry, create
from fraexp.data.sweep import Plain, component_names
from fraexp.execution.estimates.reference_costs import cost, law_cost
from fraexp.execution.estimates.speeds import SETTLING
from fraexp.execution.estimates.work import LANES, SCALAR, VECTOR, CountedExperiment, RecordShape, Work
from fraexp.simulation.experiments import MIN_WINDOW_S
from fraexp.simulation.loop_setup import discretise_machine, is_friction_soft, steps_per_sample
from fraexp.simulation.machine import Machine, build_machine

SETTLING_SEGMENTS = 4
"""Segments over which a quickly settling machine settles."""
REPEAT_BELOW_S = 0.02
"""Time below which the creation of periods is not measured a second time."""


def loop_work(experiment: Plain, registry: Registry) -> CountedExperiment:
    """Return the work of an experiment on a simulated loop."""
    machine = build_machine(experiment, registry)
    excitation = create(registry, Excitation, experiment[Excitation.kind])
    periods, made = timed_periods(excitation, machine.loop.sample_time)
    schedule, loop = excitation.schedule, machine.loop
    samples = [samples_of(period, schedule, loop.sample_time, loop.delay) for period in periods]
    lengths = [sum(pair) for pair in samples]
    is_wide = _is_wide(machine)
    rows = max(sum(lengths) / LANES, *lengths) if is_wide else sum(lengths)
    kind = f"loop/{_law_names(experiment)}/{VECTOR if is_wide else SCALAR}"
    settling = f"{SETTLING}/{excitation.name}/{machine.friction_names}" if schedule.settling_timeout > 0 else ""
    setup = cost("loop", "setup") + cost("loop", "period") * len(periods)
    work = (
        Work(kind, excitation.rounds * rows * _row_cost(machine), settling),
        Work("setup", setup),
        Work("", made),
    )
    shape = RecordShape(
        segments=len(periods),
        lines=sum(period.lines.size for period in periods),
        recorded=sum(recorded for _, recorded in samples),
        lead_in=sum(before for before, _ in samples),
        repeated=any(recorded > period.waveform.size for period, (_, recorded) in zip(periods, samples, strict=True)),
    )
    return CountedExperiment(work, shape, float(sum(lengths)), loop.sample_time, excitation.rounds)


def _is_wide(machine: Machine) -> bool:
    """Guess whether the loop is computed in lanes, by the condition of the run without the compiler."""
    models = [*machine.frictions.values(), *([machine.compensation.friction] if machine.compensation else [])]
    is_soft = is_friction_soft(
        machine.frictions, discretise_machine(machine, steps_per_sample(machine)), machine.loop.sample_time
    )
    return is_soft and all(looks_vectorised(model.law) for model in models)


def _row_cost(machine: Machine) -> float:
    """Return the time of a row on the reference core [s]."""
    each = cost("loop", "sample") + (cost("loop", "noise") if machine.loop.noise else 0.0)
    fed_back = step_cost(machine.compensation.friction) if machine.compensation else 0.0
    return each + fed_back + steps_per_sample(machine) * sum(map(step_cost, machine.frictions.values()))


def step_cost(friction: FrictionModel) -> float:
    """Return the time of a law for each step on the reference core [s]."""
    found = law_cost(friction.name)
    return found.step + found.state * friction.state_size


def _law_names(experiment: Plain) -> str:
    """Return the names of a loop's laws: its friction, and the model that compensates it."""
    sections = [experiment[FrictionModel.kind], experiment.get("compensation")]
    return "~".join("+".join(component_names(section)) for section in sections if section is not None)


def timed_periods(excitation: Excitation, sample_time: float) -> tuple[Sequence[Period], float]:
    """Return the periods, and the time to create them [s], which the experiment takes as well."""
    took: list[float] = []
    while len(took) < 2 and not (took and took[0] < REPEAT_BELOW_S):  # the first time may load a library
        began = thread_time()
        periods = excitation.periods(sample_time)
        took.append(thread_time() - began)
    return periods, min(took)


def samples_of(period: Period, schedule: Schedule, sample_time: float, delay: float) -> tuple[int, int]:
    """Return the number of samples before the record, if the loop settles quickly, and in the record."""
    block = period.waveform.size
    count = schedule.period_count(period, sample_time)
    if schedule.settling_timeout == 0:
        return 0, count * block
    ramp = ceil((schedule.ramp + delay) / sample_time)
    segment = block * max(1, ceil(max(MIN_WINDOW_S, delay) / (block * sample_time)))
    shared = count * block if count * block <= segment else 0  # the last segment is the record
    return ramp + SETTLING_SEGMENTS * segment - shared, count * block


def looks_vectorised(law: Any) -> bool:
    """Guess without the compiler whether a law can be computed in lanes: it has no branches except those of loops."""
    jumps = any("JUMP" in found.opname and "_IF_" in found.opname for found in dis.get_instructions(law))
    names = law.__code__.co_names
    called = [law.__globals__[name] for name in names if name in law.__globals__]
    closed = [cell.cell_contents for cell in law.__closure__ or ()]
    helpers = [one for one in called + closed if inspect.isfunction(one) and not _is_choice(one)]
    return not jumps and "int" not in names and all(looks_vectorised(helper) for helper in helpers)


def _is_choice(function: Any) -> bool:
    """Return whether a function is the choice between two values, which lanes can compute."""
    return bool(function.__module__ == "fraexp.kernels.choice")
