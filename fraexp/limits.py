"""What an experiment may ask of a machine, checked before it is run."""

from typing import NamedTuple

import numpy as np

from fraexp.components import Excitation, Period
from fraexp.delays import hold_response, path_response
from fraexp.errors import ParameterError
from fraexp.parameters import Parameters, param
from fraexp.simulation import Machine


class Limits(Parameters):
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


def check(limits: Limits, machine: Machine, excitation: Excitation) -> None:
    """Raise ParameterError if a period of the excitation is predicted to exceed a limit: the message names the first.

    The prediction is that of the linear loop in its periodic state; friction makes a motion smaller in general.
    """
    sample_time = machine.loop.sample_time
    for period in excitation.periods(sample_time):
        demand = predicted(machine, period)
        for name, found, unit in zip(Demand._fields, demand, UNITS, strict=True):
            allowed = getattr(limits, name)
            if allowed is not None and found > allowed:
                frequency = period.lines[0] / (period.waveform.size * sample_time)
                raise ParameterError(
                    f"{excitation.name} from {frequency:.4g} Hz is predicted to need a {name} of {found:.4g} {unit} "
                    f"without friction; limits.{name} is {allowed:g} {unit}: lower the amplitude, or leave out the "
                    "frequencies that need it"
                )


def predicted(machine: Machine, period: Period) -> Demand:
    """Return what a period needs on the machine without friction, but for its viscous part."""
    loop, samples = machine.loop, period.waveform.size
    omega = 2 * np.pi * np.fft.rfftfreq(samples, loop.sample_time)[1:]
    path_in = path_response(omega, loop.input_dead_time, loop.input_lags) * hold_response(omega, loop.sample_time)
    path_out = path_response(omega, loop.output_dead_time, loop.output_lags)
    free = machine.plant.response(omega)
    plant = free / (1 + 1j * omega * machine.friction.viscous * free)
    feedback = machine.controller.response(omega, loop.sample_time)
    sensitivity = 1 / (1 + feedback * path_in * plant * path_out)
    rest = np.zeros(samples) if period.reference is None else period.reference
    disturbance, reference = np.fft.rfft(period.waveform)[1:], np.fft.rfft(rest)[1:]
    force = sensitivity * (disturbance + feedback * reference)
    motion = path_in * plant * force
    wave, velocity, control = (_wave(bins, samples) for bins in (motion, 1j * omega * motion, force))
    greatest = max(float(np.abs(control).max()), float(np.abs(period.waveform).max()))
    return Demand(float(np.ptp(wave)), float(np.abs(velocity).max()), greatest)


def _wave(bins: np.ndarray, samples: int) -> np.ndarray:
    return np.fft.irfft(np.concatenate([[0.0], bins]), samples)
