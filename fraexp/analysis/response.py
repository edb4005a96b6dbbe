"""A frequency response from the phasors of whole periods, segment by segment."""

from collections.abc import Sequence

import numpy as np

from fraexp.analysis.fourier import PeriodicSpectrum, harmonic_phasors, response_covariance, spectrum
from fraexp.data.results import HARMONICS, FrequencyResponse, Outcome, Result
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError

UNREPEATED = (
    "the record does not repeat itself (periodic = false), and this estimator needs whole periods: take spectral or "
    "local_polynomial, or give the record's period"
)


def response_result(
    signals: Signals,
    inputs: Sequence[np.ndarray],
    outputs: Sequence[np.ndarray],
    *,
    names: tuple[str, str],
    units: tuple[str, str],
) -> Result:
    """Return the response of output over input, averaged over periods, with the covariance that their scatter shows.

    `inputs` and `outputs` hold per segment the phasors of each period, complex, of shape (periods, lines); `names`
    and `units` are those of input and output.
    """
    if not signals.segments:
        return Result(signals.outcome, signals.message)
    if not all(segment.periodic for segment in signals.segments):
        raise RecordError(UNREPEATED)
    _check_realisations(signals.segments)
    spectra = _spectra(signals.segments, inputs, outputs)
    u, y = np.concatenate([s.input for s in spectra]), np.concatenate([s.output for s in spectra])
    silent = (np.abs(u) == 0) | (np.abs(y) == 0)
    u, y = np.where(silent, np.nan, u), np.where(silent, np.nan, y)
    scatter = [np.concatenate([getattr(s, part) for s in spectra]) for part in ("var_input", "var_output", "cov")]
    with np.errstate(invalid="ignore"):  # where nothing moves
        ratio, covariance = y / u, response_covariance(u, y, *scatter)
    response = FrequencyResponse(
        frequency=np.concatenate([s.frequency for s in spectra]),
        response=ratio,
        covariance=covariance,
        unit=f"{units[1]}/{units[0]}",
        input=names[0],
        output=names[1],
        input_amplitude=np.abs(u),
        output_amplitude=np.abs(y),
        settled=~silent & _per_line(signals, [s.settling.settled if s.settling else True for s in signals.segments]),
        settling_time=_per_line(signals, [s.settling.time if s.settling else np.nan for s in signals.segments]),
        residual=_per_line(signals, [s.settling.residual if s.settling else np.nan for s in signals.segments]),
        harmonics=np.concatenate([_harmonics(s, names[1]) for s in signals.segments]),
        freedom=np.concatenate([np.full(of.shape[1], 2.0 * (len(of) - 1)) for of in outputs]),
    )
    if silent.any() and signals.outcome is Outcome.OK:
        message = f"at {silent.sum()} of {silent.size} frequencies input or output does not move"
        return Result(Outcome.NO_SIGNAL, message, response)
    message = signals.message
    if not message and any(s.settling and s.settling.time == 0 and s.settling.settled for s in signals.segments):
        message = "recorded from rest: the transient is in the response, which a mean over periods does not take off"
    return Result(signals.outcome, message, response)


def _check_realisations(segments: Sequence[Segment]) -> None:
    """Raise RecordError where segments have the same lines: their periods are not those of one experiment."""
    seen = {(segment.lines.tobytes(), segment.samples, segment.sample_time) for segment in segments}
    if len(seen) < len(segments):
        raise RecordError(
            f"{len(segments)} segments have {len(seen)} different sets of frequencies: of several realisations, or of "
            "several amplitudes, one mean over periods says nothing; take an estimator that looks at them together"
        )


def _spectra(
    segments: Sequence[Segment], inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray]
) -> list[PeriodicSpectrum]:
    """Return the averages over periods: of all segments at once where they have equally many."""
    if len({len(each) for each in inputs}) > 1:
        return [spectrum(s.frequency, u, y) for s, u, y in zip(segments, inputs, outputs, strict=True)]
    frequency = np.concatenate([segment.frequency for segment in segments])
    return [spectrum(frequency, np.concatenate(inputs, axis=1), np.concatenate(outputs, axis=1))]


def _per_line(signals: Signals, values: Sequence[float | bool]) -> np.ndarray:
    return np.repeat(np.array(values), [segment.lines.size for segment in signals.segments])


def _harmonics(segment: Segment, channel: str) -> np.ndarray:
    """Harmonics 2… of a single sine relative to its fundamental; NaN beyond Nyquist and for several lines."""
    result = np.full((segment.lines.size, HARMONICS - 1), np.nan, dtype=complex)
    if segment.lines.size == 1 and channel in segment.channels:
        sums = harmonic_phasors(segment, channel).sum(axis=0)
        if sums[0] != 0:
            result[0, : sums.size - 1] = sums[1:] / sums[0]
    return result
