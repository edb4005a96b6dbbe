"""A frequency response from the phasors of whole periods, segment by segment."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import PeriodicSpectrum, harmonic_phasors, mean_spectrum, response_covariance
from fraexp.analysis.quantisation import line_variance
from fraexp.analysis.settling_periods import find_transient
from fraexp.analysis.steady_motion import steady_motion_text
from fraexp.data.frequency_text import frequency_text
from fraexp.data.results import HARMONICS, FrequencyResponse, Outcome, Result
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError

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
        return Result(signals.outcome, signals.message)
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
    known = np.repeat([_known_variance(signals, *pair) for pair in zip(signals.segments, outputs, strict=True)], lines)
    known_covariance = (known / np.abs(u) ** 2)[:, None, None] * (np.eye(2) / 2)
    covariance = np.where(np.isfinite(known_covariance), known_covariance, covariance)
    freedom = np.repeat([2.0 * (len(each) - 1) for each in outputs], lines)
    frequency = np.concatenate([s.frequency for s in spectra])
    repeated = signals.segments if repeats else ()
    transient = find_transient(repeated, frequency, inputs, outputs)
    settlings = [segment.settling for segment in signals.segments]
    lacks_amplitude = np.repeat([_lacks_amplitude(segment) for segment in signals.segments], lines)
    response = FrequencyResponse(
        frequency=frequency,
        response=ratio,
        covariance=covariance,
        unit=f"{units[1]}/{units[0]}",
        input=names[0],
        output=names[1],
        input_amplitude=np.where(lacks_amplitude, np.nan, np.abs(u)),
        output_amplitude=np.where(lacks_amplitude, np.nan, np.abs(y)),
        settled=~(silent | transient.is_large) & np.repeat([not known or known.settled for known in settlings], lines),
        settling_time=np.repeat([known.time if known else np.nan for known in settlings], lines),
        residual=np.repeat([known.residual if known else np.nan for known in settlings], lines),
        harmonics=_relative_harmonics(signals.segments, names[1]),
        freedom=np.where(np.isfinite(known), np.inf, freedom),
        coherence=_stated_coherence(signals.segments),
    )
    if silent.all() and signals.outcome is Outcome.OK:
        return Result(Outcome.NO_MOTION, _silence_text(frequency, silent), response)
    doubts = [_silence_text(frequency, silent), transient.message, steady_motion_text(repeated, names[1], units[1])]
    outcome, message = signals.outcome, "; ".join(filter(None, (*doubts, signals.message)))
    if any(doubts) and outcome is Outcome.OK:
        outcome = Outcome.INACCURATE
    if not message and any(known and known.time == 0 and known.settled for known in settlings):
        message = "recorded from rest: the transient is in the response, which a mean over periods does not take off"
    return Result(outcome, message, response)


def _silence_text(frequency: NDArray[np.float64], silent: NDArray[np.bool_]) -> str:
    """Return at which frequencies [Hz] there is no response, because nothing moves; empty if there are none."""
    if not silent.any():
        return ""
    places = f"{silent.sum()} of {silent.size} frequencies ({frequency_text(frequency[silent])})"
    return f"at {places} input or output does not move"


def _known_variance(signals: Signals, segment: Segment, outputs: NDArray[np.complex128]) -> float:
    """Return the variance of the output's phasors at each line [unit²]; NaN where periods or nothing show it.

    A record from rest contains a transient, which is no noise.
    """
    if segment.stated is not None:
        return segment.stated.output_variance
    is_from_rest = segment.settling is not None and segment.settling.time == 0
    if signals.encoder is None or len(outputs) > 1 or is_from_rest:
        return np.nan
    return line_variance(segment, signals.encoder)


def _lacks_amplitude(segment: Segment) -> bool:
    """Return whether the amplitude of the input is unknown."""
    return segment.stated is not None and not segment.stated.has_amplitude


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
            "estimator expects each frequency once: it does not average over realisations or amplitudes; use one that "
            "does, such as best_linear_approximation, or measure each frequency once"
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
