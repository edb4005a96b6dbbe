"""What an experiment may ask of a machine, checked before it is run."""

from typing import NamedTuple

import numpy as np

from fraexp.analysis.delays import hold_response, path_response
from fraexp.components.kinds import Excitation, Period
from fraexp.components.parameters import Parameters, param
from fraexp.errors import ParameterError
from fraexp.simulation.machine import Machine


class MotionLimits(Parameters):
    """The greatest stroke, velocity and force that a machine allows; what is not given is not checked."""

    stroke: float | None = param("m", "greatest way between both ends of the motion", None, above=0)
    velocity: float | None = param("m/s", "greatest velocity", None, above=0)
    force: float | None = param("N", "greatest control input", None, above=0)


class Demand(NamedTuple):
    """What a period asks of a machine."""

    stroke: float
    """Way between both ends of the motion [m]."""
    velocity: float
    """Greatest velocity [m/s]."""
    force: float
    """Greatest control input [N]."""


UNITS = ("m", "m/s", "N")
SHORTEST_SILENCE, LONGEST_SILENCE = 1.0, 64
"""Time after a motion that starts from rest in which the loop comes to rest again: at least [s], and in motions."""
REST = 1e-3
"""Share of the motion that is rest."""


def check(limits: MotionLimits, machine: Machine, excitation: Excitation) -> None:
    """Raise ParameterError if a period of the excitation is predicted to exceed a limit: the message names the first.

    The prediction is that of the linear loop: in its periodic state, or on its way from rest where the schedule does
    not wait for that state. Friction makes a motion smaller in general; the force that overcomes it on a moving axis,
    and what compensation feeds back, are added. What an excitation revises its periods to is its own to know.
    """
    sample_time, schedule = machine.loop.sample_time, excitation.schedule
    settles = schedule.settle_limit > 0
    for period in excitation.periods(sample_time):
        if settles:
            demand = predicted(machine, period)
        elif period.reference is not None and machine.friction.force_bound:
            demand = _planned(period, sample_time)
        else:
            demand = predicted_from_rest(machine, period, schedule.periods)
        demand = _with_friction(demand, machine, period, excitation)
        for name, found, unit in zip(Demand._fields, demand, UNITS, strict=True):
            allowed = getattr(limits, name)
            if allowed is not None and found > allowed:
                frequency = period.lines[0] / (period.waveform.size * sample_time)
                what = f"{excitation.name} from {frequency:.4g} Hz" if settles else excitation.name
                remedy = (
                    "lower the amplitude, or leave out the frequencies that need it"
                    if settles
                    else "ask for less, or take more time"
                )
                raise ParameterError(
                    f"{what} is predicted to need a {name} of {found:.4g} {unit}; "
                    f"limits.{name} is {allowed:g} {unit}: {remedy}"
                )


def _planned(period: Period, sample_time: float) -> Demand:
    """Return what a move needs that goes as its reference says: what is fed forward against friction is spent on it."""
    course = np.asarray(period.reference)
    velocity = float(np.abs(np.diff(course)).max()) / sample_time
    return Demand(float(np.ptp(course)), velocity, float(np.abs(period.waveform).max()))


def _with_friction(demand: Demand, machine: Machine, period: Period, excitation: Excitation) -> Demand:
    """Return the demand with what friction and its compensation add, or with what revised periods may ask for."""
    force = demand.force
    if period.reference is not None and excitation.schedule.settle_limit > 0:
        force += machine.friction.force_bound or 0.0
    if machine.compensation:
        force += machine.compensation.gain * (machine.compensation.friction.force_bound or 0.0)
    greatest, stroke = excitation.greatest()
    if stroke is None:
        return Demand(demand.stroke, demand.velocity, greatest or force)
    omega = 2 * np.pi * period.lines[-1] / (period.waveform.size * machine.loop.sample_time)
    return Demand(stroke, float(omega * stroke / 2), greatest or force)


def predicted(machine: Machine, period: Period) -> Demand:
    """Return what a period needs on the machine without friction, but for its viscous part, once it repeats itself."""
    rest = np.zeros(period.waveform.size) if period.reference is None else period.reference
    return _demand(*_periodic(machine, period.waveform, rest), period.waveform)


def predicted_from_rest(machine: Machine, period: Period, periods: int) -> Demand:
    """Return what `periods` of a period need on that machine, which rests before.

    The course from rest is that of a period that goes on with silence until the loop is at rest again.
    """
    waveform, rest = (
        np.tile(np.zeros(period.waveform.size) if part is None else part, periods)
        for part in (period.waveform, period.reference)
    )
    silence = np.zeros(_next_power(waveform.size + SHORTEST_SILENCE / machine.loop.sample_time) - waveform.size)
    while True:
        courses = _periodic(machine, np.append(waveform, silence), np.append(rest, silence))
        motion, velocity, force = (course - course[-1] for course in courses)  # at rest, which tells the mean
        still = np.abs(motion[-silence.size // 4 :]).max() < REST * np.abs(motion).max()
        if still or silence.size > LONGEST_SILENCE * waveform.size:
            n = waveform.size
            return _demand(motion[:n], velocity[:n], force[:n], waveform)
        silence = np.zeros(2 * (silence.size + waveform.size) - waveform.size)


def _next_power(samples: float) -> int:
    return 1 << int(np.ceil(np.log2(samples)))


def _periodic(
    machine: Machine, waveform: np.ndarray, reference: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return displacement [m], velocity [m/s] and control input [N] without their means, each of shape (n,)."""
    loop, samples = machine.loop, waveform.size
    omega = 2 * np.pi * np.fft.rfftfreq(samples, loop.sample_time)[1:]
    path_in = path_response(omega, loop.input_dead_time, loop.input_lags) * hold_response(omega, loop.sample_time)
    path_out = path_response(omega, loop.output_dead_time, loop.output_lags)
    free = machine.plant.response(omega)
    plant = free / (1 + 1j * omega * machine.friction.viscous * free)
    feedback = machine.controller.response(omega, loop.sample_time)
    sensitivity = 1 / (1 + feedback * path_in * plant * path_out)
    force = sensitivity * (np.fft.rfft(waveform)[1:] + feedback * np.fft.rfft(reference)[1:])
    motion = path_in * plant * force
    return _wave(motion, samples), _wave(1j * omega * motion, samples), _wave(force, samples)


def _demand(motion: np.ndarray, velocity: np.ndarray, force: np.ndarray, waveform: np.ndarray) -> Demand:
    greatest = max(float(np.abs(force).max()), float(np.abs(waveform).max()))
    return Demand(float(np.ptp(motion)), float(np.abs(velocity).max()), greatest)


def _wave(bins: np.ndarray, samples: int) -> np.ndarray:
    return np.fft.irfft(np.concatenate([[0.0], bins]), samples)
