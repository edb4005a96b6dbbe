"""Division of a record into runs of samples, and of these into blocks of whole periods and whole samples."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fraexp.data.signals import RecordTable, Settling
from fraexp.data.sweep import Plain
from fraexp.errors import ParameterError, RecordError
from fraexp.records.record_settings import MIN_BLOCKS, RecordSettings, Step

RELATIVE_ROUNDING = 1e-9
"""Relative difference of samples and periods that is rounding in the study."""
MAX_REMAINDER = 0.01
"""Part of a realisation that may remain at the end of a record."""
MIN_APERIODIC_SAMPLES = 100
"""Least number of samples of an aperiodic record."""
MIN_PERIOD_SAMPLES = 2
"""Least number of samples of a period."""
MAX_APERIODIC_LINES = 200
"""Number of frequencies of an aperiodic record, unless the study gives them."""
APERIODIC_SETTLING = Settling(settled=True, time=0.0, residual=float("nan"))
"""Settling of an aperiodic record: what preceded its first sample is unknown."""
MIN_FREQUENCY_RATIO = 0.5
"""Frequency relative to the lowest line below which an integral is set to 0: there it is drift and noise."""
CONDITION_PATTERN = re.compile(r"^\s*(?P<column>\S.*?)\s*=\s*(?P<value>[^=\s]+)\s*$")
VALUE_TOLERANCE = 1e-6
"""Relative difference up to which a column has the requested value."""
MAX_SHOWN_VALUES = 8
"""Maximum number of values in a message."""
SampleRun = tuple[str, tuple[int, int]]
"""Name of a run for messages, its first sample, and the one after its last."""


@dataclass(frozen=True)
class Cut:
    """Consecutive blocks of equal length, each of whole periods, which form a segment."""

    start: int
    """Index of the first sample."""
    blocks: int
    samples: int
    """Samples per block."""
    periods: int
    """Periods per block."""
    sample_time: float
    """Sample time [s] with which the block has exactly whole periods: the record's, within the allowed slip."""
    lines: tuple[int, ...] = ()
    """Excited harmonics of the block."""
    periodic: bool = True
    """False for an aperiodic record, which is a single block."""
    left_out: int = 0
    """Number of lines above the noise that are left out although they are not much weaker than others."""
    doubtful: int = 0
    """Number of lines that count although they are much weaker than the others."""
    rest: int | None = None
    """Index of the sample before which the machine was at rest, if it is known."""
    settled: bool | None = None
    """Whether it was periodic at its start, if it is known."""
    residual: float | None = None
    """Relative difference of the last periods compared before it, if it is known."""
    expected: Mapping[str, float] = field(default_factory=dict)
    """Amplitude of channels at the excited lines [N or m, or N m and rad], where it was predicted."""
    excitation: tuple[tuple[float, float], ...] = ()
    """Amplitude [N or N m] and phase [deg] of what was to be played at each line, from `start` on, if it is known."""

    def blocks_of(self, channel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the blocks of a channel, shape (blocks, samples)."""
        return channel[self.start : self.start + self.blocks * self.samples].reshape(self.blocks, self.samples)

    def as_plain(self) -> Plain:
        """Return the plain data that identifies the segment."""
        found = {key: getattr(self, key) for key in ("left_out", "doubtful", "expected", "excitation")}
        known = {key: getattr(self, key) for key in ("rest", "settled", "residual")}
        return {
            "start": self.start,
            "periods": self.blocks,
            "samples": self.samples,
            "sample_time": self.sample_time,
            "lines": list(self.lines),
            **({} if self.periodic else {"periodic": False}),
            **{key: value for key, value in found.items() if value},
            **{key: value for key, value in known.items() if value is not None},
        }

    @classmethod
    def from_plain(cls, data: Plain) -> "Cut":
        """Return the cut that `as_plain` describes."""
        more = {of.name: data[of.name] for of in fields(cls) if of.name in data and of.name != "periods"}
        for key in {"lines", "excitation"} & more.keys():
            more[key] = tuple(tuple(one) if isinstance(one, list | tuple) else one for one in more[key])
        return cls(blocks=data["periods"], periods=1, **more)

    @property
    def settling(self) -> Settling | None:
        """What is known of the time before its first period; None if nothing is."""
        if not self.periodic:
            return APERIODIC_SETTLING
        if self.settled is None:
            return None
        waited = float("nan") if self.rest is None else (self.start - self.rest) * self.sample_time
        return Settling(self.settled, waited, float("nan") if self.residual is None else self.residual)


def coherent_block(period: float, available: float, slip: float, least: int = MIN_BLOCKS) -> tuple[int, int] | None:
    """Return the fewest samples that are whole periods, and the number of periods, so that two blocks fit.

    `least` is another number of blocks than two. `period` is in samples; `slip` is the greatest difference of the
    two, in periods. None if there are none.
    """
    periods = np.arange(1, int(available / least / period + slip) + 1)
    samples = np.rint(periods * period)
    fitting = np.flatnonzero((np.abs(samples - periods * period) <= slip * period) & (least * samples <= available))
    return (int(samples[fitting[0]]), int(periods[fitting[0]])) if fitting.size else None


def _slip_advice(period: float, available: float, least: int) -> str:
    """Return the slip to give [periods], rounded up to two digits, with which blocks fit; empty if none does."""
    periods = np.arange(1, int(available / least / period) + 1)
    samples = np.rint(periods * period)
    slips = np.abs(samples - periods * period)[least * samples <= available] / period
    slip = float(slips.min(initial=np.inf))
    if not 0 < slip < np.inf:
        return ""
    digit = 10.0 ** (np.floor(np.log10(slip)) - 1)
    return f" to {np.ceil(slip / digit) * digit:.2g}"


def periodic_cut(settings: RecordSettings, rate: float, run: tuple[int, int], place: str) -> Cut:
    """Return the blocks of a periodic record from the first sample of a run to before its last, without its lines."""
    period = stated_period(settings, rate)
    if not MIN_PERIOD_SAMPLES <= period <= run[1]:
        raise RecordError(
            f"{place}: a period of {period:.4g} samples; expected {MIN_PERIOD_SAMPLES} to {run[1]}, those of the record"
        )
    start = run[0] + round(settings.skip_time * rate) + round(settings.skip_periods * period)
    return _block_cut(start, run[1], period, settings.max_phase_slip, rate, place, settings.min_blocks)


def stated_period(settings: RecordSettings, rate: float) -> float:
    """Return the period that the study states [samples]."""
    return float(settings.samples_per_period) if settings.samples_per_period else (settings.period_time or 0.0) * rate


def split_realisations(
    settings: RecordSettings, rate: float, run: tuple[int, int], place: str
) -> list[tuple[int, int]]:
    """Return the runs of the realisations that follow one another in a run, or the run itself."""
    if not settings.periods_per_realisation:
        return [run]
    length = settings.periods_per_realisation * stated_period(settings, rate)
    count = int((run[1] - run[0]) / length + RELATIVE_ROUNDING)
    if (
        settings.periods_per_realisation * stated_period(settings, rate) * max(count, 1)
        < run[1] - run[0] - length * MAX_REMAINDER
        or not count
    ):
        raise RecordError(
            f"{place}: {run[1] - run[0]} samples are {(run[1] - run[0]) / length:.2f} realisations of "
            f"{settings.periods_per_realisation} periods; expected a whole number: correct "
            "periods_per_realisation (--periods) or the period"
        )
    edges = [run[0] + round(number * length) for number in range(count + 1)]
    return list(pairwise(edges))


def whole_cut(settings: RecordSettings, rate: float, run: tuple[int, int], place: str) -> Cut:
    """Return a run that does not repeat itself as one block.

    Its lines are the frequencies of the response. They begin at `min_frequency`, or at ten periods in the run, and end
    at `max_frequency`, or at a fifth of the sample rate, and are spaced evenly over the logarithm of the frequency.
    """
    start = run[0] + round(settings.skip_time * rate)
    samples = run[1] - start
    if settings.skip_periods or settings.harmonics:
        key = "skip_periods" if settings.skip_periods else "harmonics"
        raise RecordError(
            f"{place}: {key} counts periods, and the record has none; give skip_time, min_frequency and max_frequency"
        )
    if samples < MIN_APERIODIC_SAMPLES:
        raise RecordError(f"{place}: {max(samples, 0)} samples are left; expected at least {MIN_APERIODIC_SAMPLES}")
    if max(settings.min_frequency or 0.0, settings.max_frequency or 0.0) > rate / 2:
        raise RecordError(
            f"{place}: min_frequency and max_frequency reach "
            f"{max(settings.min_frequency or 0.0, settings.max_frequency or 0.0):g} Hz; "
            f"expected {rate / 2:g} Hz at most, half the sample rate"
        )
    first = max(round((settings.min_frequency or 10 * rate / samples) * samples / rate), 1)
    last = min(round((settings.max_frequency or rate / 5) * samples / rate), (samples - 1) // 2)
    if last < first:
        raise RecordError(
            f"{place}: no frequency between {first * rate / samples:.4g} and {last * rate / samples:.4g} Hz can be "
            f"resolved; expected min_frequency below max_frequency, and that below {rate / 2:g} Hz"
        )
    lines = np.unique(np.rint(np.geomspace(first, last, MAX_APERIODIC_LINES)).astype(int))
    return Cut(start, 1, samples, 1, 1 / rate, tuple(lines.tolist()), periodic=False)


def played_cuts(settings: RecordSettings, rate: float, length: int, place: str) -> list[Cut]:
    """Return the segments that the study states sample by sample."""
    cuts = []
    for number, one in enumerate(settings.segments, start=1):
        here, stop = f"{place}, segment {number}", one.start + one.periods * one.samples
        if stop > length:
            raise RecordError(f"{here}: it ends at sample {stop}; the record has {length}: record to the end")
        if not one.harmonics or min(one.harmonics) < 1 or 2 * max(one.harmonics) >= one.samples:
            stated = f"{min(one.harmonics)} to {max(one.harmonics)}" if one.harmonics else "none"
            raise RecordError(f"{here}: its harmonics are {stated}; expected some from 1 to below {one.samples / 2:g}")
        if one.rest is not None and one.rest > one.start:
            raise RecordError(f"{here}: rest is sample {one.rest}; expected one before its start, {one.start}")
        if one.excitation and len(one.excitation) != len(one.harmonics):
            raise RecordError(
                f"{here}: excitation has {len(one.excitation)} pairs of amplitude and phase, and there are "
                f"{len(one.harmonics)} harmonics; expected one for each, or none"
            )
        lines = tuple(sorted(one.harmonics))
        excitation = tuple(one.excitation[k] for k in np.argsort(one.harmonics).tolist()) if one.excitation else ()
        cut = Cut(one.start, one.periods, one.samples, 1, 1 / rate, lines)
        known = replace(cut, rest=one.rest, settled=one.settled, residual=one.residual)
        cuts.append(replace(known, expected=one.expected, excitation=excitation))
    return cuts


def step_cuts(settings: RecordSettings, steps: Iterable[Step], rate: float, length: int, place: str) -> list[Cut]:
    """Return the blocks of each frequency of a stepped sine; the line is the number of periods per block."""
    cuts = []
    for number, step in enumerate(steps, start=1):
        here = f"{place}, step {number} ({step.frequency:g} Hz)"
        if not step.start < step.stop <= (length + 1) / rate:
            raise RecordError(
                f"{here}: it lasts from {step.start:g} to {step.stop:g} s; expected to lie within {length / rate:g} s"
            )
        if step.frequency >= rate / 2:
            raise RecordError(f"{here}: expected less than half the sample rate of {rate:g} Hz")
        period = rate / step.frequency
        start = round((step.start + settings.skip_time) * rate) + round(settings.skip_periods * period)
        cut = _block_cut(start, min(round(step.stop * rate), length), period, settings.max_phase_slip, rate, here)
        cuts.append(replace(cut, lines=(cut.periods,)))
    return cuts


def find_runs(values: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return first sample, and the one after the last, of each run of equal values above 0."""
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), values.size]
    return [(start, stop) for start, stop in pairwise(edges) if values[start] > 0]


