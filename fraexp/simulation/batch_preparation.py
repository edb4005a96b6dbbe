"""The arrays that a batch of experiments is run on: from plans and a machine's setup to what compiled code takes."""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import ParameterError
from fraexp.kernels.batch_arrays import (
    CURSOR_ROWS,
    IDLE,
    JOB_DTYPE,
    LANE_DTYPE,
    QUEUE_DTYPE,
    READ_INDEX,
    RESULT_DTYPE,
    WAITING,
    BatchArrays,
    KernelBatch,
)
from fraexp.kernels.block import DRIVE_ROWS, FRAME_DTYPE, TRACE_SAMPLES, trace_rows
from fraexp.kernels.guards import GUARD_ROWS, guarded_rows, memory_rows, set_guards
from fraexp.kernels.lane_layout import choose_layout
from fraexp.kernels.law_arguments import aligned_zeros, argument_sizes
from fraexp.kernels.memory_moves import TILE
from fraexp.kernels.observed_law import CALL_NUMBERS
from fraexp.kernels.periodic_state import DEPTH, KEPT_WINDOWS
from fraexp.kernels.stick_slip import contact_rows
from fraexp.simulation.experiments import Experiment, ExperimentPlan, Setup

MAX_HISTORY = 4_000_000
"""Measured positions that a lane keeps, unless the windows that it compares and records are longer."""
LAW_MEMORIES = ("friction_memory", "compensation_memory")
"""Parts of a loop's memory that a law writes: each begins with a guard."""
CONSTANTS = ("matrix", "compliance", "responses", "durations", "numerator", "denominator")
"""What the parts of `DiscreteLoop.constants` are called in a frame."""


def prepare_batch(plans: list[ExperimentPlan], setup: Setup) -> KernelBatch:
    """Return the arrays of experiments on like machines, with lanes at rest that have nothing to do.

    Raises ParameterError if the reference of an excitation has another shape than its waveform.
    """
    setups = list(dict.fromkeys(plan.experiment.setup for plan in plans))  # each once, in the order of the plans
    layout = choose_layout(setup.is_vectorised, len(plans), len(setups))
    width = layout.width
    machines = np.array([np.concatenate([*map(np.ravel, each.constants), *each.law_numbers]) for each in setups])
    waveforms = [plan.experiment.period.waveform for plan in plans]
    silence = np.zeros(max(waveform.size for waveform in waveforms))
    law_sizes, compensation_sizes = _argument_sizes(setup)
    rows = _RowCounts.of(setup)
    lanes = np.zeros(width, LANE_DTYPE)
    lanes["stage"] = IDLE
    lane_numbers = aligned_zeros(machines.shape[1] + sum(rows.memory.values()), width)
    law_memories = _law_memories(setup, rows, lane_numbers)
    rest_rows, linear_rows = _rest_rows(setup, rows), _linear_rows(setup, rows)
    for memory in law_memories:
        set_guards(memory)
    arrays = BatchArrays(
        jobs=_jobs(plans, setups),
        results=_empty_results(len(plans)),
        machines=machines,
        waveforms=np.concatenate([*waveforms, silence]),
        references=_references(plans, silence),
        noise_std=setup.noise_std,
        lane_numbers=lane_numbers,
        drive=aligned_zeros(DRIVE_ROWS, width),
        trace=aligned_zeros(
            trace_rows(setup.discrete.contacts, setup.discrete.positions, setup.discrete.thrusts), width
        ),
        noise=aligned_zeros(TRACE_SAMPLES * setup.discrete.positions if setup.noise_std else 1, width),
        lanes=lanes,
        cursors=np.zeros((CURSOR_ROWS, width), dtype=np.int64),
        history=np.empty((width, _history_length(plans) + TILE)),
        recorded=empty_records(width, len(setup.channels) - 1, max(plan.record for plan in plans)),
        queue=np.zeros(1, QUEUE_DTYPE),
        rest_rows=rest_rows,
        linear_rows=linear_rows,
        window_states=np.zeros((width, 2, DEPTH, linear_rows.size)),
        window_numbers=np.zeros((width, DEPTH), np.int64),
        saved_memory=np.zeros((width, rest_rows.size)),
        frame=np.empty(0, FRAME_DTYPE),
    )
    batch = KernelBatch(
        arrays=arrays,
        argument_sizes=np.array([*law_sizes, *compensation_sizes], np.int64),
        last_call=np.zeros(CALL_NUMBERS),
        law_memories=law_memories,
        layout=layout,
    )
    return _with_frame(batch, setup)


