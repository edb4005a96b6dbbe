"""A modelled machine along a record: the positions that it takes where the recorded control input drives it.

A record does not tell its controller, and a mass that slides freely would drift off from its recorded position. The
model is therefore pulled towards it by a controller of its own. A strong one holds a model that is wrong, and takes
noise of the record into it; a weak one only ends an offset, and leaves the noise in the difference to the record.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import FrictionModel
from fraexp.components.periods import Period, Schedule
from fraexp.components.ports import Ports
from fraexp.simulation.discretisation import SignalPath, discretise, split_dead_time
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, Setup, set_valued_contacts
from fraexp.simulation.loop_setup import accurate_steps, is_friction_soft

PULL_RATIO, MAX_PULL_HZ = 1.0, 8.0
"""Crossover frequency of the pull over the geometric mean of a record's frequencies, and its greatest value [Hz]."""
WEAK_RATIO, MAX_WEAK_RATE = 0.8, 8.0
"""Rate of decay of an offset under a weak pull over the lowest frequency of a record, and its greatest value [1/s]."""
LEAD_RATIO = 10.0
"""Pole over zero of the pull, a lead."""
RAMP_CYCLES = 8.0
"""Cycles over which the input of a law rises that keeps an offset of its start for long."""
SETTLING_CYCLES, MIN_SETTLING_S = 40.0, 3.0
"""Cycles, and least time [s], after which a motion counts as it is."""
COARSE_TOLERANCES = (1e-3, 2e-4)
"""Relative errors of coarse steps, the first of which that suits a machine is taken."""
MAX_DISPLACEMENT_M = 1e3
"""Displacement at which a model counts as diverged [m]: any that an axis may have is far below."""


@dataclass(frozen=True, eq=False)
class ReplayModel:
    """A modelled machine: its plant, friction at each contact, and the delays around them."""

    ports: Ports
    """The plant; its first thrust is driven, its first position compared."""
    frictions: Mapping[str, FrictionModel]
    """Friction model of each contact, by its name."""
    sample_time: float
    """Sample time [s]."""
    input_path: tuple[float, tuple[float, ...]]
    """Dead time and time constants of the lags before the thrust [s]."""
    output_path: tuple[float, tuple[float, ...]]
    """The same before the sample of the position."""
    tolerance: float
    """Relative change over a period from which the motion is periodic, and the error that the steps may cause."""
    step_tolerance: float = 0.0
    """Relative error of the motion that the steps may cause, if it is another one."""
    refinement: int = 1
    """Factor on the steps per sample that the tolerance needs."""
    scales: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Factors on force and deflection of a contact's friction, by its name; 1 for those that are not given."""

    @property
    def steps(self) -> int:
        """Steps per sample."""
        tolerance = self.step_tolerance or self.tolerance
        return self.refinement * accurate_steps(self.ports, self.frictions, self.sample_time, tolerance)

    def with_coarse_steps(self) -> "ReplayModel":
        """Return the model with the fewest steps with which a small change of it still shows, and that run in lanes.

        Differences of two replays need no more: the error of the steps is common to both.
        """
        for tolerance in COARSE_TOLERANCES:
            coarse = replace(self, step_tolerance=tolerance, refinement=1)
            if coarse.steps >= self.steps:
                break
            if _free_setup(coarse).is_vectorised:
                return coarse
        return self

    def with_steps_of(self, other: "ReplayModel") -> "ReplayModel":
        """Return the model with steps of the tolerance and refinement of another one."""
        return replace(self, step_tolerance=other.step_tolerance, refinement=other.refinement)

    def with_scales(self, scales: Mapping[str, tuple[float, float]]) -> "ReplayModel":
        """Return the model with such factors on force and deflection of its friction."""
        return replace(self, scales=dict(scales))

    def with_frictions(self, frictions: Mapping[str, FrictionModel]) -> "ReplayModel":
        """Return the model with other friction models of the same law."""
        return replace(self, frictions=dict(frictions))


class Replay(NamedTuple):
    """A model that is driven along a record."""

    model: ReplayModel
    control_input: NDArray[np.float64]
    """Control input of all recorded periods [N], shape (n,)."""
    position: NDArray[np.float64]
    """Recorded position [m], shape (n,)."""
    frequency: NDArray[np.float64]
    """Excited frequencies of the record [Hz], shape (lines,)."""
    damping: float | None = None
    """Force over velocity of friction along the record [N s/m], by which the pull is made so weak that it just ends an
    offset in time; None for a strong one, which holds a model that is wrong."""


