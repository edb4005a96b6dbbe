"""A frequency response from the phasors of whole periods, segment by segment."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import PeriodicSpectrum, harmonic_phasors, mean_spectrum, response_covariance
from fraexp.analysis.quantisation import line_variance
from fraexp.analysis.steady_motion import steady_leakage, with_steady_motion
from fraexp.analysis.tolerances import ROUNDING, SIGNIFICANCE
from fraexp.data.findings import Finding, at_worst
from fraexp.data.results import HARMONICS, FrequencyResponse, Outcome, Result
from fraexp.data.signals import Segment, Signals
from fraexp.data.texts import frequency_text
from fraexp.errors import RecordError

MIN_PERIODS = 3
"""Periods from which a decay is told from noise."""
DECAYS = (0.0, 0.2, 0.4, 0.6, 0.75, 0.9)
"""Ratios of a transient in successive periods that are tried, from the first period alone to nearly a ramp."""


def find_transient(
    segments: Sequence[Segment], inputs: Sequence[NDArray[np.complex128]], outputs: Sequence[NDArray[np.complex128]]
) -> NDArray[np.float64]:
    """Return the relative error of a mean over the periods by a transient, shape (n,); 0 where a record shows none.

    If some lines had not settled the others hardly had: the error of each counts as far as noise does not explain it.

    The transient is that in the ratio of output to input, whose phasors have the shape (periods, lines) each. Segments
    that state whether they had settled show none.
    """
    if not any(map(_may_settle, segments, inputs)):
        return np.zeros(sum(segment.lines.size for segment in segments))
    parts = [_decay(*each) for each in zip(segments, inputs, outputs, strict=True)]
    chance, error = (np.concatenate([part[key] for part in parts]) for key in (0, 1))
    per_segment = np.array([min(float(part[0].min()) * part[0].size, 1.0) for part in parts])
    error = (1 - chance) * error
    return np.where(_is_transient(per_segment) & (error > ROUNDING), error, 0.0)


def _may_settle(segment: Segment, inputs: NDArray[np.complex128]) -> bool:
    """Return whether it is unknown that a segment has settled, and its periods can show it."""
    return segment.settling is None and len(inputs) >= MIN_PERIODS


def _is_transient(chance: NDArray[np.float64]) -> bool:
    """Return whether noise alone would hardly look like a decay in one of the segments, or in many of them (Fisher).

    Every step of a stepped sine settles alike, and few periods show little each. The lines of one segment share drift.
    """
    if not (chance < 1).any():
        return False
    from scipy.special import gammaincc  # slow to import: listing plugins must stay fast

    together = gammaincc(chance.size, -np.sum(np.log(np.maximum(chance, np.finfo(float).tiny))))
    return min(float(chance.min()) * chance.size, float(together)) < SIGNIFICANCE / 2


def _decay(
    segment: Segment, inputs: NDArray[np.complex128], outputs: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the probability that noise alone explains a decay a + b r^p as well, and the error of the mean by it.

    Both have the shape (lines,). With the share s of the square that remains, F = (1/s - 1) (P - 2) of P periods has
    (2, 2(P - 2)) degrees of freedom, and exceeds that with the probability s^(P - 2).
    """
    lines, periods = segment.lines.size, len(inputs)
    chance, error = np.ones(lines), np.zeros(lines)
    if not _may_settle(segment, inputs):
        return chance, error
    moves = (inputs != 0).all(axis=0) & (outputs.mean(axis=0) != 0)
    ratio = outputs / np.where(moves, inputs, 1.0)
    mean = np.where(moves, ratio.mean(axis=0), 1.0)
    swing = ratio / mean - 1
    total = np.sum(np.abs(swing) ** 2, axis=0)
    for decay in DECAYS:
        shape = decay ** np.arange(periods)
        centred = shape - shape.mean()
        slope = centred @ swing / np.sum(centred**2)
        share = 1 - np.abs(slope) ** 2 * np.sum(centred**2) / np.where(total > 0, total, np.inf)
        found = np.minimum(np.maximum(share, 0.0) ** (periods - 2) * len(DECAYS), 1.0)
        last = np.abs(1 + slope * centred[-1])
        size = np.abs(slope * centred[-1]) / np.where(last > 0, last, np.inf)
        error = np.where(moves & (found < chance), size, error)
        chance = np.where(moves, np.minimum(found, chance), chance)
    return chance, error