def empty_records(width: int, channels: int, samples: int) -> NDArray[np.float64]:
    """Return room for a record of each lane."""
    return np.empty((width, channels, TRACE_SAMPLES + samples + TILE))


def _with_frame(batch: KernelBatch, setup: Setup) -> KernelBatch:
    """Return a batch with what a block of samples needs: sizes, addresses in the batch's arrays, and settings."""
    arrays, discrete, compensation, rows = batch.arrays, setup.discrete, setup.compensation, _RowCounts.of(setup)
    law_sizes, _ = _argument_sizes(setup)
    values: dict[str, float] = {
        "states": discrete.transition.shape[0],
        "steps": setup.steps,
        "friction_states": setup.state_size,
        "thrusts": discrete.thrusts,
        "controller_order": discrete.numerator.shape[1],
        "input_delay": setup.input_delay,
        "output_delay": setup.output_delay,
        "compensation_states": compensation.friction.state_size if compensation else 0,
        "positions": discrete.positions,
        "time_step": setup.sample_time / setup.steps,
        "resolution": setup.resolution,
        "divergence_limit": setup.divergence_limit,
        "drive": arrays.drive.ctypes.data,
        "trace": arrays.trace.ctypes.data,
        "last_call": batch.last_call.ctypes.data,
        "noise": arrays.noise.ctypes.data,
        "waveforms": arrays.waveforms.ctypes.data,
        "references": arrays.references.ctypes.data,
        "read_indices": arrays.cursors[READ_INDEX].ctypes.data,
        "argument_sizes": batch.argument_sizes.ctypes.data,
        "compensation_sizes": batch.argument_sizes[len(law_sizes) :].ctypes.data,
    }
    places = [(numbers.ctypes.data, numbers.strides[0]) for numbers in (arrays.machines[0], arrays.lane_numbers)]
    for name, row in rows.first.items():
        first = row + (GUARD_ROWS if name in LAW_MEMORIES else 0)  # a law's memory begins with a guard
        address, stride = places[0 if batch.layout.is_shared and name in rows.constants else 1]
        values[name] = address + first * stride
    frame = np.array([tuple(values.get(name, 0) for name in FRAME_DTYPE.names or ())], FRAME_DTYPE)
    return batch._replace(arrays=arrays._replace(frame=frame))


def _argument_sizes(setup: Setup) -> tuple[list[int], list[int]]:
    """Return the sizes of the arguments of the friction law, and of the compensation."""
    return argument_sizes(setup.law_arguments), argument_sizes(setup.compensation_arguments)


def _history_length(plans: list[ExperimentPlan]) -> int:
    """Return the number of positions that a lane keeps."""
    needed = max((KEPT_WINDOWS + 1) * plan.window + plan.record for plan in plans)
    return max(min(max(plan.max_samples for plan in plans), MAX_HISTORY), needed)


class _RowCounts(NamedTuple):
    """How many rows each part of a lane's numbers has; they lie below each other, constants first."""

    constants: dict[str, int]
    """Constants of the loop, and arguments of the laws."""
    memory: dict[str, int]
    """Parts of the loop's memory."""

    @classmethod
    def of(cls, setup: Setup) -> "_RowCounts":
        """Return those of a machine."""
        return cls(_constant_rows(setup), _memory_rows(setup))

    @property
    def first(self) -> dict[str, int]:
        """Where each part begins."""
        counts = {**self.constants, **self.memory}
        return dict(zip(counts, itertools.accumulate(counts.values(), initial=0), strict=False))


def _constant_rows(setup: Setup) -> dict[str, int]:
    """Return how many numbers each part of a machine's constants and laws has, in their order."""
    rows = {name: part.size for name, part in zip(CONSTANTS, setup.constants, strict=True)}
    rows["arguments"], rows["compensation_arguments"] = (numbers.size for numbers in setup.law_numbers)
    return rows


