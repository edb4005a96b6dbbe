"""Limits of a machine's motion, and the prediction by which an experiment is checked against them before it is run."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.delays import hold_response, path_response
from fraexp.components.kinds import Excitation
from fraexp.components.parameters import Parameters, param
from fraexp.components.periods import Period
from fraexp.data.rotary_axes import rotary_unit
from fraexp.errors import ParameterError
from fraexp.simulation.machine import Machine


class MotionLimits(Parameters):
    """The greatest motion and force that a machine allows, with their rates; a limit that is not given is not checked.

    `fraexp measure` and `fraexp excite` play nothing unless stroke, velocity and force are limited.
    """

    stroke: float | None = param("m", "greatest distance between both ends of the motion", None, above=0)
    velocity: float | None = param("m/s", "greatest velocity", None, above=0)
    acceleration: float | None = param("m/s^2", "greatest acceleration", None, above=0)
    force: float | None = param("N", "greatest control input", None, above=0)
    force_rate: float | None = param("N/s", "greatest rate of the control input, from sample to sample", None, above=0)


PATH_RATIO = 0.21
"""How far a path goes beyond its samples, over its second difference: an eighth for a sine of many samples a period,
(1 - cos 45°)/(2 cos 45°) for one of four."""


class Demand(NamedTuple):
    """What a motion asks of a machine, by the names of its limits."""

    stroke: float
    """Distance between both ends of the motion [m]."""
    velocity: float
    """Greatest velocity [m/s]."""
    acceleration: float
    """Greatest acceleration [m/s²]."""
    force: float
    """Greatest control input [N]."""
    force_rate: float
    """Greatest rate of the control input [N/s]."""

    @classmethod
    def of_samples(
        cls,
        displacement: NDArray[np.float64],
        control_input: NDArray[np.float64],
        sample_time: float,
        compliance: float = 0.0,
    ) -> "Demand":
        """Return what a sampled motion asks for; both are of shape (n,).

        Stroke and velocity are the greatest ones between samples. While a force is held, a velocity differs from its
        mean over a sample by half of the change from one sample to the next. That of a force which alternates from
        sample to sample is not seen in the samples; it follows from `compliance`, how far 1 N that is held for one
        sample moves the machine [m/N].
        """
        velocity = np.abs(np.diff(displacement)) / sample_time
        change = np.abs(np.diff(displacement, 2, prepend=displacement[0], append=displacement[-1])) / sample_time
        alternation = np.abs(np.diff(control_input, 2)).max(initial=0.0) / 4  # of the force about its mean
        hidden = 2 * compliance * alternation / sample_time
        bend = PATH_RATIO * (change + hidden) * sample_time
        return cls(
            stroke=float((displacement + bend).max() - (displacement - bend).min()),
            velocity=float((velocity + np.maximum(change[1:], change[:-1]) / 2).max(initial=0.0)) + float(hidden / 2),
            acceleration=float(change[1:-1].max(initial=0.0)) / sample_time,
            force=float(np.abs(control_input).max()),
            force_rate=float(np.abs(np.diff(control_input)).max(initial=0.0)) / sample_time,
        )

    def maximum_with(self, other: "Demand") -> "Demand":
        """Return the greater of each demand; one that is not a number, of a motion that diverges, stays so."""
        return Demand(*np.maximum(self, other).tolist())


def demand_name(name: str) -> str:
    """Return in words one of what a motion asks for, by its name."""
    return f"{'an' if name.startswith('a') else 'a'} {name.replace('_', ' ')}"


NO_DEMAND = Demand(0.0, 0.0, 0.0, 0.0, 0.0)
"""Of nothing that moves, or where nothing is predicted."""


class _Motion(NamedTuple):
    """The linear loop's motion over a period, at its samples and perhaps between them; the force at its samples."""

    displacement: NDArray[np.float64]
    """Displacement [m]."""
    velocity: NDArray[np.float64]
    """Velocity [m/s]."""
    acceleration: NDArray[np.float64]
    """Acceleration [m/s²]."""
    force: NDArray[np.float64]
    """Control input [N]."""


DEMAND_UNITS = ("m", "m/s", "m/s^2", "N", "N/s")
MIN_SILENCE_S, MAX_SILENCE_MOTIONS = 1.0, 64
"""Time after a motion from rest in which the loop comes to rest again: the shortest [s], the longest in motions."""
MIN_MOTION_POINTS = 64
"""Points of a period at which its motion is computed at least: between few samples it goes much further."""
NOISE_RESERVE, NOISE_FREQUENCIES = 3.0, 1 << 13
"""Standard deviations by which the greatest of a play's noise may exceed that of another, about 3 to 4 of them: once in
ten million plays of a thousand samples. Number of frequencies at which it is computed."""
REST_RATIO = 1e-3
"""Displacement that counts as rest, relative to the greatest one."""


