"""The best linear approximation from one realisation of a multisine whose omitted lines show the distortions."""

from dataclasses import dataclass

import numpy as np

from fraexp.api import Curve, Metric, RecordError, Segment, Signals, fourier_sums, param
from fraexp_plugins.estimators.realisations import Group, Part, ReferencedEstimator, circular, mean, power

LEAST = 2
"""Omitted lines at least, for a level to have a scatter."""


class FastBestLinear(ReferencedEstimator, name="fast_best_linear", version=2):
    """Ĝ = Ȳ/Ū, with noise from the scatter of periods and nonlinear distortions from the lines left out (fast method).

    At a line that is not excited, E = Y - Ĝ U holds noise and distortions alone; Ĝ U is what feedback makes the
    input do there. Odd lines left out show odd distortions, even ones even ones; on excited lines they are as large as
    on omitted ones of the same parity nearby: what |E|² is there, over |Ū|², is the variance of Ĝ. J. Schoukens,
    M. Vaes, R. Pintelon, IEEE Control Systems 36(3) 2016, doi:10.1109/MCS.2016.2535918.

    |E|² is carried over to an excited line by a straight line over ln f through the `neighbours` nearest ones, of its
    ratio to n + |Ĝ|² d: friction's distortions reach the output through the plant, noise does not. n is the noise,
    averaged over twice as many lines, and d the neighbours' median of (|E|² - n)/|Ĝ|². With weights w of the straight
    line ν = 2/Σw², twice the neighbours in the middle of the band and half of them at its ends. One period does not
    tell n: it is unknown, as are distortions alone, and all of |E|², noise included, is carried over by |Ĝ|²; with
    noise alone the band then holds 93 % on the paper's machine.

    For odd multisines with detection lines. Realisations, if there are several, are averaged as
    best_linear_approximation does. Not to be used with excitations that leave no lines out, nor where distortions
    are half of the response or more: to first order only the band holds 95 %. It takes no friction bias away: what is
    found is plant and friction at this amplitude.
    """

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"), "a stepped sine leaves no lines out"
    )
    neighbours: int = param("1", "omitted lines nearest to an excited one that tell its distortions", 8, at_least=LEAST)

    def part(self, signals: Signals, group: Group) -> Part:
        """Return Ȳ/Ū of a group of realisations, with the levels of noise and distortions."""
        _check_lines(group[0])
        u, y = self.rotated(signals, group)
        u_mean, y_mean = mean(mean(u, 1)), mean(mean(y, 1))
        response = y_mean / u_mean
        band = self._band(group, response)
        lines = group[0].lines
        odd, even = (band.level(lines, parity, self.neighbours) for parity in (1, 0))
        total, freedom = (np.where(lines % 2 == 1, *columns) for columns in zip(odd, even, strict=True))
        told, square = u.shape[1] > 1, np.abs(u_mean) ** 2
        noise = band.noise[lines - band.lines[0]]
        levels = {"output": np.abs(y_mean) ** 2, "noise": noise, "odd": odd[0], "even": even[0]}
        return Part(
            group,
            group[0].frequency,
            response,
            circular(total / (len(group) * square)),
            freedom * len(group),
            np.abs(u_mean),
            np.abs(y_mean),
            noise_variance=noise / (len(group) * square) if told else None,
            nonlinear_variance=np.maximum(total - noise, 0.0) / square if told else None,
            curves=(_curve(group[0].frequency, levels, signals.unit(self.output)),),
            metrics=_metrics(levels),
        )

    def _band(self, group: Group, response: np.ndarray) -> "_Band":
        """Return what is left of the output at all lines of the band when Ĝ U is taken off."""
        first = group[0]
        lines = np.arange(first.lines[0], first.lines[-1] + 1)
        gain = _interpolated(lines, first.lines, response)
        path = self.path(lines / (first.samples * first.sample_time), first.sample_time)
        u = np.stack([fourier_sums(segment.channels[self.input], lines) for segment in group])
        y = np.stack([fourier_sums(segment.channels[self.output], lines) for segment in group])
        error = y - gain * path * u
        averaged = mean(error, 1)
        realisations, periods = error.shape[:2]
        noise = np.full(lines.size, np.nan)
        if periods > 1:
            scatter = power(error - averaged[:, None], (0, 1)) / (realisations * periods * (periods - 1))
            noise = _smooth(scatter, self.neighbours)
        free = ~np.isin(lines, first.lines)
        return _Band(lines, free, np.abs(gain) ** 2, power(averaged) / realisations, noise)


