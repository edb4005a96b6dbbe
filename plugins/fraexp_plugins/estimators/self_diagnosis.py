"""Is the friction model good enough? An answer that needs no knowledge of the plant."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from fraexp.api import Curve, Metric, ParameterError, RecordError, Result, Segment, Signals, param, phasors
from fraexp_plugins.estimators.effective_input import EFFECTIVE_INPUT, EffectiveInputEstimator
from fraexp_plugins.estimators.realisations import Part, circular, combined, groups, mean, power

LEVEL = 0.95
MARGIN = 2.0
"""How far the noise floor may be off: terms of the motion that the scale hides are missing in û_e as well."""
SEED = 0
"""Of the rounding errors that are tried."""


class SelfDiagnosis(EffectiveInputEstimator, name="self_diagnosis", version=2):
    """The scatter of y'/û_e over random phases or amplitudes, against the noise floor, frequency band by band.

    With the right friction model û_e to y' is linear: every realisation gives the same ratio but for noise, whose part
    is known from the periods. A wrong one leaves N - N̂ in it, which depends on the amplitude and on all the other
    lines (the error law; stochastic nonlinear distortions in R. Pintelon and J. Schoukens, System Identification: A
    Frequency Domain Approach, 2nd ed. 2012, ch. 4). With Ĝ = ΣY_m/R_m / ΣU_m/R_m and e_m = (Y_m - ĜU_m)/R_m / mean(U/R)
    the scatter of one realisation is √(Σ|e_m|²/(M-1))/|Ĝ| and its noise floor the same from the scatter of the
    periods' means and from other rounding errors of the scale, which are tried; R is the injected signal, or û_e itself
    where the record has none.

    A band's scatter and noise floor are medians over its lines, its ratio is the root of the median of their squares'
    ratio. The verdict is 1 where the ratio is at most twice what noise alone exceeds in 5 of 100 experiments, or where
    the scatter is within `tolerance`, and otherwise 0: there the friction model is to be identified again. One period
    does not tell the noise: a scatter above `tolerance` then has the verdict NaN, unknown.

    It sees errors of the hysteresis alone: of those the true error of P̂ is one to four times the scatter. A wrong
    viscous friction, a mass or a linear spring are linear from y' to û_e, as P is, and cannot be told from P: the
    verdict is 1, however large that error of P̂ is.

    Not to be used with one realisation, nor at amplitudes so large that friction no longer matters: there every
    friction model is good enough, and P̂ as well.
    """

    reference_channel: str = param("", "channel of the injected signal, if there is one", "excitation")
    bands: tuple[float, ...] = param("Hz", "limits of the frequency bands, ascending", (1.0, 5.0, 20.0, 100.0))
    tolerance: float = param("1", "relative scatter that does no harm", 0.01, at_least=0)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a stepped sine, with which it is tried here: one realisation of each line shows no scatter.",
    )

    def model_post_init(self, context: object) -> None:
        """Check the bands."""
        if len(self.bands) < 2 or min(np.diff(self.bands)) <= 0:
            raise ParameterError("self_diagnosis.bands must be two frequencies at least, ascending")

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e of all realisations, and scatter, noise floor, their ratio and a verdict for each band."""
        self._check_bands(signals.segments)
        units = (signals.unit(self.input), signals.unit(self.output))
        observed = [self._observed(signals.segments)]
        if self.resolution:
            observed.append(self._observed([self._rounded_again(*item) for item in enumerate(signals.segments)]))
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            parts = [self._part(signals, group, observed) for group in groups(signals)]
            found = combined(signals, parts, names=(EFFECTIVE_INPUT, self.output), units=units)
            if not parts:
                return found
            seen = _seen(parts)
            verdicts = list(self._verdicts(seen, parts))
        message = found.message or _remark(verdicts)
        metrics = tuple(metric for verdict in verdicts for metric in verdict.metrics())
        return Result(found.outcome, message, found.response, metrics, (seen,))

    def _check_bands(self, segments: Sequence[Segment]) -> None:
        """Raise RecordError if a band has no line."""
        if not segments:
            return
        lines = np.concatenate([segment.frequency for segment in segments])
        for lowest, highest in itertools.pairwise(self.bands):
            if not np.any((lines >= lowest) & (lines < highest)):
                raise RecordError(
                    f"self_diagnosis.bands: no line lies from {lowest:g} to below {highest:g} Hz; the lines go from "
                    f"{lines.min():.4g} to {lines.max():.4g} Hz: give bands with lines in each"
                )

    def _observed(self, segments: Sequence[Segment]) -> list[np.ndarray]:
        """Return the phasors of û_e and y' of each segment, shape (2, periods, lines)."""
        inputs = self.effective_phasors(segments)
        return [np.stack([u, phasors(segment, self.output)]) for u, segment in zip(inputs, segments, strict=True)]

    def _rounded_again(self, number: int, segment: Segment) -> Segment:
        """Return a segment with another rounding error, the same in each period, as that of a settled motion is."""
        generator = np.random.default_rng([SEED, number])
        change = generator.uniform(-self.resolution / 2, self.resolution / 2, segment.samples)
        return replace(segment, channels={**segment.channels, self.output: segment.channels[self.output] + change})

    def _part(self, signals: Signals, group: Sequence[Segment], observed: Sequence[list[np.ndarray]]) -> Part:
        if len(group) < 2:
            raise RecordError(
                f"self_diagnosis needs several realisations of the same lines, but at {group[0].frequency[0]:.4g} Hz "
                "there is one: take a multisine with 5 realisations or more"
            )
        chosen = [number for number, segment in enumerate(signals.segments) if any(segment is one for one in group)]
        pairs = [np.stack([some[number] for number in chosen], axis=1) for some in observed]
        u, y = pairs[0]
        reference = mean(u, 1)
        if self.reference_channel in signals.units:
            reference = np.stack([mean(phasors(segment, self.reference_channel)) for segment in group])
        u_mean, y_mean = (mean(mean(of, 1) / reference) for of in (u, y))
        response = y_mean / u_mean
        error, *others = ((pair[1] - response * pair[0]) / reference[:, None] / u_mean for pair in pairs)
        of_realisation, (count, periods) = mean(error, 1), error.shape[:2]
        scatter = power(of_realisation) / (count - 1)
        noise = np.full(response.size, np.nan)
        if periods > 1:
            noise = power(error - of_realisation[:, None], (0, 1)) / (count * periods * (periods - 1))
        for other in others:
            noise = noise + power(mean(other, 1) - of_realisation) / count
        size = mean(np.abs(reference))
        return Part(
            tuple(group),
            group[0].frequency,
            response,
            circular(scatter / count),
            2.0 * (count - 1),
            np.abs(u_mean) * size,
            np.abs(y_mean) * size,
            noise_variance=noise / count,
            nonlinear_variance=np.where(np.isfinite(noise), np.maximum(scatter - noise, 0.0), np.nan),
        )

    def _verdicts(self, seen: Curve, parts: Sequence[Part]) -> "Iterator[_Verdict]":
        frequency, scatter, noise = seen.columns.values()
        freedoms = min(_freedoms(part) for part in parts)
        for lowest, highest in itertools.pairwise(self.bands):
            inside = (frequency >= lowest) & (frequency < highest) & np.isfinite(scatter)
            if inside.any():
                middle, floor, ratio = (
                    float(np.median(values[inside])) for values in (scatter, noise, scatter / noise)
                )
                good = float(ratio <= MARGIN * _limit(int(inside.sum()), *freedoms)) if floor >= 0 else np.nan
                verdict = 1.0 if middle <= self.tolerance else good
                yield _Verdict(f"{lowest:g}-{highest:g} Hz", middle, floor, ratio, verdict)