SILENCE = 1e-18
"""Amplitude below which a signal is rounding alone, in any unit in which one records."""
NOT_PERIODIC = (
    "the record does not repeat itself (periodic = false), and this estimator needs whole periods: take h1_h2_hv or "
    "local_polynomial, or state the record's period"
)


def response_result(
    signals: Signals,
    inputs: Sequence[NDArray[np.complex128]],
    outputs: Sequence[NDArray[np.complex128]],
    *,
    names: tuple[str, str],
    units: tuple[str, str],
    repeats: bool = True,
) -> Result:
    """Return the response of output over input, averaged over periods, with the covariance that their scatter shows.

    That of one period is known if the encoder is: it is zero for an ideal one.

    `inputs` and `outputs` are the phasors of each segment's periods, shape (periods, lines); `names` and `units` are
    those of input and output; `repeats` is false where these are not periods that should repeat themselves, such as
    blocks of an axis that moves. Raises RecordError for a record that is not periodic, and for segments that repeat the
    same lines.
    """
    if not signals.segments:
        return Result(signals.outcome, signals.findings)
    if not all(segment.periodic for segment in signals.segments):
        raise RecordError(NOT_PERIODIC)
    _check_realisations(signals.segments)
    spectra = _spectra(signals.segments, inputs, outputs)
    u, y = np.concatenate([s.input for s in spectra]), np.concatenate([s.output for s in spectra])
    silent = (np.abs(u) < SILENCE) | (np.abs(y) < SILENCE)
    u, y = np.where(silent, np.nan, u), np.where(silent, np.nan, y)
    var_u = np.concatenate([s.input_variance for s in spectra])
    var_y = np.concatenate([s.output_variance for s in spectra])
    cov_yu = np.concatenate([s.covariance for s in spectra])
    with np.errstate(invalid="ignore"):  # where nothing moves
        ratio, covariance = y / u, response_covariance(u, y, var_u, var_y, cov_yu)
    lines = [segment.lines.size for segment in signals.segments]
    pairs = zip(signals.segments, outputs, strict=True)
    known = np.repeat([_known_variance(signals, *pair, names[1]) for pair in pairs], lines)
    known_covariance = (known / np.abs(u) ** 2)[:, None, None] * (np.eye(2) / 2)
    covariance = np.where(np.isfinite(known_covariance), known_covariance, covariance)
    freedom = np.repeat([2.0 * (len(each) - 1) for each in outputs], lines)
    frequency = np.concatenate([s.frequency for s in spectra])
    repeated = signals.segments if repeats else ()
    transient = find_transient(repeated, inputs, outputs) if repeated else np.zeros(frequency.size)
    square, scatter = (transient * np.abs(ratio)) ** 2, np.nan_to_num(np.trace(covariance, axis1=1, axis2=2))
    covariance, where = covariance + square[:, None, None] * (np.eye(2) / 2), square > scatter
    moving = "mean over the periods off by"
    settling = at_worst("still settling", frequency, where, transient, moving) if where.any() else None
    moved = []
    for name, unit in zip(names, units, strict=True) if repeated else ():
        error = np.concatenate([steady_leakage(segment, name) for segment in repeated])
        covariance, found = with_steady_motion(repeated, name, unit, error, frequency, ratio, covariance)
        moved.append(found)
    settlings = [segment.settling for segment in signals.segments]
    lacks_amplitude = np.repeat([bool(s.stated and not s.stated.has_amplitude) for s in signals.segments], lines)
    response = FrequencyResponse(
        frequency=frequency,
        response=ratio,
        covariance=covariance,
        unit=f"{units[1]}/{units[0]}",
        input=names[0],
        output=names[1],
        input_amplitude=np.where(lacks_amplitude, np.nan, np.abs(u)),
        output_amplitude=np.where(lacks_amplitude, np.nan, np.abs(y)),
        settled=~silent & np.repeat([not known or known.settled for known in settlings], lines),
        settling_time=np.repeat([known.time if known else np.nan for known in settlings], lines),
        residual=np.repeat([known.residual if known else np.nan for known in settlings], lines),
        harmonics=_relative_harmonics(signals.segments, names[1]),
        freedom=np.where(np.isfinite(known), np.inf, freedom),
        coherence=_stated_coherence(signals.segments),
    )
    if silent.all() and signals.outcome is Outcome.OK:
        return Result(Outcome.NO_MOTION, (silence(frequency, silent),), response)
    silenced = silence(frequency, silent) if silent.any() else None
    result = Result(signals.outcome, (), response).with_findings(silenced, is_doubt=True)
    result = result.with_findings(*moved, settling, *signals.findings)
    from_rest = any(known and known.time == 0 and known.settled for known in settlings)
    return result.with_findings(Finding("from rest") if from_rest and not result.findings else None)