@dataclass(frozen=True)
class _Band:
    """All lines from the lowest to the highest excited one, with what Ĝ does not explain of the output there."""

    lines: np.ndarray
    free: np.ndarray
    """Which of them are not excited."""
    gain: np.ndarray
    """|Ĝ|²."""
    power: np.ndarray
    """|E|² of the mean over the periods, averaged over realisations."""
    noise: np.ndarray
    """What noise has of that; NaN for a single period, which does not tell."""

    def level(self, lines: np.ndarray, parity: int, neighbours: int) -> tuple[np.ndarray, np.ndarray]:
        """Return E|E|² at these lines from omitted ones of a parity nearby, and its degrees of freedom; NaN if none."""
        places = np.flatnonzero(self.free & (self.lines % 2 == parity))
        if places.size < LEAST:
            return np.full(lines.size, np.nan), np.full(lines.size, np.nan)
        distance = np.abs(np.log(self.lines[places]) - np.log(lines)[:, None])
        near = places[np.sort(np.argsort(distance, axis=1, kind="stable")[:, :neighbours], axis=1)]
        noise = np.nan_to_num(self.noise)
        at, power_near, noise_near, gain_near = lines - self.lines[0], self.power[near], noise[near], self.gain[near]
        distortion = np.maximum(np.median((power_near - noise_near) / gain_near, axis=1), 0.0)
        shape_near = noise_near + gain_near * distortion[:, None]
        shape = noise[at] + self.gain[at] * distortion
        relative = np.where(shape_near > 0, power_near / shape_near, 0.0)
        weights = _trend_weights(np.log(self.lines[near]), np.log(lines))
        found = np.maximum(np.add.reduce(weights * relative, axis=1), mean(relative, 1) / near.shape[1])
        return shape * found, 2 / np.add.reduce(weights**2, axis=1)


def _trend_weights(at: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the weights of values at `at`, shape (n, k), of which their straight line at `wanted`, shape (n,), is."""
    middle = mean(at, 1)
    apart = at - middle[:, None]
    slope = (wanted - middle) / np.add.reduce(apart**2, axis=1)
    return 1 / at.shape[1] + slope[:, None] * apart


def _check_lines(segment: Segment) -> None:
    """Raise RecordError unless lines of each excited parity are left out."""
    lines = segment.lines
    omitted = np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)
    for parity in np.unique(lines % 2):
        if np.sum(omitted % 2 == parity) < LEAST:
            raise RecordError(
                f"no {'odd' if parity else 'even'} lines are left out between {segment.frequency[0]:.4g} and "
                f"{segment.frequency[-1]:.4g} Hz; fast_best_linear looks there for distortions: give the multisine "
                "detection lines, or use best_linear_approximation with several realisations"
            )


def _curve(frequency: np.ndarray, levels: dict[str, np.ndarray], unit: str) -> Curve:
    """Return amplitudes over frequency: of the output, and of what else is in one realisation's mean over periods."""
    columns = {"frequency": frequency, **{name: np.sqrt(level) for name, level in levels.items()}}
    return Curve("distortion levels", columns, {name: "Hz" if name == "frequency" else unit for name in columns})


def _metrics(levels: dict[str, np.ndarray]) -> tuple[Metric, ...]:
    whole = float(np.add.reduce(levels["output"]))
    shares = {name: float(np.add.reduce(levels[name])) / whole for name in ("noise", "odd", "even")}
    return tuple(Metric(f"{name} level over output", float(np.sqrt(share)), "1") for name, share in shares.items())


def _smooth(values: np.ndarray, reach: int) -> np.ndarray:
    """Return the mean over so many neighbours on either side, fewer at the ends."""
    sums = np.concatenate([[0.0], np.add.accumulate(values)])
    low = np.maximum(np.arange(values.size) - reach, 0)
    high = np.minimum(np.arange(values.size) + reach + 1, values.size)
    return np.maximum(sums[high] - sums[low], 0.0) / (high - low)


def _interpolated(lines: np.ndarray, known: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Return a response between the known lines: straight in ln|G| and phase over ln f, as 1/s² is."""
    at, given = np.log(lines), np.log(known)
    size = np.interp(at, given, np.log(np.abs(response)))
    phase = np.interp(at, given, np.unwrap(np.angle(response)))
    found: np.ndarray = np.exp(size + 1j * phase)
    return found
