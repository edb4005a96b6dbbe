"""Experiments on loops, run side by side: from machines and periods to segments."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.components.kinds import FrictionModel, Period, Schedule
from fraexp.components.parameters import Parameters, param
from fraexp.data.signals import Segment, Settling
from fraexp.errors import ParameterError
from fraexp.simulation.discretisation import Discrete

if TYPE_CHECKING:
    from fraexp.kernels.batch import KernelBatch, Laws

LEAST_COMPARED = 0.1
"""Time [s] over which periods are compared at least: at 200 Hz a slow transient hardly changes in one period."""
AT_ONCE = 1_000_000
"""Steps after which a long experiment shows that it is alive, and can be stopped."""
REMEMBERED = 4_000_000
"""Measured positions that a lane remembers at most, but for the stretches that it compares and records."""
MOST_POOLED = 1 << 24
"""Numbers of results that are kept together, at most."""
Progress = Callable[[float], None]


class Compensation(Parameters):
    """Friction compensation by feedback: a share of a friction model's force, driven by y', is added to the input."""

    gain: float = param("1", "share α of the friction model's force that is fed back", 1.0, at_least=0, at_most=100)
    friction: FrictionModel = param("", "friction model of the compensation", inherit="friction")

    def law_arguments(self, sample_time: float) -> tuple[Any, ...]:
        """Return gain, viscous coefficient, sample time and the arguments of the model's law."""
        return float(self.gain), float(self.friction.viscous), float(sample_time), self.friction.law_arguments()


@dataclass(frozen=True)
class Setup:
    """A machine made ready: its loop in numbers. Those of one batch differ in these numbers alone."""

    friction: FrictionModel
    discrete: Discrete
    sample_time: float
    dead_samples: tuple[int, int]
    """Whole samples of dead time before the thrust and before the measurement."""
    delay: float
    """Time that a change of the control input needs to be seen in the measured position [s]."""
    reference: float
    """Position reference [m]."""
    resolution: float
    """Of the scale [m]."""
    noise: float
    """Standard deviation of the scale's noise [m]."""
    seed: int
    stroke: float
    """Displacement that counts as diverged [m]."""
    wide: bool
    """Whether experiments are run in lanes."""
    compensation: Compensation | None = None

    @property
    def channels(self) -> int:
        """Number of channels that are recorded."""
        return 5 if self.compensation else 4

    @property
    def feedback_arguments(self) -> tuple[Any, ...]:
        """What the kernel takes for the compensation; nothing without one."""
        return self.compensation.law_arguments(self.sample_time) if self.compensation else ()

    @property
    def laws(self) -> "Laws":
        """What is compiled for it."""
        from fraexp.kernels.batch import Laws
        from fraexp.kernels.law_arguments import structure

        alone = Laws(self.friction.law, structure(self.friction.law_arguments()))
        if self.compensation is None:
            return alone
        return alone._replace(
            observer_law=self.compensation.friction.law, observer_kinds=structure(self.feedback_arguments)
        )

    @property
    def steps(self) -> int:
        """Steps per sample."""
        return int(self.discrete.compliance.shape[0])

    @property
    def numerics(self) -> str:
        """How it is computed, in words."""
        way = "force at the predicted displacement, in lanes" if self.wide else "force solved for implicitly"
        return f"{self.steps} step{'s' if self.steps > 1 else ''} per sample, {way}"


@dataclass(frozen=True)
class Experiment:
    """One period of an excitation on a machine, from rest until it repeats itself, and then recorded."""

    setup: Setup
    period: Period
    schedule: Schedule
    number: int
    """Among those of its sweep: noise differs from one to the next."""


