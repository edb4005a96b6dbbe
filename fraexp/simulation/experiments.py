"""Experiments on the loop: a machine made ready, one period of an excitation on it, and both counted in samples."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import FrictionModel
from fraexp.components.parameters import Parameters, param
from fraexp.components.periods import Period, Schedule
from fraexp.data.signals import Segment, Settling
from fraexp.simulation.discretisation import DiscreteLoop

if TYPE_CHECKING:
    from fraexp.kernels.loop_laws import Laws

MIN_WINDOW_S = 0.1
"""Shortest time [s] over which two windows are compared: at 200 Hz a slow transient hardly changes in one period."""
QUICK_SETTLING_WINDOWS = 4
"""Windows that a machine needs which settles quickly."""


class Compensation(Parameters):
    """Friction compensation by feedback: a share of a friction model's force, driven by y', is added to the input."""

    gain: float = param("1", "share α of the friction model's force that is fed back", 1.0, at_least=0, at_most=100)
    friction: FrictionModel = param("", "friction model of the compensation", inherit="friction")

    def law_arguments(self, sample_time: float) -> tuple[Any, ...]:
        """Return gain, viscous coefficient, sample time and the arguments of the model's law."""
        return float(self.gain), float(self.friction.viscous), float(sample_time), self.friction.law_arguments()