class _Pull(NamedTuple):
    """A pull towards the record."""

    rate: float
    """Crossover frequency [Hz] of a strong pull, rate of decay [1/s] of an offset that a weak one ends."""
    damping: float = 0.0
    """Damping of the motion that a weak one expects [N s/m]; 0 for a strong one."""

    def controller(self, model: ReplayModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return its lead for a model, in ascending powers of z⁻¹."""
        gain, zero = self._weak(model) if self.damping else self._strong(model)
        pole, sample_time = zero / LEAD_RATIO, model.sample_time
        numerator = gain * np.array([1 + zero / sample_time, -zero / sample_time])
        denominator = np.array([1 + pole / sample_time, -pole / sample_time])
        return numerator / denominator[0], denominator / denominator[0]

    def _strong(self, model: ReplayModel) -> tuple[float, float]:
        """Return gain [N/m] and zero [s] of a lead that crosses over the plant.

        The plant moves against its viscous friction [N s/m]: where that is more than its inertia, a pull that overcomes
        the inertia alone takes minutes to end an offset.
        """
        omega, viscous = 2 * np.pi * self.rate, sum(friction.viscous for friction in model.frictions.values())
        impedance = abs(_inverse_response(model, omega) + 1j * omega * viscous)
        return float(impedance / np.sqrt(LEAD_RATIO)), float(np.sqrt(LEAD_RATIO) / omega)

    def _weak(self, model: ReplayModel) -> tuple[float, float]:
        """Return gain and zero with which an offset of the rigid body decays against the damping, and a fast one rings
        no longer.
        """
        mass = max(-_inverse_response(model, self.rate).real / self.rate**2, 0.0)
        damping = max(self.damping, 2 * mass * self.rate)
        return damping * self.rate, (1 - self.damping / damping) / self.rate


@lru_cache(maxsize=4096)
def _inverse_response(model: ReplayModel, omega: float) -> complex:
    """Return 1/P(jω) of the plant alone [N/m]."""
    return complex(1 / model.ports.response(np.array([omega]))[0])


def _step_down(value: float, octaves: float = 0.5) -> float:
    """Return a value to the next lower power of 2 to the octaves: few controllers, whose constants are kept."""
    return float(2.0 ** (np.floor(np.log2(value) / octaves) * octaves))


class Replayed(NamedTuple):
    """What a replay gives."""

    position: NDArray[np.float64]
    """Periodic position that the model takes [m], without rounding, shape (n,); NaN if it diverges."""
    is_settled: bool
    """Whether it is known to repeat itself: a long record may leave no time to see that."""


def replay(runs: Sequence[Replay]) -> list[Replayed]:
    """Return the motion of each model."""
    experiments = [_experiment(run, number) for number, run in enumerate(runs)]
    replayed = [Replayed(np.full(run.position.size, np.nan), False) for run in runs]
    for group in _alike(experiments):
        segments = run_experiments([experiments[place] for place in group], lambda _: None)
        for place, segment in zip(group, segments, strict=True):
            if segment is not None and segment.settling is not None:
                waited = round(segment.settling.time / segment.sample_time)
                position = np.roll(segment.channels["y"][0], waited % runs[place].position.size)
                replayed[place] = Replayed(position, segment.settling.settled)
    return replayed


def _alike(experiments: Sequence[Experiment]) -> list[list[int]]:
    """Return the places of experiments that can run side by side."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for place, experiment in enumerate(experiments):
        setup = experiment.setup
        # A law may have fewer elements with other parameters, and a loop other constants with another dead time.
        shapes = tuple(part.shape for part in (*setup.constants, *setup.law_numbers))
        alike = setup.steps, setup.is_vectorised, setup.input_delay, setup.output_delay, shapes
        groups.setdefault(alike, []).append(place)
    return list(groups.values())


def _experiment(run: Replay, number: int) -> Experiment:
    lowest, middle = float(run.frequency.min()), float(np.exp(np.mean(np.log(run.frequency))))
    if run.damping is None:
        pull = _Pull(_step_down(min(PULL_RATIO * middle, MAX_PULL_HZ), 1.0))
    else:
        pull = _Pull(_step_down(min(WEAK_RATIO * lowest, MAX_WEAK_RATE)), _step_down(run.damping))
    forgets = all(friction.has_unique_periodic_force for friction in run.model.frictions.values())
    ramp = 0.0 if forgets else RAMP_CYCLES / lowest
    timeout = ramp + max(SETTLING_CYCLES / lowest, MIN_SETTLING_S)
    line = max(round(lowest * run.position.size * run.model.sample_time), 1)
    period = Period(run.control_input, np.array([line]), run.position)
    schedule = Schedule(ramp, run.model.tolerance, timeout)
    return Experiment(_setup(run.model, pull), period, schedule, number)


@lru_cache(maxsize=4096)
def _setup(model: ReplayModel, pull: _Pull) -> Setup:
    """Return the loop of a model that is pulled."""
    numerator, denominator = pull.controller(model)
    free = _free_setup(model)
    return replace(free, discrete=free.discrete._replace(numerator=numerator[None], denominator=denominator[None]))


@lru_cache(maxsize=4096)
def _free_setup(model: ReplayModel) -> Setup:
    """Return the loop of a model that nothing pulls: that of all pulls but for the controller."""
    sample_time, inward, outward = model.sample_time, SignalPath(*model.input_path), SignalPath(*model.output_path)
    ports, viscous = _scaled(model)
    discrete = discretise(
        ports,
        viscous,
        [(np.zeros(1), np.ones(1))],
        sample_time=sample_time,
        steps=model.steps,
        is_force_held=set_valued_contacts(model.frictions),
        input_path=inward,
        output_path=outward,
    )
    lags = sum(inward.lags) + sum(outward.lags)
    return Setup(
        frictions=model.frictions,
        positions=tuple(ports.positions),
        discrete=discrete,
        sample_time=sample_time,
        input_delay=split_dead_time(inward.dead_time, sample_time).samples,
        output_delay=split_dead_time(outward.dead_time, sample_time).samples,
        delay=inward.dead_time + outward.dead_time + 5 * lags,
        divergence_limit=MAX_DISPLACEMENT_M,
        is_vectorised=is_friction_soft(model.frictions, discrete, sample_time)
        and all(friction.is_vectorisable for friction in model.frictions.values()),
    )


def _scaled(model: ReplayModel) -> tuple[Ports, dict[str, float]]:
    """Return the plant to which friction of other scales looks like the given one, and its viscous coefficients.

    A law of the force s f(y/c) is the law f between a displacement row that is divided by c and a force column times s.
    """
    contacts, viscous = {}, {}
    for name, contact in model.ports.contacts.items():
        force, displacement = model.scales.get(name, (1.0, 1.0))
        contacts[name] = replace(contact, force=contact.force * force, displacement=contact.displacement / displacement)
        viscous[name] = model.frictions[name].viscous * displacement / force
    return replace(model.ports, contacts=contacts), viscous