def check_limits(limits: MotionLimits, machine: Machine, excitation: Excitation) -> None:
    """Raise ParameterError if a period of the excitation is predicted to exceed a limit: the message names the first.

    The linear loop is the prediction: its periodic state, or its motion from rest where the schedule does not wait for
    that state. Friction makes a motion smaller in general. The force that overcomes it on a moving axis, and the force
    of its compensation, are added. For periods that an excitation revises, its own statement counts.
    """
    sample_time, schedule = machine.loop.sample_time, excitation.schedule
    settles = schedule.settling_timeout > 0
    for period in excitation.periods(sample_time):
        if settles:
            demand = predict_demand(machine, period)
        elif period.reference is not None and _friction_bound(machine):
            demand = Demand.of_samples(np.asarray(period.reference), period.waveform, sample_time)
        else:
            demand = predict_demand_from_rest(machine, period, period.recorded_periods or schedule.recorded_periods)
        demand = _add_friction(demand, machine, period, excitation)
        for name, found, straight_unit in zip(Demand._fields, demand, DEMAND_UNITS, strict=True):
            allowed = getattr(limits, name)
            if allowed is not None and found > allowed:
                unit = rotary_unit(straight_unit) if machine.loop.rotary else straight_unit
                frequency = period.lines[0] / (period.waveform.size * sample_time)
                what = f"{excitation.name} from {frequency:.4g} Hz" if settles else excitation.name
                remedy = (
                    "lower the amplitude, or leave out the frequencies that need it"
                    if settles
                    else "ask for less, or take more time"
                )
                raise ParameterError(
                    f"{what} is predicted to need {demand_name(name)} of {found:.4g} {unit}; "
                    f"limits.{name} is {allowed:g} {unit}: {remedy}"
                )


def _add_friction(demand: Demand, machine: Machine, period: Period, excitation: Excitation) -> Demand:
    """Return the demand with what friction and its compensation add, or with what revised periods may ask for."""
    force = demand.force
    if period.reference is not None and excitation.schedule.settling_timeout > 0:
        force += _friction_bound(machine)
    if machine.compensation:
        force += machine.compensation.gain * (machine.compensation.friction.force_bound or 0.0)
    max_force, stroke = excitation.max_force_and_stroke()
    if max_force and demand.force:
        force, demand = max_force, demand._replace(force_rate=demand.force_rate * max_force / demand.force)
    if stroke is None:
        return demand._replace(force=force)
    omega = float(2 * np.pi * period.lines[-1] / (period.waveform.size * machine.loop.sample_time))
    return Demand(stroke, omega * stroke / 2, omega**2 * stroke / 2, force, demand.force_rate)


def _friction_bound(machine: Machine) -> float:
    """Return the greatest friction force of all contacts [N], as far as it is known."""
    return sum(model.force_bound or 0.0 for model in machine.frictions.values())


def predict_demand(machine: Machine, period: Period) -> Demand:
    """Return what a period needs in its periodic state, on the machine without friction but for its viscous part."""
    reference = np.zeros(period.waveform.size) if period.reference is None else period.reference
    return _measure_demand(_periodic_motion(machine, period.waveform, reference), period.waveform, machine)


