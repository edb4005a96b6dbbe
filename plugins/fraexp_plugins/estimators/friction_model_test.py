"""A test of the friction model that needs no knowledge of the plant."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Curve,
    Finding,
    FrictionModel,
    Metric,
    ParameterError,
    Quantity,
    RecordError,
    Result,
    Segment,
    Signals,
    param,
    phasors,
    remarks,
)
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT, ObserverEstimator
from fraexp_plugins.estimators._shared.realisations import (
    Part,
    circular_covariance,
    combine_parts,
    mean,
    realisation_groups,
    sum_of_squares,
)

LIMIT_PROBABILITY = 0.95
"""Probability with which noise alone stays below the limit of a ratio."""
NOISE_FLOOR_MARGIN = 2.0
"""Factor by which the noise floor may be wrong: terms of the motion below the encoder's resolution miss in û_e too."""
ROUNDING_SEED = 0
"""Seed of the alternative rounding errors."""


class FrictionModelTest(ObserverEstimator, name="friction_model_test", version=2):
    """The scatter of y'/û_e over random phases or amplitudes, against the noise floor, by frequency band.

    With the right friction model û_e to y' is linear: all realisations have the same ratio except for noise, which the
    periods show. A wrong model leaves N - N̂ in the ratio, which depends on the amplitude and on all other lines (the
    error law; stochastic nonlinear distortions in R. Pintelon and J. Schoukens, System Identification: A Frequency
    Domain Approach, 2nd ed. 2012, ch. 4). With Ĝ = ΣY_m/R_m / ΣU_m/R_m and e_m = (Y_m - ĜU_m)/R_m / mean(U/R) the
    scatter of one realisation is √(Σ|e_m|²/(M-1))/|Ĝ|. Its noise floor follows likewise from the scatter of the
    periods' means and from a second estimate with other rounding errors of the encoder. R is the excitation, or û_e
    itself if the record has no excitation channel.

    Scatter and noise floor of a band are medians over its lines; its ratio is the root of the median of their squares'
    ratio. The verdict is 1 if the ratio is not above twice the limit that noise alone exceeds in 5 of 100 experiments,
    or if the scatter is within `scatter_tolerance`. Otherwise it is 0: identify the friction model again. From one
    period the noise is not identifiable: a scatter above `scatter_tolerance` then has the verdict NaN, unknown.

    The test is sensitive to errors of the hysteresis only: the true error of P̂ is one to four times their scatter. A
    wrong viscous friction, mass or linear spring is linear from y' to û_e, as P is, and is not identifiable beside P:
    the verdict is 1, however large that error of P̂ is.

    Do not use it with one realisation, nor at amplitudes so large that friction no longer matters: every friction
    model is good enough there.
    """

    friction: FrictionModel = param("", "friction model FM of the observer", inherit="friction")
    excitation_channel: str = param("", "channel of the excitation, if there is one", "excitation")
    bands: tuple[float, ...] = param("Hz", "limits of the frequency bands, ascending", (1.0, 5.0, 20.0, 100.0))
    scatter_tolerance: float = param("1", "relative scatter that is acceptable", 0.01, at_least=0)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a stepped sine, with which it is tried here: one realisation of each line shows no scatter.",
    )

    def model_post_init(self, context: object) -> None:
        """Check the bands."""
        super().model_post_init(context)
        if len(self.bands) < 2 or min(np.diff(self.bands)) <= 0:
            raise ParameterError("friction_model_test.bands: expected two or more frequencies in ascending order")

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e of all realisations, and scatter, noise floor, their ratio and a verdict for each band."""
        self._check_bands(signals.segments)
        units = (signals.unit(self.input), signals.unit(self.output))
        observed = [self._input_and_output_phasors(signals.segments)]
        if self.resolution:
            observed.append(
                self._input_and_output_phasors(
                    [self._with_other_rounding(*item) for item in enumerate(signals.segments)]
                )
            )
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            parts = [self._part(signals, group, observed) for group in realisation_groups(signals)]
            found = combine_parts(signals, parts, names=(EFFECTIVE_INPUT, self.output), units=units)
            if not parts:
                return found
            scatter = _scatter_curve(parts)
            verdicts = list(self._verdicts(scatter, parts))
        findings = found.findings or _verdict_findings(verdicts)
        metrics = tuple(metric for verdict in verdicts for metric in verdict.metrics())
        return Result(found.outcome, findings, found.response, metrics, (scatter,))

    def _check_bands(self, segments: Sequence[Segment]) -> None:
        """Raise RecordError if a band has no line."""
        if not segments:
            return
        lines = np.concatenate([segment.frequency for segment in segments])
        for low, high in itertools.pairwise(self.bands):
            if not np.any((lines >= low) & (lines < high)):
                raise RecordError(
                    f"friction_model_test.bands: no line lies in the band {low:g} to {high:g} Hz; the lines cover "
                    f"{lines.min():.4g} to {lines.max():.4g} Hz: give bands with lines in each"
                )

    def _input_and_output_phasors(self, segments: Sequence[Segment]) -> list[NDArray[np.complex128]]:
        """Return the phasors of û_e and y' of each segment, shape (2, periods, lines)."""
        inputs = self.effective_phasors(segments)
        return [np.stack([u, phasors(segment, self.output)]) for u, segment in zip(inputs, segments, strict=True)]

    def _with_other_rounding(self, number: int, segment: Segment) -> Segment:
        """Return a segment with another rounding error, the same in each period, as in the steady state."""
        generator = np.random.default_rng([ROUNDING_SEED, number])
        change = generator.uniform(-self.resolution / 2, self.resolution / 2, segment.samples)
        return replace(segment, channels={**segment.channels, self.output: segment.channels[self.output] + change})

    def _part(
        self, signals: Signals, group: Sequence[Segment], observed: Sequence[list[NDArray[np.complex128]]]
    ) -> Part:
        if len(group) < 2:
            raise RecordError(
                f"friction_model_test: there is one realisation of the lines from {group[0].frequency[0]:.4g} Hz on; "
                "expected several: use a multisine with 5 realisations or more"
            )
        chosen = [number for number, segment in enumerate(signals.segments) if any(segment is one for one in group)]
        pairs = [np.stack([phasors_of[number] for number in chosen], axis=1) for phasors_of in observed]
        u, y = pairs[0]
        reference = mean(u, 1)
        if self.excitation_channel in signals.units:
            reference = np.stack([mean(phasors(segment, self.excitation_channel)) for segment in group])
        u_mean, y_mean = (mean(mean(values, 1) / reference) for values in (u, y))
        response = y_mean / u_mean
        error, *others = ((pair[1] - response * pair[0]) / reference[:, None] / u_mean for pair in pairs)
        mean_errors, (count, periods) = mean(error, 1), error.shape[:2]
        scatter = sum_of_squares(mean_errors) / (count - 1)
        noise = np.full(response.size, np.nan)
        if periods > 1:
            noise = sum_of_squares(error - mean_errors[:, None], (0, 1)) / (count * periods * (periods - 1))
        for other in others:
            noise = noise + sum_of_squares(mean(other, 1) - mean_errors) / count
        size = mean(np.abs(reference))
        return Part(
            tuple(group),
            group[0].frequency,
            response,
            circular_covariance(scatter / count),
            2.0 * (count - 1),
            np.abs(u_mean) * size,
            np.abs(y_mean) * size,
            noise_variance=noise / count,
            nonlinear_variance=np.where(np.isfinite(noise), np.maximum(scatter - noise, 0.0), np.nan),
        )

    def _verdicts(self, scatter_curve: Curve, parts: Sequence[Part]) -> "Iterator[_Verdict]":
        frequency, scatter, noise = scatter_curve.columns.values()
        freedoms = min(_freedoms(part) for part in parts)
        for low, high in itertools.pairwise(self.bands):
            inside = (frequency >= low) & (frequency < high) & np.isfinite(scatter)
            if inside.any():
                middle, floor, ratio = (
                    float(np.median(values[inside])) for values in (scatter, noise, scatter / noise)
                )
                limit = NOISE_FLOOR_MARGIN * _ratio_limit(int(inside.sum()), *freedoms)
                explained = float(ratio <= limit) if floor >= 0 else np.nan
                verdict = 1.0 if middle <= self.scatter_tolerance else explained
                yield _Verdict(f"{low:g}-{high:g} Hz", middle, floor, ratio, verdict)


