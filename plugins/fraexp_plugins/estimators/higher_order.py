"""Higher-order sinusoidal-input describing functions: what a sine at the input becomes at its multiples."""

from collections.abc import Sequence

import numpy as np

from fraexp.api import (
    Curve,
    Metric,
    Plant,
    RecordError,
    Result,
    Segment,
    Signals,
    fourier_sums,
    param,
    phasors,
    response_result,
)
from fraexp_plugins.estimators.delayed import DelayedEstimator


class HigherOrder(DelayedEstimator, name="higher_order", version=1):
    """H_k = Y(kω) |U(ω)|^(k-1) / U(ω)^k for k = 1…7, from one sine after another.

    P. W. J. M. Nuij, O. H. Bosgra and M. Steinbuch, Higher-order sinusoidal input describing functions for the
    analysis of non-linear systems with harmonic responses, MSSP 20(8), 2006, doi:10.1016/j.ymssp.2005.04.006. |H_k| is
    the output's amplitude at kω over the input's at ω, its phase that of the output less k times that of the input.

    In a closed loop the controller answers the output's harmonics: the input has some too, and they pass the machine.
    They are taken off to first order, Y(kω) - Ĝ(kω) U(kω), where Ĝ is `plant`, or else the response H_1 itself,
    interpolated between the fundamentals; multiples beyond the highest fundamental then are not known.

    Not to be used where an amplitude of its own is to be known: H_k holds for the amplitude at which it was measured.
    """

    orders: int = param("1", "highest order k", 7, at_least=1, at_most=50)
    correction: bool = param("", "whether the input's own harmonics are taken off", True)
    plant: Plant | None = param(
        "", "linear response to the input's harmonics; H_1, interpolated, if none is given", None
    )
    remove_delay: bool = param("", "whether to refer input and output to the plant: G_di with hold, and G_do", False)

    def estimate(self, signals: Signals) -> Result:
        """Return H_1 as response, each H_k and the total harmonic distortion as curves, and its greatest value."""
        units = (signals.unit(self.input), signals.unit(self.output))
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        _check(signals.segments)
        inputs = [phasors(s, self.input) * self._path(s, s.frequency)[0] for s in signals.segments]
        outputs = [phasors(s, self.output) / self._path(s, s.frequency)[1] for s in signals.segments]
        found = response_result(signals, inputs, outputs, names=(self.input, self.output), units=units)
        frequency = np.concatenate([segment.frequency for segment in signals.segments])
        u, y = (self._harmonics(signals.segments, number) for number in (0, 1))
        if self.correction:
            y[:, 1:] -= self._response(frequency, u, y) * u[:, 1:]
        curves, distortion = self._curves(frequency, u[:, 0], y, f"{units[1]}/{units[0]}"), _distortion(y)
        thd = Curve(
            "distortion", {"frequency": frequency, "distortion": distortion}, {"frequency": "Hz", "distortion": "1"}
        )
        metric = Metric("greatest total harmonic distortion", float(np.nanmax(distortion, initial=0.0)), "1")
        return Result(found.outcome, found.message, found.response, (metric,), (*curves, thd))

    def _path(self, segment: Segment, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what lies before and behind the plant at `frequency` [Hz]: ones if it is not to be removed."""
        if not self.remove_delay:
            return np.ones(frequency.size), np.ones(frequency.size)
        omega = 2 * np.pi * frequency
        return self.input_path(omega, segment.sample_time), self.output_path(omega)

    def _harmonics(self, segments: Sequence[Segment], side: int) -> np.ndarray:
        """Return the mean phasors of input (0) or output (1) at kω, (frequencies, orders); NaN from Nyquist on."""
        channel = (self.input, self.output)[side]
        found = np.full((len(segments), self.orders), np.nan, dtype=complex)
        for row, segment in zip(found, segments, strict=True):
            lines = segment.lines[0] * np.arange(1, self.orders + 1)
            lines = lines[2 * lines < segment.samples]
            sums = fourier_sums(segment.channels[channel], lines)
            path = self._path(segment, lines / (segment.samples * segment.sample_time))[side]
            mean = np.add.reduce(sums, axis=0) / len(sums)
            row[: lines.size] = mean / path if side else mean * path
        return found

    def _response(self, frequency: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return Ĝ(kω) for k from 2 on, shape (frequencies, orders - 1)."""
        multiples = frequency[:, None] * np.arange(2, self.orders + 1)
        if self.plant is not None:
            return self.plant.response(2 * np.pi * multiples.ravel()).reshape(multiples.shape)
        order = np.argsort(frequency)
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            fundamental = np.log((y[:, 0] / u[:, 0])[order])
        at, known = np.log(multiples), np.log(frequency[order])
        parts = (fundamental.real, np.unwrap(fundamental.imag))
        magnitude, phase = (np.interp(at, known, part, np.nan, np.nan) for part in parts)
        return np.exp(magnitude + 1j * phase)

    def _curves(self, frequency: np.ndarray, u: np.ndarray, y: np.ndarray, unit: str) -> list[Curve]:
        units = {"frequency": "Hz", "magnitude": unit, "phase": "rad"}
        curves = []
        for k in range(1, self.orders + 1):
            with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
                response = y[:, k - 1] / (np.abs(u) * (u / np.abs(u)) ** k)
            columns = {"frequency": frequency, "magnitude": np.abs(response), "phase": np.angle(response)}
            curves.append(Curve(f"H{k}", columns, units))
        return curves


def _check(segments: Sequence[Segment]) -> None:
    most = max(segment.lines.size for segment in segments)
    if most > 1:
        raise RecordError(
            f"higher_order needs one sine at a time, but {most} lines are excited at once: take a stepped_sine"
        )


def _distortion(y: np.ndarray) -> np.ndarray:
    """Return √Σ_{k≥2}|Y(kω)|²/|Y(ω)| over the known harmonics, shape (frequencies,); NaN where none is known."""
    size = np.abs(y)
    known = np.isfinite(size[:, 1:])
    total = np.sqrt(np.sum(np.where(known, size[:, 1:], 0.0) ** 2, axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.where(known.any(axis=1), total / size[:, 0], np.nan)