@dataclass(frozen=True, eq=False)
class Setup:
    """A machine made ready: its loop in numbers. Those of one batch differ in these numbers alone.

    Two setups are equal only if they are one object: arrays have no single truth value to compare by, and experiments
    on the same machine share its setup.
    """

    frictions: Mapping[str, FrictionModel]
    """Friction model of each contact, by its name."""
    positions: tuple[str, ...]
    """Names of the measured positions; the first is fed back to the thrust that is excited."""
    discrete: DiscreteLoop
    sample_time: float
    """Sample time of the controller [s]."""
    input_delay: int
    """Whole samples of dead time before the thrust."""
    output_delay: int
    """Whole samples of dead time before the measurement."""
    delay: float
    """Time [s] after which a change of the control input shows in the measured position."""
    divergence_limit: float
    """Displacement that counts as diverged [m]."""
    is_vectorised: bool
    """Whether experiments run side by side, with explicit friction; else one by one, with implicit friction."""
    reference: float = 0.0
    """Position reference [m]."""
    resolution: float = 0.0
    """Quantisation step of the encoder [m]."""
    noise_std: float = 0.0
    """Standard deviation of the encoder's noise [m]."""
    seed: int = 0
    """Seed of the encoder's noise."""
    compensation: Compensation | None = None
    thrusts: tuple[str, ...] = ("thrust",)
    """Names of the thrusts that have a controller; the first is excited."""

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that are recorded; the first is the position that is fed back to the excited thrust."""
        return (
            "y",
            "u",
            *(of_contact("displacement", name, self.frictions) for name in self.frictions),
            *(of_contact("friction", name, self.frictions) for name in self.frictions),
            *(f"y.{name}" for name in self.positions[1:]),
            *(f"u.{name}" for name in self.thrusts[1:]),
            *(("compensation",) if self.compensation else ()),
        )

    @cached_property
    def constants(self) -> tuple[NDArray[np.float64], ...]:
        """Constants of the loop that the kernel takes."""
        return self.discrete.constants

    @cached_property
    def state_size(self) -> int:
        """Number of states of all friction laws."""
        return sum(model.state_size for model in self.frictions.values())

    @cached_property
    def law_arguments(self) -> tuple[Any, ...]:
        """Arguments that the kernel takes for the friction law, or for the one that chooses from several."""
        from fraexp.kernels.loop_laws import chosen_arguments

        models = list(self.frictions.values())
        return chosen_arguments([model.state_size for model in models], [model.law_arguments() for model in models])

    @property
    def compensation_arguments(self) -> tuple[Any, ...]:
        """Arguments that the kernel takes for the compensation; none without one."""
        return self.compensation.law_arguments(self.sample_time) if self.compensation else ()

    @cached_property
    def law_numbers(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """All numbers of the arguments of the friction law, and of the compensation, shape (n,) each."""
        from fraexp.kernels.law_arguments import flatten_arguments

        return flatten_arguments(self.law_arguments), flatten_arguments(self.compensation_arguments)

    @property
    def laws(self) -> "Laws":
        """Laws that are compiled for it."""
        from fraexp.kernels.law_arguments import argument_kinds
        from fraexp.kernels.loop_laws import Laws, chosen_law

        each = [model.velocity_law or model.law for model in self.frictions.values()]
        law = each[0] if len(each) == 1 else chosen_law(each)
        laws = Laws(law, argument_kinds(self.law_arguments), is_set_valued=set_valued_contacts(self.frictions))
        if self.compensation is None:
            return laws
        return laws._replace(
            compensation_law=self.compensation.friction.law,
            compensation_kinds=argument_kinds(self.compensation_arguments),
        )

    @property
    def steps(self) -> int:
        """Steps per sample."""
        return self.discrete.steps

    @property
    def numerics(self) -> str:
        """How it is computed, in words; stored with each sweep."""
        way = "force at the predicted displacement, in lanes" if self.is_vectorised else "force solved for implicitly"
        if any(set_valued_contacts(self.frictions)):
            way = "stick and slip within the step" + (", in lanes" if self.is_vectorised else "")
        return f"{self.steps} step{'s' if self.steps > 1 else ''} per sample, {way}"


def of_contact(channel: str, contact: str, contacts: Collection[str]) -> str:
    """Return the name of a channel of one contact; where there is only one, that of the channel alone."""
    return channel if len(contacts) == 1 else f"{channel}.{contact}"


def set_valued_contacts(frictions: Mapping[str, FrictionModel]) -> tuple[bool, ...]:
    """Return whether friction at each contact is a law of velocity that jumps at rest, solved for stick and slip."""
    return tuple(model.velocity_law is not None for model in frictions.values())


@dataclass(frozen=True)
class Experiment:
    """One period of an excitation on a machine, repeated from rest until the motion is periodic, and then recorded."""

    setup: Setup
    period: Period
    schedule: Schedule
    number: int
    """Index among the experiments of its sweep: the noise differs from one to the next."""


class DeliveredRecord(NamedTuple):
    """What the kernel says of an experiment that it has recorded."""

    is_settled: bool
    pool_index: int
    """Where its numbers begin in the pool."""
    lead_in: int
    """How many of the positions come before the record."""
    settling: int
    """Samples before the record."""
    residual: float
    """Relative difference of the last two windows."""


@dataclass(frozen=True)
class ExperimentPlan:
    """An experiment, counted in samples."""

    experiment: Experiment
    ramp: int
    """Samples before windows are compared."""
    window: int
    """Samples of a window, which is compared with the one before; 0 to record from the start."""
    settling_limit: int
    """Samples after which settling is given up."""
    periods: int
    """Periods that are recorded."""
    record: int
    """Samples that are recorded."""
    start_amplitude: float
    """Relative amplitude at the start."""
    amplitude_rise: float
    """Rise of the relative amplitude per sample."""

    @classmethod
    def from_experiment(cls, experiment: Experiment) -> "ExperimentPlan":
        """Return the plan of an experiment."""
        setup, schedule = experiment.setup, experiment.schedule
        period, sample_time = experiment.period.waveform.size, setup.sample_time
        periods = schedule.period_count(experiment.period, sample_time)
        if schedule.settling_timeout == 0:  # the transient itself is wanted
            return cls(experiment, 0, 0, 0, periods, periods * period, 1.0, 0.0)
        ramp = math.ceil((schedule.ramp + setup.delay) / sample_time)
        # A change cannot show before it has gone once around the loop: a window lasts at least as long.
        window = period * max(1, math.ceil(max(MIN_WINDOW_S, setup.delay) / (period * sample_time)))
        settling_limit = math.ceil(schedule.settling_timeout / sample_time)
        start_amplitude, rise = (0.0, sample_time / schedule.ramp) if schedule.ramp else (1.0, 0.0)
        return cls(experiment, ramp, window, settling_limit, periods, periods * period, start_amplitude, rise)

    @property
    def max_samples(self) -> int:
        """Greatest number of samples from rest to the end of the record."""
        return self.ramp + max(self.settling_limit, 2 * self.window) + self.window + self.record

    @cached_property
    def expected_samples(self) -> int:
        """Samples that a machine takes which settles quickly."""
        own_record = self.record if self.record > self.window else 0
        return self.ramp + QUICK_SETTLING_WINDOWS * self.window + own_record

    @property
    def noise_floor(self) -> float:
        """Difference of two windows that encoder and noise alone explain [m]."""
        setup = self.experiment.setup
        scatter = math.sqrt(2 * (setup.noise_std**2 + setup.resolution**2 / 12))
        return scatter * (1 + 3 / math.sqrt(2 * self.window)) if self.window else 0.0

    def read_segment(self, record: DeliveredRecord, pool: NDArray[np.float64]) -> Segment:
        """Return the recorded periods from the pool, where they lie as `record` says."""
        setup, period = self.experiment.setup, self.experiment.period
        begin, before, waited = record.pool_index, record.lead_in, record.settling
        lead_in, first, names = pool[begin : begin + before], begin + before, setup.channels
        numbers = pool[first : first + len(names) * self.record].reshape(len(names), self.periods, period.waveform.size)
        settling = Settling(record.is_settled, waited * setup.sample_time, record.residual)
        channels = dict(zip(names, numbers, strict=True))
        channels["excitation"] = _repeat_period(period.waveform, waited, self.periods)
        if period.reference is not None:
            channels["reference"] = setup.reference + _repeat_period(period.reference, waited, self.periods)
        return Segment(setup.sample_time, channels, period.lines, settling, {"y": lead_in} if before else {})


def _repeat_period(period: NDArray[np.float64], waited: int, count: int) -> NDArray[np.float64]:
    """Return a period `count` times, shape (count, n), beginning where it stood when the record began."""
    begin = waited % period.size
    shifted = np.concatenate([period[begin:], period[:begin]]) if begin else period
    return np.broadcast_to(shifted, (count, period.size)) if count > 1 else shifted.reshape(1, -1)
