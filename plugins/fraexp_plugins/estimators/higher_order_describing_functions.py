"""Higher-order sinusoidal-input describing functions: the response to a sine at its harmonics."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    ROUNDING,
    Curve,
    Finding,
    Metric,
    Plant,
    Quantity,
    RecordError,
    Result,
    Segment,
    Signals,
    fourier_sums,
    param,
    phasors,
    response_result,
)
from fraexp_plugins.estimators._shared.delayed_estimator import PlantReferredEstimator
from fraexp_plugins.estimators._shared.realisations import mean

MAX_KNOWN_ERROR = 0.5
"""Error of H_k from which it is unknown: half of it keeps the order of magnitude, and no more."""
BEYOND_MARGIN = 10.0
"""Factor by which the response above the highest fundamental may exceed that at the highest fundamental: a mode with
5 % damping. Half of it reports distortions that a mode there may have hidden."""


class HigherOrderDescribingFunctions(PlantReferredEstimator, name="higher_order_describing_functions", version=5):
    """H_k = Y(kω) |U(ω)|^(k-1) / U(ω)^k for k = 1…7, from one sine after another.

    P. W. J. M. Nuij, O. H. Bosgra and M. Steinbuch, Higher-order sinusoidal input describing functions for the
    analysis of non-linear systems with harmonic responses, MSSP 20(8), 2006, doi:10.1016/j.ymssp.2005.04.006. |H_k| is
    the output's amplitude at kω over the input's at ω, its phase that of the output less k times that of the input.

    In a closed loop the controller reacts to the output's harmonics, so that the input has harmonics too, which pass
    the machine. They are removed to first order, Y(kω) - Ĝ(kω) U(kω), where Ĝ is `plant`. Without a `plant` it is H_1,
    interpolated between the fundamentals by a cubic spline; above the highest fundamental it is unknown. H_k is then
    unknown (NaN) if the input contains that harmonic, and so is the distortion unless that harmonic is negligible.

    The error of the removal has two causes. The spline's is estimated by the
    distance of neighbouring points from the straight lines that pass them by. The other
    one is that the machine responds to a small harmonic beside the large sine otherwise than to a sine alone: for
    u + αu³ by 1 + 6d instead of H_1's 1 + 3d, d = αA²/4 being the distortion referred to the input. Both count in
    full: 6 d(ω) + 3 d(kω) of what is removed; with a `plant` its distance from H_1 counts too, by which friction
    changes the response. Beyond the accuracy of the study the outcome is `INACCURATE`, above 50 % H_k is unknown.

    H_k is valid for the amplitude at which it was measured. Do not use it at another amplitude.
    """

    max_order: int = param("1", "highest order k", 7, at_least=1, at_most=50)
    remove_input_harmonics: bool = param("", "whether the response to the input's own harmonics is removed", True)
    plant: Plant | None = param(
        "", "linear response to the input's harmonics; H_1, interpolated, if it is not given", None
    )

    def estimate(self, signals: Signals) -> Result:
        """Return H_1 as response, each H_k and the total harmonic distortion as curves, and its greatest value."""
        units = (signals.unit(self.input), signals.unit(self.output))
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        _check_single_sines(signals.segments)
        paths = [self._paths(s, s.frequency) for s in signals.segments]
        inputs = [phasors(s, self.input) * path.before for s, path in zip(signals.segments, paths, strict=True)]
        outputs = [phasors(s, self.output) / path.behind for s, path in zip(signals.segments, paths, strict=True)]
        found = response_result(signals, inputs, outputs, names=(self.input, self.output), units=units)
        frequency = np.concatenate([segment.frequency for segment in signals.segments])
        u, y = self._harmonics(signals.segments)
        removal = self._removal(frequency, u, y) if self.remove_input_harmonics else _no_removal(y)
        y = y - removal.removed
        distortion = _distortion(y, removal.error)
        inaccurate = _inaccuracy(frequency, y, np.where(removal.is_known, removal.error, 0.0))
        y = np.where(removal.is_known, y, np.nan)
        curves = self._curves(frequency, u[:, 0], y, f"{units[1]}/{units[0]}")
        thd = Curve(
            "distortion", {"frequency": frequency, "distortion": distortion}, {"frequency": "Hz", "distortion": "1"}
        )
        greatest = float(np.nanmax(distortion)) if np.isfinite(distortion).any() else np.nan
        metric = Metric("greatest total harmonic distortion", greatest, "1")
        found = replace(found, metrics=(metric,), curves=(*curves, thd))
        return found.with_findings(inaccurate, _unknown(frequency, y, distortion))

    def _paths(self, segment: Segment, frequency: NDArray[np.float64]) -> "_Paths":
        """Return the paths before and behind the plant at `frequency` [Hz]; ones if they are to stay."""
        if not self.refer_to_plant:
            ones = np.ones(frequency.size, dtype=complex)
            return _Paths(ones, ones)
        omega = 2 * np.pi * frequency
        return _Paths(self.input_path(omega, segment.sample_time), self.output_path(omega))

    def _harmonics(self, segments: Sequence[Segment]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the mean phasors of input and output at kω, each (frequencies, orders); NaN from Nyquist on."""
        u, y = np.full((2, len(segments), self.max_order), np.nan, dtype=complex)
        for row, segment in enumerate(segments):
            lines = segment.lines[0] * np.arange(1, self.max_order + 1)
            lines = lines[2 * lines < segment.samples]
            path = self._paths(segment, lines / (segment.samples * segment.sample_time))
            u[row, : lines.size] = mean(fourier_sums(segment.channels[self.input], lines)) * path.before
            y[row, : lines.size] = mean(fourier_sums(segment.channels[self.output], lines)) / path.behind
        return u, y

    def _removal(
        self, frequency: NDArray[np.float64], u: NDArray[np.complex128], y: NDArray[np.complex128]
    ) -> "_Removal":
        """Return what the input's harmonics add to the output."""
        response, error = self._response(frequency, u, y)
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            removed, size = response * u, np.abs(y)
            referred = np.abs((y - removed) / response / u[:, :1])[:, 1:]
            distortion = np.sqrt(np.sum(np.where(np.isfinite(referred), referred, 0.0) ** 2, axis=1))
            error += _increment_error(frequency, distortion, self._multiples(frequency))
            error *= np.abs(removed)
            highest = np.argmax(frequency)
            bound = BEYOND_MARGIN * np.abs(y[highest, 0] / u[highest, 0] * u)
            is_beyond = ~np.isfinite(response)
            removed, error = np.where(is_beyond, 0.0, removed), np.where(is_beyond, bound, error)
            rounding = error <= ROUNDING * size[:, :1]
            is_known = rounding | (~is_beyond & (error <= MAX_KNOWN_ERROR * np.abs(y - removed)))
        removed[:, 0], error[:, 0], is_known[:, 0] = 0.0, 0.0, True
        return _Removal(removed, error, is_known)

    def _multiples(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return kω/2π [Hz] for k from 1 on, shape (frequencies, orders)."""
        return np.asarray(frequency[:, None] * np.arange(1, self.max_order + 1))

    def _response(
        self, frequency: NDArray[np.float64], u: NDArray[np.complex128], y: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Return Ĝ(kω) and its relative error by interpolation, shape (frequencies, orders); NaN where unknown."""
        multiples = self._multiples(frequency)
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            fundamental = np.log(y[:, 0] / u[:, 0])
        if self.plant is None:
            return _interpolated(frequency, fundamental, multiples)
        response = self.plant.response(2 * np.pi * multiples.ravel()).reshape(multiples.shape)
        measured, _ = _interpolated(frequency, fundamental, np.minimum(multiples, frequency.max()))
        known = self.plant.response(2 * np.pi * np.minimum(multiples, frequency.max()).ravel())
        return response, np.nan_to_num(np.abs(measured / known.reshape(multiples.shape) - 1))

    def _curves(
        self, frequency: NDArray[np.float64], u: NDArray[np.complex128], y: NDArray[np.complex128], unit: str
    ) -> list[Curve]:
        units = {"frequency": "Hz", "magnitude": unit, "phase": "rad"}
        curves = []
        for k in range(1, self.max_order + 1):
            with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
                response = y[:, k - 1] / (np.abs(u) * (u / np.abs(u)) ** k)
            columns = {"frequency": frequency, "magnitude": np.abs(response), "phase": np.angle(response)}
            curves.append(Curve(f"H{k}", columns, units))
        return curves


class _Paths(NamedTuple):
    """The paths before and behind the plant, each of shape (n,)."""

    before: NDArray[np.complex128]
    behind: NDArray[np.complex128]


def _check_single_sines(segments: Sequence[Segment]) -> None:
    """Raise RecordError if a segment excites several lines."""
    count = max(segment.lines.size for segment in segments)
    if count > 1:
        raise RecordError(
            f"higher_order_describing_functions: {count} lines are excited at once; expected one sine at a time: use "
            "the excitation stepped_sine"
        )


class _Removal(NamedTuple):
    """What is removed from the output's harmonics, each of shape (frequencies, orders)."""

    removed: NDArray[np.complex128]
    """The response to the input's harmonic [unit of the output]."""
    error: NDArray[np.float64]
    """Its estimated error [unit of the output]."""
    is_known: NDArray[np.bool_]
    """Whether the output's harmonic is known without it."""


def _no_removal(y: NDArray[np.complex128]) -> _Removal:
    return _Removal(np.zeros_like(y), np.zeros(y.shape), np.ones(y.shape, dtype=bool))


def _interpolated(
    frequency: NDArray[np.float64], logarithm: NDArray[np.complex128], wanted: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return a response between its frequencies and its relative error, shapes of `wanted` [Hz]; NaN outside of them.

    `logarithm`, shape (n,), is ln G; repeated frequencies are averaged.
    """
    from scipy.interpolate import CubicSpline  # slow to import: listing plugins must stay fast

    moves = np.isfinite(logarithm)
    known, place, count = np.unique(frequency[moves], return_inverse=True, return_counts=True)
    if known.size < 2:
        inside = np.isin(wanted, known)
        value = np.exp(logarithm[moves][0]) if known.size else np.nan
        return np.where(inside, value, np.nan), np.where(inside, 0.0, np.nan)
    parts = (logarithm.real[moves], np.unwrap(logarithm.imag[moves][np.argsort(place, kind="stable")]))
    real = np.bincount(place, parts[0]) / count
    imaginary = np.bincount(np.sort(place), parts[1]) / count
    at, x, value = np.log(wanted), np.log(known), real + 1j * imaginary
    inside = (wanted >= known[0]) & (wanted <= known[-1])
    response = np.exp(np.where(inside, CubicSpline(x, value)(at), np.nan))
    rough = np.maximum(*_neighbours(x, _left_out_errors(x, value), at))
    return response, np.where(np.isin(wanted, known), 0.0, np.expm1(rough))


def _left_out_errors(x: NDArray[np.float64], value: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the distance of each value from the straight line through its neighbours, shape (n,).

    At a distance h it is four times the error of straight lines between the values, and larger near a resonance.
    """
    if x.size < 3:
        return np.full(x.size, np.inf)
    part = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
    inner = np.abs(value[1:-1] - (1 - part) * value[:-2] - part * value[2:])
    return np.concatenate([inner[:1], inner, inner[-1:]])


def _neighbours(
    x: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the values at the next x below and above, each of the shape of `at`."""
    above = np.clip(np.searchsorted(x, at), 1, x.size - 1)
    return values[above - 1], values[above]


def _increment_error(
    frequency: NDArray[np.float64], distortion: NDArray[np.float64], multiples: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return by how much the response to a small harmonic may differ from H_1, relative, shape of `multiples`."""
    order = np.argsort(frequency, kind="stable")
    there = np.interp(multiples, frequency[order], distortion[order])
    return np.asarray(6 * distortion[:, None] + 3 * there)  # of u + αu³


def _inaccuracy(
    frequency: NDArray[np.float64], y: NDArray[np.complex128], error: NDArray[np.float64]
) -> Finding | None:
    """Return the largest error by the removal of the input's harmonics, and what helps; None without any."""
    size = np.where(np.isfinite(y), np.abs(y), 0.0)[:, 1:]
    if not size.size:
        return None
    largest = np.maximum(size.max(axis=1, keepdims=True), ROUNDING * np.abs(y[:, :1]))
    relative = error[:, 1:] / np.where(largest > 0, largest, 1.0)
    if relative.max() <= ROUNDING:
        return None
    row, column = np.unravel_index(np.argmax(relative), relative.shape)
    error_there = Quantity(100 * float(relative[row, column]), "%", f"error of H{column + 2}", float(frequency[row]))
    return Finding(
        "remark",
        (error_there,),
        text="the removal of the input's harmonics leaves an error",
        error=float(relative[row, column]),
        remedy="measure at closer frequencies or give 'plant', lower the amplitude, or take a slower controller",
    )


def _unknown(
    frequency: NDArray[np.float64], y: NDArray[np.complex128], distortion: NDArray[np.float64]
) -> Finding | None:
    """Return where harmonics are unknown, why, and what helps; None if all are known."""
    unknown = ~np.isfinite(y) & np.isfinite(y[:, :1])
    if not unknown.any():
        return None
    orders = [f"H{k + 1} at {np.sum(rows)}" for k, rows in enumerate(unknown.T) if rows.any()]
    return Finding(
        "remark",
        (),
        tuple(map(float, frequency[unknown.any(axis=1)])),
        frequency.size,
        text=(
            f"unknown: {', '.join(orders)}, because the input contains these harmonics and the response to them is not "
            "known well enough, or because they lie above half of the sample rate; the distortion is known at "
            f"{np.isfinite(distortion).sum()}; unknown harmonics"
        ),
        remedy="measure up to the highest harmonic, give 'plant', or lower max_order",
    )


def _distortion(y: NDArray[np.complex128], error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return √Σ_{k≥2}|Y(kω)|²/|Y(ω)|, shape (frequencies,); NaN where the errors of the harmonics are too large."""
    size = np.abs(y)
    if size.shape[1] < 2:
        return np.full(len(size), np.nan)
    total = np.sqrt(np.sum(size[:, 1:] ** 2, axis=1))
    deviation = np.sqrt(np.sum(error[:, 1:] ** 2, axis=1))
    is_known = (deviation <= MAX_KNOWN_ERROR * total) | (deviation <= ROUNDING * size[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.where(is_known, total / size[:, 0], np.nan)