@dataclass(frozen=True)
class _Verdict:
    """Scatter, noise floor and verdict of one frequency band."""

    band: str
    scatter: float
    noise: float
    ratio: float
    verdict: float
    """1 if the friction model is good enough, 0 if not, NaN if the noise floor is unknown."""

    def metrics(self) -> tuple[Metric, ...]:
        numbers = {"scatter": self.scatter, "noise floor": self.noise, "ratio": self.ratio, "verdict": self.verdict}
        return tuple(Metric(f"{name} {self.band}", number, "1") for name, number in numbers.items())


def _ratio_limit(lines: int, scatter: int, noise: int) -> float:
    """Return the limit that noise alone exceeds in 5 of 100 cases; NaN if the noise is unknown.

    It is that of the root of the median of the ratios at so many lines. With noise alone a ratio of variances is F
    distributed, and the probability of the median's quantile is beta distributed.
    """
    from scipy.special import betaincinv, fdtri  # slow to import: only when something is estimated

    if noise == 0:
        return np.nan
    quantile = betaincinv((lines + 1) / 2, (lines + 1) / 2, LIMIT_PROBABILITY)
    return float(np.sqrt(fdtri(scatter, noise, quantile)))


def _verdict_findings(verdicts: Sequence[_Verdict]) -> tuple[Finding, ...]:
    if any(np.isnan(each.verdict) for each in verdicts):
        return remarks(
            "the noise floor is not identifiable from one period, and the scatter is above scatter_tolerance; record "
            "two periods or more"
        )
    failed = [each for each in verdicts if not each.verdict]
    if not failed:
        return ()
    worst = Quantity(100 * max(each.scatter for each in failed), "%", "scatter of y'/û_e between realisations")
    bands = ", ".join(verdict.band for verdict in failed)
    return (Finding("misfit", (worst,), place=bands, remedy="identify the friction model again"),)


def _scatter_curve(parts: Sequence[Part]) -> Curve:
    """Return scatter and noise floor of one realisation, relative to the response."""
    scatter = [len(part.segments) * (part.covariance[:, 0, 0] + part.covariance[:, 1, 1]) for part in parts]
    noise = [len(part.segments) * part.noise_variance for part in parts if part.noise_variance is not None]
    size = np.abs(np.concatenate([part.response for part in parts]))
    columns = {
        "frequency": np.concatenate([part.frequency for part in parts]),
        "scatter": np.sqrt(np.concatenate(scatter)) / size,
        "noise floor": np.sqrt(np.concatenate(noise)) / size,
    }
    return Curve("self-diagnosis", columns, {"frequency": "Hz", "scatter": "1", "noise floor": "1"})


def _freedoms(part: Part) -> tuple[int, int]:
    """Return the degrees of freedom of scatter and noise floor."""
    count, periods = len(part.segments), len(next(iter(part.segments[0].channels.values())))
    return 2 * (count - 1), 2 * count * (periods - 1)