def silence(frequency: NDArray[np.float64], silent: NDArray[np.bool_]) -> Finding:
    """Return at which frequencies [Hz] there is no response, because nothing moves; at least one."""
    return Finding("no motion", (), tuple(map(float, frequency[silent])), silent.size)


def _known_variance(signals: Signals, segment: Segment, outputs: NDArray[np.complex128], output: str) -> float:
    """Return the variance of the output's phasors at each line [unit²]; NaN where periods or nothing show it.

    A record from rest contains a transient, which is no noise.
    """
    if segment.stated is not None:
        return segment.stated.output_variance
    is_from_rest = segment.settling is not None and segment.settling.time == 0
    if signals.encoder is None or len(outputs) > 1 or is_from_rest:
        return np.nan
    return line_variance(segment, signals.encoder, output)


def _stated_coherence(segments: Sequence[Segment]) -> NDArray[np.float64] | None:
    """Return the coherence of a response that was measured elsewhere, shape (n,); None if it is not known."""
    found = np.array([segment.stated.coherence for segment in segments if segment.stated is not None])
    return found if found.size == len(segments) and np.isfinite(found).any() else None


def _check_realisations(segments: Sequence[Segment]) -> None:
    """Raise RecordError where segments have the same lines: their periods are not those of one experiment."""
    alike = Counter((segment.lines.tobytes(), segment.samples, segment.sample_time) for segment in segments)
    (lines, samples, sample_time), count = alike.most_common(1)[0]
    if count > 1:
        frequency = np.frombuffer(lines, dtype=np.int64) / (samples * sample_time)
        raise RecordError(
            f"{count} of {len(segments)} segments have the same frequencies, {frequency_text(frequency)}, and this "
            "estimator expects each frequency once: it does not average over realisations or amplitudes; take "
            "best_linear_approximation for realisations, fraexp identify for amplitudes, or measure each frequency once"
        )


def _spectra(
    segments: Sequence[Segment], inputs: Sequence[NDArray[np.complex128]], outputs: Sequence[NDArray[np.complex128]]
) -> list[PeriodicSpectrum]:
    """Return the means over periods: of all segments at once if they have equally many periods."""
    if len({len(each) for each in inputs}) > 1:
        return [mean_spectrum(s.frequency, u, y) for s, u, y in zip(segments, inputs, outputs, strict=True)]
    frequency = np.concatenate([segment.frequency for segment in segments])
    return [mean_spectrum(frequency, np.concatenate(inputs, axis=1), np.concatenate(outputs, axis=1))]


def _relative_harmonics(segments: Sequence[Segment], channel: str) -> NDArray[np.complex128]:
    """Return the harmonics 2… of single sines relative to their fundamentals, shape (lines, HARMONICS - 1).

    NaN above the Nyquist frequency, and for segments of several lines.
    """
    places = np.cumsum([0, *(segment.lines.size for segment in segments)])
    sums = np.full((places[-1], HARMONICS), np.nan, dtype=complex)
    for place, segment in zip(places[:-1].tolist(), segments, strict=True):
        if segment.lines.size == 1 and channel in segment.channels and segment.stated is None:
            found = np.add.reduce(harmonic_phasors(segment, channel), axis=0)
            if found[0] != 0:
                sums[place, : found.size] = found
    known, fundamental = ~np.isnan(sums[:, 1:]), np.broadcast_to(sums[:, :1], sums[:, 1:].shape)
    sums[:, 1:][known] /= fundamental[known]
    return sums[:, 1:]
