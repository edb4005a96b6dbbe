"""Plants, controllers, excitations, estimators and readers with one defect each, and the check that must find it."""

import numpy as np

from fraexp.api import (
    Controller,
    Estimator,
    Excitation,
    Metric,
    Period,
    Plant,
    RecordReader,
    RecordTable,
    Result,
    Schedule,
    StateSpace,
    param,
    phasors,
    response_result,
)


class FreeMass(Plant, name="free_mass", version=1):
    """A free mass (Newton 1687), without defect."""

    mass: float = param("kg", "mass", above=0)

    def state_space(self):
        return StateSpace(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([0.0, 1 / self.mass]), np.array([1.0, 0.0]))

    def response(self, omega):
        return -1 / (self.mass * omega**2)


class OtherResponse(FreeMass, name="other_response", version=1):
    """Newton 1687, with a response of twice the mass."""

    def response(self, omega):
        return -0.5 / (self.mass * omega**2)


class Velocity(FreeMass, name="velocity", version=1):
    """Newton 1687, with the velocity for output."""

    def state_space(self):
        return StateSpace(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([0.0, 1 / self.mass]), np.array([0.0, 1.0]))

    def response(self, omega):
        return 1 / (1j * self.mass * omega)


class Columns(FreeMass, name="columns", version=1):
    """Newton 1687, with b as a column."""

    def state_space(self):
        return StateSpace(np.zeros((2, 2)), np.zeros((2, 1)), np.zeros(2))


class Scaled(Controller, name="scaled", version=1):
    """C(z) = K (Ziegler and Nichols 1942), with a denominator that starts with 2."""

    gain: float = param("N/m", "gain", above=0)

    def transfer_function(self, sample_time):
        return np.array([self.gain]), np.array([2.0])


class OtherController(Controller, name="other_controller", version=1):
    """C(z) = K (Ziegler and Nichols 1942), with a response of its own."""

    gain: float = param("N/m", "gain", above=0)

    def transfer_function(self, sample_time):
        return np.array([self.gain]), np.array([1.0])

    def response(self, omega, sample_time):
        return self.gain * np.exp(-1j * omega * sample_time)


class Tone(Excitation, name="tone", version=1):
    """A sine (Fourier 1822), without defect."""

    amplitude: float = param("N", "amplitude", above=0)

    def periods(self, sample_time):
        return (Period(self.amplitude * np.sin(2 * np.pi * np.arange(100) / 100), np.array([1])),)

    @property
    def schedule(self):
        return Schedule()


class WrongLine(Tone, name="wrong_line", version=1):
    """Fourier 1822, with a line at which there is nothing."""

    def periods(self, sample_time):
        return (Period(self.amplitude * np.sin(2 * np.pi * np.arange(100) / 100), np.array([2])),)


class NoTolerance(Tone, name="no_tolerance", version=1):
    """Fourier 1822, that never settles."""

    @property
    def schedule(self):
        return Schedule(settling_tolerance=0.0)


class BeyondNyquist(Tone, name="beyond_nyquist", version=1):
    """Fourier 1822, at 1 kHz whatever the sample time."""

    def periods(self, sample_time):
        samples = round(10e-3 / sample_time)
        return (Period(np.sin(2 * np.pi * np.arange(samples) * 10 / samples), np.array([10])),)


class Unseeded(Tone, name="unseeded", version=1):
    """Fourier 1822, at a random phase."""

    def periods(self, sample_time):
        phase = np.random.default_rng().random()
        return (Period(np.sin(2 * np.pi * (np.arange(100) / 100 + phase)), np.array([1])),)


class HalfAmplitude(Estimator, name="half_amplitude", version=1):
    """Fourier 1822, with half of the output."""

    def estimate(self, signals):
        inputs = [phasors(segment, "u") for segment in signals.segments]
        outputs = [0.5 * phasors(segment, "y") for segment in signals.segments]
        return response_result(signals, inputs, outputs, names=("u", "y"), units=("N", "m"))


class Unknown(Estimator, name="unknown", version=1):
    """Fourier 1822, with a unit that nobody knows, and an outcome of its own."""

    def estimate(self, signals):
        return Result(type(signals.outcome).OK, metrics=(Metric("something", 1.0, "furlongs per banana"),))


class Flat(Estimator, name="flat", version=1):
    """Fourier 1822, with variances in place of covariances."""

    def estimate(self, signals):
        inputs = [phasors(segment, "u") for segment in signals.segments]
        result = response_result(signals, inputs, inputs, names=("u", "u"), units=("N", "N"))
        object.__setattr__(result.response, "covariance", np.zeros(len(inputs)))
        return result


class Dotless(RecordReader, name="dotless", version=1):
    """A format of our own."""

    suffixes = ("OWN",)

    def read(self, path, columns):
        return RecordTable({})


class Careless(RecordReader, name="careless", version=1):
    """A format of our own."""

    suffixes = (".own",)

    def read(self, path, columns):
        return RecordTable({columns[0]: np.array([float(path.read_text())])})


OTHERS = [
    (OtherResponse, "realisation"),
    (Velocity, "relative-degree"),
    (Columns, "shapes"),
    (Scaled, "causal"),
    (OtherController, "coefficients"),
    (WrongLine, "whole-periods"),
    (NoTolerance, "schedule"),
    (BeyondNyquist, "refuses"),
    (Unseeded, "repeatable"),
    (HalfAmplitude, "linear-plant"),
    (Unknown, "result-units"),
    (Unknown, "outcome"),
    (Flat, "covariance"),
    (Dotless, "suffixes"),
    (Careless, "foreign-file"),
]
SOUND = (FreeMass, Tone)