@dataclass(frozen=True)
class _Verdict:
    """What is seen in one frequency band."""

    band: str
    scatter: float
    noise: float
    ratio: float
    verdict: float
    """1 if the friction model will do, 0 if not, NaN if the noise floor is unknown."""

    def metrics(self) -> tuple[Metric, ...]:
        numbers = {"scatter": self.scatter, "noise floor": self.noise, "ratio": self.ratio, "verdict": self.verdict}
        return tuple(Metric(f"{name} {self.band}", number, "1") for name, number in numbers.items())


def _limit(lines: int, scatter: int, noise: int) -> float:
    """Return what the root of the median of so many ratios exceeds in 5 of 100 cases; NaN if the noise is unknown.

    By noise alone a ratio of variances is F distributed, and the probability of the median's quantile beta.
    """
    from scipy.special import betaincinv, fdtri  # scipy: imported only when something is estimated

    if noise == 0:
        return np.nan
    quantile = betaincinv((lines + 1) / 2, (lines + 1) / 2, LEVEL)
    return float(np.sqrt(fdtri(scatter, noise, quantile)))


def _remark(verdicts: Sequence[_Verdict]) -> str:
    if any(np.isnan(each.verdict) for each in verdicts):
        return "one period tells no noise floor, and the scatter is above the tolerance: record two periods at least"
    bad = [each for each in verdicts if not each.verdict]
    if not bad:
        return ""
    worst = max(bad, key=lambda each: each.scatter)
    bands = ", ".join(verdict.band for verdict in bad)
    much = f"{worst.scatter:.0%} from realisation to realisation"
    return f"the friction model does not explain {bands}: y'/û_e scatters by up to {much}"


def _seen(parts: Sequence[Part]) -> Curve:
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
