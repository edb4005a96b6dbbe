"""The best linear approximation from one realisation of a multisine with detection lines for the distortions."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Finding, Metric, RecordError, Segment, Signals, fourier_sums, param
from fraexp_plugins.estimators._shared.realisations import (
    Group,
    Part,
    ReferencedEstimator,
    circular_covariance,
    mean,
    sum_of_squares,
)

MIN_DETECTION_LINES = 2
"""Detection lines that a level needs to have a scatter. Half of it gives one without."""
FLAT_PARTS = 0.0, 1e-3, 1e-2, 0.03, 0.1, 0.3, 0.6, 1.0
"""Parts of the distortions, and of noise that is not separated, that do not follow |Ĝ|²: what is tried. Half as
many make the likelihood choose between none and half of it at an antiresonance."""


class FastBestLinearApproximation(ReferencedEstimator, name="fast_best_linear_approximation", version=5):
    """Ĝ = Ȳ/Ū, with noise from the scatter of periods and nonlinear distortions from detection lines (fast method).

    At a detection line, which is not excited, E = Y - Ĝ U contains only noise and distortions; Ĝ U is the response to
    what feedback puts into the input. Odd detection lines show odd distortions, even ones even distortions. At excited
    lines the distortions are as large as at detection lines of the same parity nearby: |E|² there, over |Ū|², is the
    variance of Ĝ. J. Schoukens, M. Vaes, R. Pintelon, IEEE Control Systems 36(3) 2016, doi:10.1109/MCS.2016.2535918.

    |E|² at an excited line follows from its ratio to n + g d, by a straight line over ln f through the `neighbours`
    nearest detection lines. n is the noise, averaged over twice as many lines, and d the neighbours' median of
    (|E|² - n)/g. g = (1 - c)|Ĝ|² + c mean |Ĝ|² because some distortions reach the output through the plant and others
    do not, as noise does not: several c are averaged, weighted by the likelihood of |E|² at the same detection
    lines, and the scatter of their logarithms lowers ν. With weights w of the straight line ν = 2/Σw²: twice the
    neighbours in the middle of the frequency range and half of them at its ends. From one period n is not identifiable:
    noise and distortions are not separated. At an antiresonance the band rests on c alone; with distortions before it
    it may cover as little as 80 %, and a message names such lines.

    For odd multisines with detection lines. Several realisations are averaged as in `best_linear_approximation`. Do not
    use it with excitations without detection lines, nor if distortions are half of the response or more: the band
    covers 95 % to first order only. It does not remove the bias by friction: it estimates plant and friction at this
    amplitude.
    """

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"), "a stepped sine has no detection lines"
    )
    neighbours: int = param(
        "1", "detection lines nearest to an excited line that give its distortions", 8, at_least=MIN_DETECTION_LINES
    )

    def part(self, signals: Signals, group: Group) -> Part:
        """Return Ȳ/Ū of a group of realisations, with the levels of noise and distortions."""
        _check_lines(group[0])
        u, y = self.relative_phasors(signals, group)
        u_mean, y_mean = mean(mean(u, 1)), mean(mean(y, 1))
        response = y_mean / u_mean
        band = self._band(group, response)
        lines = group[0].lines
        odd, even = (band.level(lines, parity, self.neighbours) for parity in (1, 0))
        is_odd, is_separated = lines % 2 == 1, u.shape[1] > 1
        total = np.where(is_odd, odd.power, even.power)
        freedom = np.where(is_odd, odd.freedom, even.freedom)
        square = np.abs(u_mean) ** 2
        noise = band.noise[lines - band.lines[0]]
        sensitive = np.where(is_odd, odd.is_sensitive, even.is_sensitive) & ~(noise > total / 4)
        levels = {"output": np.abs(y_mean) ** 2, "noise": noise, "odd": odd.power, "even": even.power}
        return Part(
            group,
            group[0].frequency,
            response,
            circular_covariance(total / (len(group) * square)),
            freedom * len(group),
            np.abs(u_mean),
            np.abs(y_mean),
            noise_variance=noise / (len(group) * square) if is_separated else None,
            nonlinear_variance=np.maximum(total - noise, 0.0) / square if is_separated else None,
            curves=(_level_curve(group[0].frequency, levels, signals.unit(self.output)),),
            metrics=_level_metrics(levels),
            remarks=_sensitivity(group[0].frequency[sensitive]),
        )

    def _band(self, group: Group, response: NDArray[np.complex128]) -> "_Band":
        """Return the output less Ĝ U at all lines from the lowest to the highest excited one."""
        first = group[0]
        lines = np.arange(first.lines[0], first.lines[-1] + 1)
        gain = _interpolated_response(lines, first.lines, response)
        path = self.path(lines / (first.samples * first.sample_time), first.sample_time)
        u = np.stack([fourier_sums(segment.channels[self.input], lines) for segment in group])
        y = np.stack([fourier_sums(segment.channels[self.output], lines) for segment in group])
        error = y - gain * path * u
        averaged = mean(error, 1)
        realisations, periods = error.shape[:2]
        noise = np.full(lines.size, np.nan)
        if periods > 1:
            scatter = sum_of_squares(error - averaged[:, None], (0, 1)) / (realisations * periods * (periods - 1))
            noise = _running_mean(scatter, self.neighbours)
        is_detection = ~np.isin(lines, first.lines)
        return _Band(
            lines, is_detection, np.abs(gain) ** 2, sum_of_squares(averaged) / realisations, noise, realisations
        )


@dataclass(frozen=True)
class _Band:
    """All lines from the lowest to the highest excited one, with the part E of the output that Ĝ does not explain."""

    lines: NDArray[np.int64]
    is_detection: NDArray[np.bool_]
    """Which of them are not excited, shape (n,)."""
    gain: NDArray[np.float64]
    """|Ĝ|², shape (n,)."""
    power: NDArray[np.float64]
    """|E|² of the mean over the periods, averaged over realisations."""
    noise: NDArray[np.float64]
    """The part of noise in that; NaN for a single period, from which it is not identifiable."""
    realisations: int
    """Number of realisations over which it is averaged."""

    def level(self, lines: NDArray[np.int64], parity: int, neighbours: int) -> "_Level":
        """Return E|E|² at these lines from detection lines of a parity nearby; NaN if there are too few of them."""
        places = np.flatnonzero(self.is_detection & (self.lines % 2 == parity))
        if places.size < MIN_DETECTION_LINES:
            unknown = np.full(lines.size, np.nan)
            return _Level(unknown, unknown, np.zeros(lines.size, dtype=bool))
        distance = np.abs(np.log(self.lines[places]) - np.log(lines)[:, None])
        order = np.argsort(distance, axis=1, kind="stable")
        near = places[np.sort(order[:, :neighbours])]
        weights = _trend_weights(np.log(self.lines[near]), np.log(lines))
        powers = np.stack([self._power(lines, near, part, weights) for part in FLAT_PARTS])
        chances = _normalised_chances([self._log_likelihood(near, part) for part in FLAT_PARTS])
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            logarithm = np.log(powers)
            middle = np.add.reduce(chances * logarithm)
            doubt = np.nan_to_num(np.add.reduce(chances * (logarithm - middle) ** 2))
        scatter = np.add.reduce(weights**2, axis=1)
        freedom = np.maximum(2 / (scatter + doubt / 2), 2.0)
        return _Level(np.add.reduce(chances * powers), freedom, doubt / 2 > scatter)

    def _power(
        self, lines: NDArray[np.int64], near: NDArray[np.int64], part: float, weights: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return E|E|² at the lines from their neighbours, if a part of the distortions does not follow |Ĝ|²."""
        flat, at = mean(self.gain[near], 1), lines - self.lines[0]
        shape_near, distortion = self._shape(near, part, flat)
        shape = np.nan_to_num(self.noise[at]) + _mixed(self.gain[at], part, flat) * distortion
        relative = np.where(shape_near > 0, self.power[near] / np.where(shape_near > 0, shape_near, 1.0), 0.0)
        found = np.maximum(np.add.reduce(weights * relative, axis=1), mean(relative, 1) / near.shape[1])
        return np.asarray(shape * found)

    def _shape(
        self, near: NDArray[np.int64], part: float, flat: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return n + g d at the neighbours, shape (lines, neighbours), and d, shape (lines,)."""
        noise, mixed = np.nan_to_num(self.noise[near]), _mixed(self.gain[near], part, flat[:, None])
        distortion = np.maximum(np.median((self.power[near] - noise) / mixed, axis=1), 0.0)
        return noise + mixed * distortion[:, None], distortion

    def _log_likelihood(self, near: NDArray[np.int64], part: float) -> NDArray[np.float64]:
        """Return the logarithm of the likelihood of |E|² at the detection lines, of any scale, shape (lines,)."""
        shape, _ = self._shape(near, part, mean(self.gain[near], 1))
        safe = np.maximum(shape, np.finfo(float).tiny)
        relative = np.maximum(mean(self.power[near] / safe, 1), np.finfo(float).tiny)
        return -self.realisations * (np.add.reduce(np.log(safe), axis=1) + near.shape[1] * np.log(relative))


class _Level(NamedTuple):
    """The power of distortions and noise at lines."""

    power: NDArray[np.float64]
    """E|E|², shape (lines,)."""
    freedom: NDArray[np.float64]
    """Its degrees of freedom, shape (lines,)."""
    is_sensitive: NDArray[np.bool_]
    """Whether it depends much on what follows |Ĝ|², which differs much among the detection lines, shape (lines,)."""


def _mixed(gain: NDArray[np.float64], part: float, flat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return |Ĝ|² with a part of it replaced by its mean."""
    return np.asarray((1 - part) * gain + part * flat)


def _normalised_chances(log_likelihoods: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the probabilities of alternatives, shape (alternatives, lines)."""
    chances = np.exp(np.stack(log_likelihoods) - np.max(log_likelihoods, axis=0))
    return np.asarray(chances / np.add.reduce(chances))


def _sensitivity(frequency: NDArray[np.float64]) -> tuple[Finding, ...]:
    if not frequency.size:
        return ()
    text = (
        "around a resonance or an antiresonance the confidence band depends on whether the distortions follow the "
        "response, and may cover less than 95 %"
    )
    remedy = "record several realisations and use best_linear_approximation"
    return (Finding("remark", (), tuple(map(float, frequency)), text=text, remedy=remedy),)


def _trend_weights(at: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights with which values at `at`, shape (n, k), give their straight line at `wanted`, shape (n,)."""
    middle = mean(at, 1)
    apart = at - middle[:, None]
    slope = (wanted - middle) / np.add.reduce(apart**2, axis=1)
    return 1 / at.shape[1] + slope[:, None] * apart


def _check_lines(segment: Segment) -> None:
    """Raise RecordError unless there are detection lines of each excited parity."""
    lines = segment.lines
    omitted = np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)
    for parity in np.unique(lines % 2):
        if np.sum(omitted % 2 == parity) < MIN_DETECTION_LINES:
            raise RecordError(
                f"fast_best_linear_approximation: there are no {'odd' if parity else 'even'} detection lines between "
                f"{segment.frequency[0]:.4g} and {segment.frequency[-1]:.4g} Hz; give the multisine detection lines "
                "(detection_group_size), or use best_linear_approximation with several realisations"
            )


def _level_curve(frequency: NDArray[np.float64], levels: dict[str, NDArray[np.float64]], unit: str) -> Curve:
    """Return amplitudes over frequency: of the output, and of noise and distortions in one realisation's mean."""
    columns = {"frequency": frequency, **{name: np.sqrt(level) for name, level in levels.items()}}
    return Curve("distortion levels", columns, {name: "Hz" if name == "frequency" else unit for name in columns})


def _level_metrics(levels: dict[str, NDArray[np.float64]]) -> tuple[Metric, ...]:
    output = float(np.add.reduce(levels["output"]))
    shares = {name: float(np.add.reduce(levels[name])) / output for name in ("noise", "odd", "even")}
    return tuple(Metric(f"{name} level over output", float(np.sqrt(share)), "1") for name, share in shares.items())


def _running_mean(values: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return the mean over `reach` neighbours on either side, over fewer at the ends."""
    sums = np.concatenate([[0.0], np.add.accumulate(values)])
    low = np.maximum(np.arange(values.size) - reach, 0)
    high = np.minimum(np.arange(values.size) + reach + 1, values.size)
    return np.maximum(sums[high] - sums[low], 0.0) / (high - low)


def _interpolated_response(
    lines: NDArray[np.int64], known: NDArray[np.int64], response: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return a response between the known lines: linear in ln|G| and phase over ln f, as 1/s² is."""
    at, given = np.log(lines), np.log(known)
    size = np.interp(at, given, np.log(np.abs(response)))
    phase = np.interp(at, given, np.unwrap(np.angle(response)))
    return np.exp(size + 1j * phase)