def predict_demand_from_rest(machine: Machine, period: Period, periods: int) -> Demand:
    """Return what `periods` of a period need from rest, on the machine without friction but for its viscous part.

    The motion from rest is that of a longer period, which goes on with silence until the loop is at rest again.
    """
    waveform, reference = (
        np.tile(np.zeros(period.waveform.size) if part is None else part, periods)
        for part in (period.waveform, period.reference)
    )
    least = waveform.size + MIN_SILENCE_S / machine.loop.sample_time
    silence = np.zeros((1 << int(np.ceil(np.log2(least)))) - waveform.size)
    while True:
        periodic = _periodic_motion(machine, np.append(waveform, silence), np.append(reference, silence))
        motion = _Motion(*(part - part[-1] for part in periodic))  # it ends at rest, which is where it began
        final = np.abs(motion.displacement[-silence.size // 4 :]).max()
        is_at_rest = final < REST_RATIO * np.abs(motion.displacement).max()
        if is_at_rest or silence.size > MAX_SILENCE_MOTIONS * waveform.size:
            return _measure_demand(_Motion(*(part[: waveform.size] for part in motion)), waveform, machine)
        silence = np.zeros(2 * (silence.size + waveform.size) - waveform.size)


def _periodic_motion(machine: Machine, waveform: NDArray[np.float64], reference: NDArray[np.float64]) -> _Motion:
    """Return the linear loop's periodic motion, without means."""
    samples = waveform.size
    omega = 2 * np.pi * np.fft.rfftfreq(samples, machine.loop.sample_time)[1:]
    moved, sensitivity, feedback = _loop_responses(machine, omega)
    force = sensitivity * (np.fft.rfft(waveform)[1:] + feedback * np.fft.rfft(reference)[1:])
    motion = moved * force
    bins = (motion, 1j * omega * motion, -(omega**2) * motion)
    fine = samples * max(MIN_MOTION_POINTS // samples, 1)
    displacement, velocity, acceleration = (_synthesise(each, samples, fine) for each in bins)
    return _Motion(displacement, velocity, acceleration, _synthesise(force, samples, samples))


def encoder_noise_demand(machine: Machine) -> Demand:
    """Return what the encoder's noise may add to a motion that is simulated with other noise of the same size.

    Nobody knows the greatest of noise before: it is NOISE_RESERVE standard deviations, in the linear loop, above the
    greatest of that which is simulated. A quantisation step counts as noise: when it comes is chance, too.
    """
    loop = machine.loop
    noise = float(np.hypot(loop.noise, loop.resolution / np.sqrt(12)))
    if not noise:
        return NO_DEMAND
    omega = (np.arange(NOISE_FREQUENCIES) + 0.5) / NOISE_FREQUENCIES * np.pi / loop.sample_time
    moved, sensitivity, feedback = _loop_responses(machine, omega)
    force = feedback * sensitivity
    rate = 2 * np.sin(omega * loop.sample_time / 2) / loop.sample_time * force
    motion = moved * force
    parts = (2 * motion, omega * motion, omega**2 * motion, force, rate)
    return Demand(*(NOISE_RESERVE * noise * float(np.sqrt(np.mean(np.abs(part) ** 2))) for part in parts))


def _loop_responses(machine: Machine, omega: NDArray[np.floating]) -> tuple[NDArray[np.complex128], ...]:
    """Return displacement over force, sensitivity and controller of the linear loop, each of the shape of `omega`."""
    loop = machine.loop
    path_in = path_response(omega, loop.input_dead_time, loop.input_time_constants) * hold_response(
        omega, loop.sample_time
    )
    path_out = path_response(omega, loop.output_dead_time, loop.output_time_constants)
    plant = _viscous_plant(machine, omega)
    controller, *others = machine.controllers.values()
    if others:
        thrusts = ", ".join(machine.controllers)
        raise ParameterError(
            f"motions are predicted for one controller; there are several ({thrusts}): omit [limits] to simulate the "
            "machine; it cannot be measured"
        )
    feedback = controller.response(omega, loop.sample_time)
    return path_in * plant, 1 / (1 + feedback * path_in * plant * path_out), feedback


def _viscous_plant(machine: Machine, omega: NDArray[np.floating]) -> NDArray[np.complex128]:
    """Return the response of the position that is fed back to the thrust [m/N], with viscous friction alone."""
    loop, frictions = machine.loop, machine.frictions
    if len(frictions) == 1 and not (loop.thrust or loop.position):
        viscous, free = sum(model.viscous for model in frictions.values()), machine.response(omega)
        return np.asarray(free / (1 + 1j * omega * viscous * free))
    ports, a = machine.ports, machine.ports.a.copy()
    for name, contact in ports.contacts.items():
        a -= frictions[name].viscous * np.outer(contact.force, contact.displacement @ ports.a)
    return replace(ports, a=a).response(omega)


def _measure_demand(motion: _Motion, waveform: NDArray[np.float64], machine: Machine) -> Demand:
    """Return what a motion asks for; its force is the control input, or the excitation alone if that is greater."""
    parts = [motion.force, waveform]
    force, rate = (max(float(np.abs(change(part)).max()) for part in parts) for change in (np.asarray, np.diff))
    velocity, acceleration = (float(np.abs(part).max()) for part in (motion.velocity, motion.acceleration))
    return Demand(float(np.ptp(motion.displacement)), velocity, acceleration, force, rate / machine.loop.sample_time)


def _synthesise(bins: NDArray[np.complex128], samples: int, points: int) -> NDArray[np.float64]:
    """Return the signal, shape (points,), of Fourier sums over `samples` at the bins from 1 on; its mean is 0."""
    return np.fft.irfft(np.concatenate([[0.0], bins]), points) * (points / samples)