def _memory_rows(setup: Setup) -> dict[str, int]:
    """Return how many numbers each part of the loop's memory has, in their order."""
    discrete = setup.discrete
    n, contacts, positions = discrete.transition.shape[0], discrete.contacts, discrete.positions
    thrusts = discrete.thrusts
    compensation_states = setup.compensation.friction.state_size if setup.compensation else 0
    return {
        "known": n + 2 * thrusts + contacts,
        "linear": setup.steps * contacts + positions + n + discrete.present.shape[0],
        "friction_memory": memory_rows(setup.state_size),
        "controller_memory": setup.discrete.numerator.size,
        "control_inputs": thrusts * (setup.input_delay + 2),
        "measurements": positions * (setup.output_delay + 1),
        "contacts": contact_rows(contacts),
        "compensation_memory": memory_rows(compensation_states) + 1,
    }


def _law_memories(setup: Setup, rows: _RowCounts, lane_numbers: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return the memory of the friction law, and of the compensation's, if any, with its guards."""
    states = [setup.state_size]
    if setup.compensation:
        states.append(setup.compensation.friction.state_size)
    first, sizes = [rows.first[name] for name in LAW_MEMORIES], map(memory_rows, states)
    return tuple(lane_numbers[row : row + size] for row, size in zip(first, sizes, strict=False))


def _rest_rows(setup: Setup, rows: _RowCounts) -> NDArray[np.int64]:
    """Return the rows of a lane's memory, without the guards of the laws."""
    is_memory = np.ones(sum(rows.memory.values()), dtype=bool)
    constants = sum(rows.constants.values())
    compensation_states = setup.compensation.friction.state_size if setup.compensation else 0
    for name, states in zip(LAW_MEMORIES, (setup.state_size, compensation_states), strict=True):
        first = rows.first[name] - constants
        is_memory[first : first + memory_rows(states)] = ~guarded_rows(states)
    return constants + np.flatnonzero(is_memory)


def _linear_rows(setup: Setup, rows: _RowCounts) -> NDArray[np.int64]:
    """Return the rows of a lane's memory that are the state of the linear part, from one sample to the next."""
    states = setup.discrete.transition.shape[0]  # the rest of what is known is looked up afresh in each sample
    counts, first = {**rows.memory, "known": states}, rows.first
    parts = ("known", "controller_memory", "control_inputs", "measurements")
    return np.concatenate([first[name] + np.arange(counts[name]) for name in parts])


def _jobs(plans: list[ExperimentPlan], setups: list[Setup]) -> NDArray[np.void]:
    rows: list[tuple[float, ...]] = []
    first_sample = 0
    machine_of = {setup: row for row, setup in enumerate(setups)}
    for plan in plans:
        setup, schedule = plan.experiment.setup, plan.experiment.schedule
        samples, lines = plan.experiment.period.waveform.size, plan.experiment.period.lines
        values = {
            "machine": machine_of[setup],
            "first_sample": first_sample,
            "period": samples,
            "cycles": int(lines[0]) if lines.size == 1 else 0,
            "ramp": plan.ramp,
            "window": plan.window,
            "settling_limit": plan.settling_limit,
            "record": plan.record,
            "start_amplitude": plan.start_amplitude,
            "amplitude_rise": plan.amplitude_rise,
            "tolerance": schedule.settling_tolerance,
            "noise_floor": plan.noise_floor,
            "reference": setup.reference,
            "seed": _noise_seed(plan.experiment),
        }
        rows.append(tuple(values[name] for name in JOB_DTYPE.names or ()))
        first_sample += samples
    return np.array(rows, JOB_DTYPE)


def _noise_seed(experiment: Experiment) -> int:
    if not experiment.setup.noise_std:
        return 0
    sequence = np.random.SeedSequence([experiment.setup.seed, experiment.number])
    return int(sequence.generate_state(1, np.uint64)[0])


def _references(plans: list[ExperimentPlan], silence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the position reference [m] of all samples; empty where none moves."""
    periods = [plan.experiment.period for plan in plans]
    if all(period.reference is None for period in periods):
        return np.zeros(0)
    references = []
    for plan, period in zip(plans, periods, strict=True):
        moving = np.zeros(period.waveform.size) if period.reference is None else period.reference
        if moving.shape != period.waveform.shape:
            raise ParameterError(
                f"the excitation gives a reference of shape {moving.shape} beside a waveform of shape "
                f"{period.waveform.shape}; expected equal shapes"
            )
        references.append(plan.experiment.setup.reference + moving)
    return np.concatenate([*references, silence])


def _empty_results(jobs: int) -> NDArray[np.void]:
    results = np.zeros(jobs, RESULT_DTYPE)
    results["status"], results["pool_index"], results["residual"] = WAITING, -1, np.nan
    return results
