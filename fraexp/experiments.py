"""Experiments on loops, run side by side: from machines and periods to segments."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fraexp.components import FrictionModel, Period, Schedule
from fraexp.discretisation import Discrete
from fraexp.errors import ParameterError
from fraexp.parameters import Parameters, param
from fraexp.signals import Segment, Settling

if TYPE_CHECKING:
    from fraexp.kernels.experiments import Jobs, Lanes, Results, Table

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
    from fraexp.kernels import experiments as kernel  # numba: imported only where a loop is run

    plans = [_Plan.of(experiment) for experiment in experiments]
    order = sorted(range(len(plans)), key=lambda k: -plans[k].expected)  # the longest first: lanes end together
    plans = [plans[k] for k in order]
    setup = experiments[0].setup
    jobs, table = _jobs(plans), _table(plans, setup)
    lanes = _lanes(plans, setup, table)
    results = _results(len(plans))
    friction, fed_back = setup.friction, setup.compensation
    laws, budget = (friction.law, (fed_back or setup).friction.law), max(AT_ONCE // setup.steps, 1)
    weights = np.array([plan.expected for plan in plans]) / sum(plan.expected for plan in plans)
    pools: list[np.ndarray] = []
    owner = np.full(len(plans), -1)
    status = kernel.FULL
    while status != kernel.DONE:
        if status == kernel.FULL:
            pools.append(np.empty(_room(plans, lanes, pools)))
            lanes.queue[kernel.USED] = 0
        status = kernel.advance(laws, jobs, table, lanes, results, pools[-1], budget)
        owner[(results.place >= 0) & (owner < 0)] = len(pools) - 1
        progress(_share(weights, plans, results, lanes))
    segments: list[Segment | None] = [None] * len(plans)
    for number, plan in enumerate(plans):
        if results.place[number] >= 0:
            segments[order[number]] = plan.segment(results, number, pools[owner[number]])
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

    def segment(self, results: "Results", number: int, pool: np.ndarray) -> Segment:
        """Return the recorded periods from the pool."""
        from fraexp.kernels.experiments import SETTLED

        sample_time, period = self.experiment.setup.sample_time, self.experiment.period
        begin, before, record = results.place[number], results.lead_in[number], self.record
        lead_in, first = pool[begin : begin + before], begin + before
        count = self.experiment.setup.channels
        numbers = pool[first : first + count * record].reshape(count, self.count, period.waveform.size)
        waited = int(results.settling[number])
        settling = Settling(
            bool(results.status[number] == SETTLED), waited * sample_time, float(results.residual[number])
        )
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


def _jobs(plans: list[_Plan]) -> "Jobs":
    from fraexp.kernels.experiments import Jobs

    setups = _setups(plans)
    sizes = [plan.experiment.period.waveform.size for plan in plans]
    return Jobs(
        machine=np.array([setups[id(plan.experiment.setup)] for plan in plans]),
        begin=np.cumsum([0, *sizes[:-1]]),
        period=np.array(sizes),
        ramp=np.array([plan.ramp for plan in plans]),
        stretch=np.array([plan.stretch for plan in plans]),
        limit=np.array([plan.limit for plan in plans]),
        record=np.array([plan.record for plan in plans]),
        base=np.array([plan.base for plan in plans]),
        rate=np.array([plan.rate for plan in plans]),
        tolerance=np.array([plan.experiment.schedule.tolerance for plan in plans]),
        floor=np.array([plan.floor for plan in plans]),
        seed=np.array([_seed(plan.experiment) for plan in plans], dtype=np.uint64),
    )


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


def _table(plans: list[_Plan], setup: Setup) -> "Table":
    from fraexp.kernels.experiments import Table

    different = {id(plan.experiment.setup): plan.experiment.setup for plan in plans}
    machines = np.array([_numbers(each) for each in different.values()])
    waves = [plan.experiment.period.waveform for plan in plans]
    silence = np.zeros(max(wave.size for wave in waves))
    states = setup.discrete.transition.shape[0]
    return Table(
        machines=machines,
        waves=np.concatenate([*waves, silence]),
        goals=_goals(plans, silence),
        settings=(setup.sample_time / setup.steps, setup.resolution, setup.noise, setup.stroke),
        sizes=(
            states, setup.steps, setup.friction.state_size, setup.discrete.numerator.size, *setup.dead_samples,
            setup.compensation.friction.state_size if setup.compensation else 0,
        ),
    )  # fmt: skip


def _goals(plans: list[_Plan], silence: np.ndarray) -> np.ndarray:
    """Return one reference per job [m], or all their samples where one of them moves."""
    rest = [plan.experiment.setup.reference for plan in plans]
    periods = [plan.experiment.period for plan in plans]
    if all(period.reference is None for period in periods):
        return np.array(rest)
    for period in periods:
        if period.reference is not None and period.reference.shape != period.waveform.shape:
            found = f"a reference of shape {period.reference.shape} beside a waveform of {period.waveform.shape}"
            raise ParameterError(f"the excitation gives {found}; expected equal shapes")
    moving = [np.zeros(p.waveform.size) if p.reference is None else p.reference for p in periods]
    return np.concatenate([*(place + goal for place, goal in zip(rest, moving, strict=True)), silence])


def _numbers(setup: Setup) -> np.ndarray:
    """Return constants and parameters of a machine, one after another."""
    from fraexp.kernels.storage import numbers

    parts = [part.ravel() for part in setup.discrete.constants]
    return np.concatenate([*parts, *numbers((setup.friction.law_arguments(), setup.feedback_arguments))])


def _lanes(plans: list[_Plan], setup: Setup, table: "Table") -> "Lanes":
    """Return lanes at rest with nothing to do."""
    from fraexp.kernels.experiments import IDLE, LEFT, STAGE, Lanes
    from fraexp.kernels.lanes import WIDTH
    from fraexp.kernels.loop import CONTACT, TRACED
    from fraexp.kernels.storage import views, zeros

    width = WIDTH if setup.wide else 1
    n, m, states, order, late, held, observed = table.sizes
    store = zeros(table.machines.shape[1], setup.wide)
    parts, used = [], 0
    for part in setup.discrete.constants:
        parts.append(store[used : used + part.size])
        used += part.size
    arguments, used = views(setup.friction.law_arguments(), store, used)
    compensation, _ = views(setup.feedback_arguments, store, used)
    memory = (n + 3, m + 1 + n, 2 * states, order, late + 2, held + 1, CONTACT, 2 * observed + 1)
    counters = np.zeros((width, 7), dtype=np.int64)
    counters[:, STAGE] = IDLE
    compared = max(2 * plan.stretch + plan.record for plan in plans)
    room = max(min(max(plan.longest for plan in plans), REMEMBERED), compared)
    counters[:, LEFT] = 0
    return Lanes(
        constants=tuple(parts),
        arguments=arguments,
        compensation=compensation,
        store=store,
        memory=tuple(zeros(size, setup.wide) for size in memory),
        drive=zeros(5, setup.wide),
        trace=zeros(TRACED, setup.wide),
        counters=counters,
        agreement=np.zeros((width, 2)),
        history=np.empty((width, room)),
        others=np.empty((width, setup.channels - 1, max(plan.record for plan in plans))),
        queue=np.zeros(3, dtype=np.int64),
    )


def _results(jobs: int) -> "Results":
    from fraexp.kernels.experiments import WAITING, Results

    return Results(
        status=np.full(jobs, WAITING),
        place=np.full(jobs, -1),
        lead_in=np.zeros(jobs, dtype=np.int64),
        settling=np.zeros(jobs, dtype=np.int64),
        residual=np.full(jobs, np.nan),
    )


def _room(plans: list[_Plan], lanes: "Lanes", pools: list[np.ndarray]) -> int:
    """Return the numbers that the next results need, as far as can be guessed: one of them at least."""
    greatest = lanes.history.shape[1] + lanes.others[0].size
    guess = sum(plan.expected + lanes.others.shape[1] * plan.record for plan in plans)
    return max(greatest, min(guess, MOST_POOLED)) if pools or len(plans) == 1 else min(guess, MOST_POOLED)


def _share(weights: np.ndarray, plans: list[_Plan], results: "Results", lanes: "Lanes") -> float:
    """Return what is done at least of all experiments."""
    from fraexp.kernels.experiments import DIVERGED, ELAPSED, IDLE, JOB, STAGE

    done = float(np.sum(weights[(results.place >= 0) | (results.status == DIVERGED)]))
    for counters in lanes.counters:
        if counters[STAGE] != IDLE:
            job = counters[JOB]
            done += weights[job] * min(counters[ELAPSED] / max(plans[job].longest, 1), 0.9)
    return min(done, 1.0)