def find_steps(frequency: NDArray[np.float64], rate: float) -> list[Step]:
    """Return the steps of constant frequency above 0 in a frequency channel [Hz], shape (n,)."""
    runs = find_runs(frequency)
    return [Step(start=start / rate, stop=stop / rate, frequency=float(frequency[start])) for start, stop in runs]


def _block_cut(  # the numbers of one cut
    start: int, stop: int, period: float, slip: float, rate: float, place: str, least: int = MIN_BLOCKS
) -> Cut:
    available = stop - start
    if available < least * period * (1 - slip):
        raise RecordError(
            f"{place}: {max(available, 0)} samples are left, {max(available, 0) / period:.2f} periods; "
            f"expected at least {least} periods of {period:.6g} samples"
        )
    found = coherent_block(period, available, slip, least)
    if found is None:
        raise RecordError(
            f"{place}: no whole number of periods of {period:.6g} samples is a whole number of samples within "
            f"{slip:g} periods and fits twice into {available} samples; raise max_phase_slip"
            f"{_slip_advice(period, available, least)} (--max-phase-slip), or record for longer"
        )
    samples, periods = found
    # A clock that is corrected by the slip gives the lines their true frequencies. Leakage affects input and output
    # equally, and their common drift from block to block cancels in the response and its covariance.
    clock_factor = periods * period / samples
    exact = abs(clock_factor - 1) < RELATIVE_ROUNDING
    return Cut(start, available // samples, samples, periods, 1 / rate if exact else clock_factor / rate)


def parse_condition(select: str, place: str) -> tuple[str, float] | None:
    """Return column and value of a condition such as ``amplitude = 12``; None if it is empty."""
    if not select:
        return None
    found = CONDITION_PATTERN.match(select)
    try:
        return (found["column"], float(found["value"])) if found else _refuse_condition(select, place)
    except ValueError:
        return _refuse_condition(select, place)


def _refuse_condition(select: str, place: str) -> tuple[str, float]:
    raise ParameterError(f"{place}: select is '{select}'; expected a column and a number, such as 'amplitude = 12'")


def select_runs(settings: RecordSettings, table: RecordTable, size: int, place: str) -> list[SampleRun]:
    """Return the runs of samples of `select`, separated by `segment_column`; by default one run of all samples."""
    chosen = parse_condition(settings.select, place)
    if chosen is None and settings.segment_column is None:
        return [(place, (0, size))]
    values = np.ones(size) if settings.segment_column is None else table.columns[settings.segment_column.column].copy()
    if chosen is not None:
        column, value = chosen
        there = np.isclose(table.columns[column], value, rtol=VALUE_TOLERANCE, atol=0.0)
        if not there.any():
            known = np.unique(table.columns[column])
            more = " and more" if known.size > MAX_SHOWN_VALUES else ""
            listed = ", ".join(f"{one:g}" for one in known[:MAX_SHOWN_VALUES]) + more
            raise RecordError(f"{place}: '{column}' is nowhere {value:g}; it is {listed}")
        values = np.where(there, values, 0.0)
    runs = find_runs(values)
    if not runs:
        raise RecordError(f"{place}: the column of segments is nowhere above 0; expected a number for each segment")
    return [(f"{place}, samples {start + 1} to {stop}", (start, stop)) for start, stop in runs]


def integrate_blocks(blocks: NDArray[np.float64], cut: Cut, times: int, place: str) -> NDArray[np.float64]:
    """Return blocks of a channel, shape (blocks, samples), integrated `times` times; if below 0, differentiated.

    A periodic record is divided by (jω)ⁿ at all its frequencies at once, which is exact at its lines; its mean and
    what lies below half the lowest line cannot be integrated and become 0. A record that does not repeat itself is
    differentiated by central differences, too small by (ωTs)²/6, and cannot be integrated: it would drift.
    """
    if not times:
        return blocks
    if not cut.periodic and times > 0:
        raise RecordError(
            f"{place}: a record that does not repeat itself cannot be integrated, its offset would grow without end; "
            "give a measured position, or cut whole periods"
        )
    record = blocks.ravel()
    if not cut.periodic:
        for _ in range(-times):
            record = np.gradient(record, cut.sample_time)
        return record.reshape(blocks.shape)
    omega = 2 * np.pi * np.fft.rfftfreq(record.size, cut.sample_time)
    lowest = 2 * np.pi * cut.lines[0] / (cut.samples * cut.sample_time)
    kept = omega > (MIN_FREQUENCY_RATIO * lowest if times > 0 else 0.0)
    kept[-1] &= record.size % 2 == 1  # at the Nyquist frequency a derivative has no phase
    factor = np.zeros(omega.size, dtype=complex)
    factor[kept] = (1j * omega[kept]) ** -times
    return np.fft.irfft(factor * np.fft.rfft(record), record.size).reshape(blocks.shape)