def run(experiments: Sequence[Experiment], progress: Progress) -> list[Segment | None]:
    """Return what each experiment recorded, in their order; None where the loop diverged.

    `progress` is told the fraction done.
    """
    from fraexp.kernels import batch as kernel  # numba: imported only where a loop is run

    plans = [_Plan.of(experiment) for experiment in experiments]
    order = sorted(range(len(plans)), key=lambda k: -plans[k].expected)  # the longest first: lanes end together
    plans = [plans[k] for k in order]
    setup = experiments[0].setup
    work, laws, budget = prepare(plans, setup), setup.laws, max(AT_ONCE // setup.steps, 1)
    results = work.results
    weights = np.array([plan.expected for plan in plans]) / sum(plan.expected for plan in plans)
    pools: list[np.ndarray] = []
    owner = np.full(len(plans), -1)
    status = kernel.FULL
    while status != kernel.DONE:
        if status == kernel.FULL:
            pools.append(np.empty(_room(plans, work, pools)))
            work.queue["used"] = 0
        status = kernel.advance(laws, setup.wide, work, pools[-1], budget)
        owner[(results["place"] >= 0) & (owner < 0)] = len(pools) - 1
        progress(_share(weights, plans, work))
    segments: list[Segment | None] = [None] * len(plans)
    for number, plan in enumerate(plans):
        if results["place"][number] >= 0:
            segments[order[number]] = plan.segment(results[number], pools[owner[number]])
    return segments


@dataclass(frozen=True)
class _Plan:
    """An experiment, counted in samples."""

    experiment: Experiment
    ramp: int
    stretch: int
    limit: int
    count: int
    """Periods that are recorded."""
    record: int
    """Samples that are recorded."""
    base: float
    rate: float

    @classmethod
    def of(cls, experiment: Experiment) -> "_Plan":
        setup, schedule = experiment.setup, experiment.schedule
        block, sample_time = experiment.period.waveform.size, setup.sample_time
        count = max(schedule.periods, int(np.ceil(schedule.record_time / (block * sample_time))), 1)
        if schedule.settle_limit == 0:  # the transient itself is asked for
            return cls(experiment, 0, 0, 0, count, count * block, 1.0, 0.0)
        ramp = int(np.ceil((schedule.ramp + setup.delay) / sample_time))
        # what the loop has not yet heard of cannot show: a stretch lasts a turn of it at least
        stretch = block * max(1, int(np.ceil(max(LEAST_COMPARED, setup.delay) / (block * sample_time))))
        limit = int(np.ceil(schedule.settle_limit / sample_time))
        rising = (0.0, sample_time / schedule.ramp) if schedule.ramp else (1.0, 0.0)
        return cls(experiment, ramp, stretch, limit, count, count * block, *rising)

    @property
    def longest(self) -> int:
        """Samples from rest to the end of the record at most."""
        return self.ramp + max(self.limit, 2 * self.stretch) + self.stretch + self.record

    @property
    def expected(self) -> int:
        """Samples that a machine takes which settles soon."""
        return self.ramp + 4 * self.stretch + (self.record if self.record > self.stretch else 0)

    @property
    def floor(self) -> float:
        """Difference of two stretches that scale and noise alone explain [m]."""
        setup = self.experiment.setup
        scatter = np.sqrt(2 * (setup.noise**2 + setup.resolution**2 / 12))
        return float(scatter * (1 + 3 / np.sqrt(2 * self.stretch))) if self.stretch else 0.0

    def segment(self, result: np.void, pool: np.ndarray) -> Segment:
        """Return the recorded periods from the pool."""
        from fraexp.kernels.batch import SETTLED

        sample_time, period = self.experiment.setup.sample_time, self.experiment.period
        begin, before, record = int(result["place"]), int(result["lead_in"]), self.record
        lead_in, first = pool[begin : begin + before], begin + before
        count = self.experiment.setup.channels
        numbers = pool[first : first + count * record].reshape(count, self.count, period.waveform.size)
        waited = int(result["settling"])
        settling = Settling(bool(result["status"] == SETTLED), waited * sample_time, float(result["residual"]))
        channels = dict(zip(("y", "u", "displacement", "friction", "compensation"), numbers, strict=False))
        channels["excitation"] = _repeated(period.waveform, waited, self.count)
        if period.reference is not None:
            channels["reference"] = self.experiment.setup.reference + _repeated(period.reference, waited, self.count)
        return Segment(sample_time, channels, period.lines, settling, {"y": lead_in} if before else {})


def _repeated(period: np.ndarray, waited: int, count: int) -> np.ndarray:
    """Return a period as often as it is recorded, from where it stood when the record began."""
    begin = waited % period.size
    shifted = np.concatenate([period[begin:], period[:begin]]) if begin else period
    return np.broadcast_to(shifted, (count, period.size)) if count > 1 else shifted.reshape(1, -1)


def prepare(plans: list[_Plan], setup: Setup) -> "KernelBatch":
    """Return experiments of like machines in numbers, with lanes at rest that have nothing to do."""
    from fraexp.kernels.batch import IDLE, LANE, NOISE_ROWS, QUEUE, KernelBatch
    from fraexp.kernels.block import DRIVE_ROWS, TRACE_ROWS
    from fraexp.kernels.lanes import WIDTH
    from fraexp.kernels.law_arguments import aligned_zeros, sizes

    width = WIDTH if setup.wide else 1
    machines, waves = _machines(plans), [plan.experiment.period.waveform for plan in plans]
    silence = np.zeros(max(wave.size for wave in waves))
    memory = _memory_rows(setup)
    compared = max(2 * plan.stretch + plan.record for plan in plans)
    room = max(min(max(plan.longest for plan in plans), REMEMBERED), compared)
    lanes = np.zeros(width, LANE)
    lanes["stage"] = IDLE
    work = KernelBatch(
        jobs=_jobs(plans),
        results=_no_results(len(plans)),
        machines=machines,
        waves=np.concatenate([*waves, silence]),
        goals=_goals(plans, silence),
        sigma=setup.noise,
        store=aligned_zeros(machines.shape[1] + sum(memory.values()), width),
        drive=aligned_zeros(DRIVE_ROWS, width),
        trace=aligned_zeros(TRACE_ROWS, width),
        noise=aligned_zeros(NOISE_ROWS if setup.noise else 1, width),
        lanes=lanes,
        places=np.zeros((3, width), dtype=np.int64),
        history=np.empty((width, room)),
        others=np.empty((width, setup.channels - 1, max(plan.record for plan in plans))),
        queue=np.zeros(1, QUEUE),
        frame=np.empty(0),
        argument_sizes=np.array([*sizes(setup.friction.law_arguments()), *sizes(setup.feedback_arguments)], np.int64),
    )
    return work._replace(frame=frame_of(work, setup))


def frame_of(work: "KernelBatch", setup: Setup) -> np.ndarray:
    """Return what a block of samples needs: sizes, addresses in the arrays of the work, and settings."""
    from fraexp.kernels.batch import FILLED, SOURCE, START
    from fraexp.kernels.block import FRAME
    from fraexp.kernels.law_arguments import sizes

    frame, own = np.zeros(1, FRAME), len(sizes(setup.friction.law_arguments()))
    n, late, held = setup.discrete.transition.shape[0], *setup.dead_samples
    values: dict[str, float] = {
        "states": n, "steps": setup.steps, "friction_states": setup.friction.state_size,
        "order": setup.discrete.numerator.size, "late": late, "held": held,
        "observer_states": setup.compensation.friction.state_size if setup.compensation else 0,
        "channels": work.others.shape[1], "history_row": work.history.shape[1], "others_row": work.others.shape[2],
        "step": setup.sample_time / setup.steps, "resolution": setup.resolution, "limit": setup.stroke,
        **{name: getattr(work, name).ctypes.data for name in (
            "drive", "trace", "noise", "waves", "goals", "history", "others",
        )},
        "source": work.places[SOURCE].ctypes.data, "start": work.places[START].ctypes.data,
        "filled": work.places[FILLED].ctypes.data,
        "argument_sizes": work.argument_sizes.ctypes.data,
        "compensation_sizes": work.argument_sizes[own:].ctypes.data,
    }  # fmt: skip
    row = 0
    for name, rows in {**_constant_rows(setup), **_memory_rows(setup)}.items():
        values[name] = work.store.ctypes.data + row * work.store.strides[0]
        row += rows
    for name, value in values.items():
        frame[name] = value
    return frame


def _constant_rows(setup: Setup) -> dict[str, int]:
    """Return how many numbers each part of a machine's constants and laws has, in their order."""
    from fraexp.kernels.law_arguments import flatten

    names = ("matrix", "compliance", "responses", "numerator", "denominator")
    parts = {name: part.size for name, part in zip(names, setup.discrete.constants, strict=True)}
    arguments, feedback = flatten(setup.friction.law_arguments()), flatten(setup.feedback_arguments)
    return {**parts, "arguments": arguments.size, "compensation": feedback.size}


def _memory_rows(setup: Setup) -> dict[str, int]:
    """Return how many numbers each part of the loop's memory has, in their order."""
    from fraexp.kernels.block import CONTACT_ROWS

    n, m, (late, held) = setup.discrete.transition.shape[0], setup.steps, setup.dead_samples
    observed = setup.compensation.friction.state_size if setup.compensation else 0
    return {
        "known": n + 3, "linear": m + 1 + n, "friction": 2 * setup.friction.state_size,
        "filter": setup.discrete.numerator.size, "inputs": late + 2, "outputs": held + 1, "contact": CONTACT_ROWS,
        "observer": 2 * observed + 1,
    }  # fmt: skip


def _jobs(plans: list[_Plan]) -> np.ndarray:
    from fraexp.kernels.batch import JOB

    setups, jobs, begin = _setups(plans), np.zeros(len(plans), JOB), 0
    for job, plan in zip(jobs, plans, strict=True):
        setup, schedule = plan.experiment.setup, plan.experiment.schedule
        samples = plan.experiment.period.waveform.size
        values = {
            "machine": setups[id(setup)], "begin": begin, "period": samples, "ramp": plan.ramp, "stretch": plan.stretch,
            "limit": plan.limit, "record": plan.record, "base": plan.base, "rate": plan.rate,
            "tolerance": schedule.tolerance, "floor": plan.floor, "reference": setup.reference,
            "seed": _seed(plan.experiment),
        }  # fmt: skip
        for name, value in values.items():
            job[name] = value
        begin += samples
    return jobs


def _setups(plans: list[_Plan]) -> dict[int, int]:
    """Return the row of each setup among the machines."""
    found: dict[int, int] = {}
    for plan in plans:
        found.setdefault(id(plan.experiment.setup), len(found))
    return found


def _seed(experiment: Experiment) -> int:
    if not experiment.setup.noise:
        return 0
    sequence = np.random.SeedSequence([experiment.setup.seed, experiment.number])
    return int(sequence.generate_state(1, np.uint64)[0])


def _machines(plans: list[_Plan]) -> np.ndarray:
    """Return constants of the loop and parameters of the laws, one machine a row."""
    different = {id(plan.experiment.setup): plan.experiment.setup for plan in plans}
    return np.array([_numbers(each) for each in different.values()])


def _goals(plans: list[_Plan], silence: np.ndarray) -> np.ndarray:
    """Return the reference of all samples [m]; nothing where none moves."""
    rest = [plan.experiment.setup.reference for plan in plans]
    periods = [plan.experiment.period for plan in plans]
    if all(period.reference is None for period in periods):
        return np.zeros(0)
    for period in periods:
        if period.reference is not None and period.reference.shape != period.waveform.shape:
            found = f"a reference of shape {period.reference.shape} beside a waveform of {period.waveform.shape}"
            raise ParameterError(f"the excitation gives {found}; expected equal shapes")
    moving = [np.zeros(p.waveform.size) if p.reference is None else p.reference for p in periods]
    return np.concatenate([*(place + goal for place, goal in zip(rest, moving, strict=True)), silence])


def _numbers(setup: Setup) -> np.ndarray:
    """Return constants and parameters of a machine, one after another."""
    from fraexp.kernels.law_arguments import flatten

    parts = [part.ravel() for part in setup.discrete.constants]
    return np.concatenate([*parts, flatten(setup.friction.law_arguments()), flatten(setup.feedback_arguments)])


def _no_results(jobs: int) -> np.ndarray:
    from fraexp.kernels.batch import RESULT, WAITING

    results = np.zeros(jobs, RESULT)
    results["status"], results["place"], results["residual"] = WAITING, -1, np.nan
    return results


def _room(plans: list[_Plan], work: "KernelBatch", pools: list[np.ndarray]) -> int:
    """Return the numbers that the next results need, as far as can be guessed: one of them at least."""
    greatest = work.history.shape[1] + work.others[0].size
    guess = sum(plan.expected + work.others.shape[1] * plan.record for plan in plans)
    return max(greatest, min(guess, MOST_POOLED)) if pools or len(plans) == 1 else min(guess, MOST_POOLED)


def _share(weights: np.ndarray, plans: list[_Plan], work: "KernelBatch") -> float:
    """Return what is done at least of all experiments."""
    from fraexp.kernels.batch import DIVERGED, IDLE

    done = float(np.sum(weights[(work.results["place"] >= 0) | (work.results["status"] == DIVERGED)]))
    for lane in work.lanes:
        if lane["stage"] != IDLE:
            job = int(lane["job"])
            done += weights[job] * min(int(lane["elapsed"]) / max(plans[job].longest, 1), 0.9)
    return min(done, 1.0)
