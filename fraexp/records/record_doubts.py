"""Doubts about a loaded record: wrong columns, and samples that no machine can have moved through.

A record that was played is compared with its own loop, or with what was predicted. Forces accelerate a mass: from
sample to sample its motion changes by no more than it usually does. A sample that leaps and comes back, a motion that
stops within a sample, and a jump against the direction of motion are those of a sensor.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fraexp.analysis.fourier import line_amplitude, phasors
from fraexp.analysis.quantisation import smallest_step
from fraexp.data.findings import Finding, Quantity
from fraexp.data.signals import Segment
from fraexp.records.channels import SAMPLE_TIMES
from fraexp.records.cutting import Cut
from fraexp.records.loop_equation import FACTORS, WRONG, FaultKind, LoopController, fault_finding, judge_columns
from fraexp.records.record_settings import INJECTED_CHANNELS

TRUSTED = {"N": (1 / 1.4, 1.4), "m": (1 / 300, 10.0)}
TRUSTED |= {"N m": TRUSTED["N"], "rad": TRUSTED["m"]}
"""Amplitude over the predicted one, in the median of all segments, within which a channel of a unit is not in doubt.

Most of the control input is the excitation. How far a machine moves depends on what the measurement is to show: by
friction it may move much less. Simulated with half and twice the gain, and with friction from none to what nearly
holds the axis, control inputs had ratios of 0.9 to 1.15, and positions of 0.005 to 4.
"""
UNIT_RATIO = {"N": 1.4, "m": 3.0, "N m": 1.4, "rad": 1.7}
"""Ratio to such a factor, either way, up to which the unit is named."""
SATURATED_SHARE, SATURATION_TOLERANCE = 0.01, 1e-6
"""Share of the samples at either limit from which a drive is at it, and relative distance that counts as there."""
LOOP_UNITS = (("N", "m"), ("N m", "rad"))
"""Units of control input and position in which controllers count."""


def column_doubts(
    segments: Sequence[Segment],
    cuts: Sequence[Cut],
    units: Mapping[str, str],
    controller: Sequence[Sequence[float]] | None,
) -> tuple[Finding, ...]:
    """Return what is wrong with the columns of a record that was played, or unverified; empty if nothing is.

    Where the controller is known, what it answers to the position is looked for in the control input. That says more
    than amplitudes that were predicted, which count where it says nothing. A record that states a part of its loop, and
    not all of it, is not verified: amplitudes cannot take the place of the comparison.
    """
    predicted, are_played = [cut.expected for cut in cuts], [bool(cut.excitation) for cut in cuts]
    if controller is None or not all(are_played) or (units.get("u"), units.get("y")) not in LOOP_UNITS:
        is_stated = controller is not None or any(are_played)
        unverified = (Finding("not verified", place="'u' and 'y'"),) if is_stated else ()
        return prediction_doubts(segments, predicted, units) + unverified
    known = LoopController(*(np.array(part) for part in controller))
    verdict = judge_columns(segments, cuts, known)
    own = (fault_finding(verdict.fault, units),) if verdict.fault else ()
    if verdict.fault is not None and verdict.fault.kind is not FaultKind.UNKNOWN:
        return own
    if verdict.fault is not None and (limit := _saturation([segment.channels["u"] for segment in segments])):
        text = (
            "'u' stays at either limit for a part of the time, and is not the excitation minus what the controller "
            "makes of 'y': the drive is at its limit"
        )
        limits = (Quantity(limit, units["u"], "limits ±"),)
        return (Finding(WRONG, limits, text=text, remedy="lower excitation.amplitude"),)
    return (() if verdict.is_shown else prediction_doubts(segments, predicted, units)) or own


def _saturation(inputs: Sequence[NDArray[np.float64]]) -> float:
    """Return the control input beyond which none goes, either way, and at which many samples stay; 0 if none does."""
    samples = np.concatenate([each.ravel() for each in inputs])
    limit = float(np.abs(samples).max())
    shares = [np.mean(np.isclose(samples, sign * limit, rtol=SATURATION_TOLERANCE, atol=0.0)) for sign in (1, -1)]
    return limit if min(shares) > SATURATED_SHARE else 0.0


def prediction_doubts(
    segments: Sequence[Segment], expected: Sequence[Mapping[str, float]], units: Mapping[str, str]
) -> tuple[Finding, ...]:
    """Return what contradicts the prediction with which the excitation was written; empty if nothing does.

    `expected` has the amplitude of channels at the excited lines of each segment; none where nothing was predicted.
    """
    predicted = {name for of in expected for name in of if units.get(name) in TRUSTED}
    ratios = {name: _median_ratio(segments, expected, name, name) for name in sorted(predicted)}
    doubts = [name for name, ratio in ratios.items() if ratio and not _is_trusted(ratio, units[name])]
    if doubts and len(predicted) == 2:
        first, second = sorted(predicted)
        crossed = [_median_ratio(segments, expected, *pair) for pair in ((first, second), (second, first))]
        if all(_is_trusted(ratio, units[name]) for ratio, name in zip(crossed, (second, first), strict=True)):
            text = (
                f"'{first}' and '{second}' have the amplitudes that were predicted of each other when the excitation "
                "was written, as if their columns were swapped"
            )
            return (Finding(WRONG, text=text, remedy="exchange them in record.channels"),)
    return tuple(_unlike_prediction(name, ratios[name], units[name]) for name in doubts)


def _unlike_prediction(name: str, ratio: float, unit: str) -> Finding:
    near = [other for factor, other in FACTORS[unit].items() if abs(np.log(ratio / factor)) < np.log(UNIT_RATIO[unit])]
    guess = f"in {near[0]}" if near else "in another unit, such as counts or percent, or another gain was played"
    column = f'"{name} [{near[0]}]"' if near else f'"{name} * {1 / ratio:.3g} [{unit}]"'
    text = f"'{name}' has not the amplitude that was predicted with the excitation, as if its column were {guess}"
    remedy = f"if so, state it, such as record.channels.{name} = {column}"
    return Finding(WRONG, (Quantity(ratio, "1", "amplitude over the predicted one"),), text=text, remedy=remedy)


def _median_ratio(
    segments: Sequence[Segment], expected: Sequence[Mapping[str, float]], channel: str, predicted: str
) -> float:
    """Return the amplitude of a channel over that which was predicted of one, in the median of the segments; or 0."""
    both = [(segment, of[predicted]) for segment, of in zip(segments, expected, strict=True) if of.get(predicted)]
    return float(np.median([line_amplitude(segment, channel) / amplitude for segment, amplitude in both] or [0.0]))


def _is_trusted(ratio: float, unit: str) -> bool:
    low, high = TRUSTED[unit]
    return low <= ratio <= high


class Plausible(NamedTuple):
    """Bounds of a quantity beyond which its unit is questioned."""

    least: float
    most: float


SPANS = {
    "m": Plausible(1e-12, 20.0),
    "m/s": Plausible(0.0, 100.0),
    "m/s**2": Plausible(0.0, 1e5),
    "N": Plausible(0.0, 1e7),
    "N m": Plausible(0.0, 1e7),
}
"""Peak to peak values of channels by unit."""
INERTIAS = {
    ("N", "m"): ("mass", "kg", Plausible(1e-9, 2e4)),
    ("N m", "rad"): ("inertia", "kg m²", Plausible(1e-12, 1e5)),
}
"""Apparent inertia |U/(ω² Y)| by the units of input and output."""


def implausible_units(segments: Sequence[Segment], units: Mapping[str, str]) -> Iterator[Finding]:
    """Yield channels whose span, or whose ratio to another, no machine has: their units or gains are wrong."""
    least, most = SAMPLE_TIMES
    if not least < (step := segments[0].sample_time) < most and not segments[0].stated:
        yield Finding("implausible unit", (Quantity(step, "s", "sample time"),), place="time")
    for name, unit in units.items():
        span = max(float(np.ptp(segment.channels[name])) for segment in segments)
        if unit in SPANS and span and not SPANS[unit].least <= span <= SPANS[unit].most:
            yield Finding("implausible unit", (Quantity(span, unit, "span"),), place=f"'{name}'")
    for one, other in product(units, units):
        if (units[one], units[other]) in INERTIAS and all(segment.periodic for segment in segments):
            what, unit, plausible = INERTIAS[units[one], units[other]]
            found = _apparent_inertias(segments, one, other)
            if found.size and (found.min() > plausible.most or found.max() < plausible.least):
                value = float(found.min() if found.min() > plausible.most else found.max())
                inertia = Quantity(value, unit, f"apparent {what}")
                yield Finding("implausible unit", (inertia,), place=f"'{one}' over '{other}'")


def _apparent_inertias(segments: Sequence[Segment], force: str, position: str) -> NDArray[np.float64]:
    """Return |U/(ω² Y)| at all lines at which the position moves, shape (n,)."""
    parts = []
    for segment in segments:
        u, y = (np.abs(phasors(segment, name).mean(axis=0)) for name in (force, position))
        moves = (y > 0) & (u > 0)
        parts.append(u[moves] / (y * (2 * np.pi * segment.frequency) ** 2)[moves])
    return np.concatenate(parts)


COMMANDS = ("u", *INJECTED_CHANNELS)
"""Channels that are not looked at: commands jump and are limited, and then are what the machine gets."""
MOTION_UNITS = ("m", "m/s", "m/s**2", "rad", "rad/s", "rad/s**2")
"""Units of what moves smoothly."""
POSITION_UNITS = ("m", "rad", "1")
"""Units of what wraps: positions of encoders, and numbers."""


class _WrongSamples(NamedTuple):
    """What is wrong with samples of a channel."""

    finding: Finding
    deviation: float = np.inf
    """Sum of what the samples differ from their neighbours [unit]; infinite where more than single ones are wrong."""


def find_wrong_samples(segments: Sequence[Segment], units: dict[str, str]) -> tuple[Finding, ...]:
    """Return what is wrong with samples of channels, and by how much that changes a response at most.

    Of each channel the first finding counts, as one fault has several signs, and of all segments the first with its
    kind. Of a record that does not repeat, only spikes and wraps can be seen.
    """
    asked = [(segment, name, _wrong_samples(segment, name, units[name])) for segment in segments for name in units]
    first: dict[tuple[str, str], Finding] = {}
    for segment, name, wrong in asked:
        if wrong is not None:
            earlier = first.setdefault((name, wrong.finding.kind), wrong.finding)
            error = max(_influence(segment, name, wrong), earlier.error)
            first[name, wrong.finding.kind] = replace(earlier, error=error)
    return tuple(first.values())


def _influence(segment: Segment, name: str, wrong: _WrongSamples) -> float:
    """Return by how much the samples change the usual phasor of a channel at its lines, relative to it, 1 at most."""
    usual = float(np.median(np.abs(phasors(segment, name).mean(axis=0))))
    return min(2 * wrong.deviation / segment.channels[name].size / usual, 1.0) if usual else 1.0


def _wrong_samples(segment: Segment, name: str, unit: str) -> _WrongSamples | None:
    periods = segment.channels[name]
    if name in COMMANDS or not np.ptp(periods):
        return None
    motion = _Motion(periods, unit)
    found = motion.wraps() if unit in POSITION_UNITS else None
    if found is None and unit in MOTION_UNITS:
        found = motion.holds() or (motion.stops() if segment.periodic else None) or motion.spikes()
    return found and found._replace(finding=replace(found.finding, place=f"'{name}', {found.finding.place}"))


MIN_SPIKE, SPIKE_FACTOR, USUAL_SHARE = 0.1, 10.0, 0.95
"""Least leap in widths of the channel's usual range, and relative to what this share of the steps leap at most."""
MIN_SPIKE_STEPS = 2.5
"""The same in steps of a coarse encoder."""
MAX_SPIKE_SHARE = 0.01
"""Share of samples up to which they are wrong: more are a signal that is as fast as the samples, or two levels."""
MIN_CHANGES = 10
"""Changes of a position within a period, in most intervals of equal length, from which these are no chance."""
MIN_RUN_SAMPLES, MIN_LOST_SAMPLES = 3, 20
"""Equal samples in a row from which they are more than the top of a wave, and from which the signal may be lost."""
MIN_LOST_SHARE = 0.01
"""Share of a period of such a run."""
MIN_RUNS, MIN_CLIPPED_SHARE = 3, 0.002
"""Runs at the ends of the range, and share of samples in them, from which a channel is clipped: fewer change little."""
MAX_CLIPPED_SHARE = 0.7
"""Share of samples at both ends above which these are the two levels of a square wave."""
MIN_VALUES = 50
"""Different values from which a channel is no coarse one."""
MIN_ENTRY_STEP, MIN_ENTRY_BENDS, USUAL_BEND = 0.35, 3.0, 0.99
"""Step before and after a run, relative to the rms of all steps, or to the change from one step to the next that is not
exceeded by this share of the others: machines that reverse or stick slow down or start slowly."""
MIN_ENTRY_COUNTS = 3.0
"""The same step, in steps of the encoder or of rounded numbers; short runs take more, as `_rounded_top_steps` says."""
MAX_STICKING = 0.2
"""Samples in runs elsewhere, relative to those at the ends, above which the machine sticks."""
WRAP_SHARE, MAX_STEP_SHARE = 0.8, 0.2
"""Part of a channel's whole range by which it jumps from one sample to the next where it wraps, and by which it moves
between the samples beside at most: faster signals have such jumps themselves."""
MIN_WRAPS, MIN_ONWARD_SHARE = 3, 0.8
"""Jumps, and the share of them that a motion in the opposite direction surrounds, from which they are wraps."""
TURN_TOLERANCE = 0.01
"""Relative difference of a jump from a whole turn up to which a single one is a wrap."""


class _Motion:
    """A channel of a segment, shape (periods, samples)."""

    def __init__(self, periods: NDArray[np.float64], unit: str) -> None:
        self._channel, self._samples, self._unit = periods.ravel(), periods.shape[1], unit
        self._steps = np.diff(self._channel)

    def _finding(self, kind: str, sample: int, *quantities: Quantity) -> Finding:
        period, within = divmod(sample, self._samples)
        return Finding(kind, quantities, place=f"sample {within + 1} of period {period + 1}")

    def spikes(self) -> _WrongSamples | None:
        """Return single samples, or a few in a row, to which the motion leaps and from which it comes back."""
        around = sliding_window_view(np.pad(self._steps, 2, mode="symmetric"), 5)
        leap = self._steps - np.median(around, axis=1)  # no step of a smooth motion differs much from those beside
        low, high = np.quantile(self._channel, (1 - USUAL_SHARE, USUAL_SHARE))
        least = max(MIN_SPIKE * (high - low), MIN_SPIKE_STEPS * smallest_step(self._channel))
        limit = max(least, SPIKE_FACTOR * float(np.quantile(np.abs(leap), USUAL_SHARE)))
        most = max(int(MAX_SPIKE_SHARE * self._channel.size), 1)
        places = np.flatnonzero(np.abs(leap) > limit)
        found = list(self._excursions(places, leap, most)) if places.size <= 2 * most else []
        count = sum(stop - start for start, stop, _ in found)
        if not 0 < count <= most:
            return None
        worst = max(found, key=lambda each: each[2])
        quantities = (
            Quantity(float(self._channel[worst[0]]), self._unit, "value"),
            Quantity(worst[2], self._unit, "leap"),
            Quantity(float(count), "1", "number of such samples"),
        )
        return _WrongSamples(
            self._finding("spikes", worst[0], *quantities), sum((stop - start) * size for start, stop, size in found)
        )

    def holds(self) -> _WrongSamples | None:
        """Return that a position changes at every second sample only, or more rarely: it is refreshed that slowly."""
        changes = np.flatnonzero(self._steps[: self._samples])
        every = int(np.gcd.reduce(np.diff(changes))) if changes.size >= MIN_CHANGES else 1
        if every == 1 or 2 * every * changes.size < self._samples:
            return None
        if np.median(np.abs(self._steps[changes])) < MIN_SPIKE_STEPS * smallest_step(self._channel):
            return None  # it moves evenly, by single steps of the encoder
        held = Quantity(float(every), "1", "number of equal samples")
        return _WrongSamples(self._finding("held samples", int(changes[0]), held))

    def _excursions(
        self, places: NDArray[np.int64], leap: NDArray[np.float64], most: int
    ) -> Iterator[tuple[int, int, float]]:
        """Yield first sample, the one after the last, and size of what lies between two opposite leaps, or an end."""
        size, number = self._channel.size, 0
        while number < places.size:
            place, height = int(places[number]), float(abs(leap[places[number]]))
            onward = int(places[number + 1]) if number + 1 < places.size else size - 1
            if onward - place <= most and (onward == size - 1 or leap[place] * leap[onward] < 0):
                yield place + 1, onward + 1, height
                number += 1
            elif number == 0 and place < most:
                yield 0, place + 1, height
            number += 1

    def stops(self) -> _WrongSamples | None:
        """Return where a motion stops within a sample: at the ends of its range it is clipped, elsewhere lost."""
        ends = np.append(np.flatnonzero(self._steps) + 1, self._channel.size)
        lengths = np.diff(ends, prepend=0)
        starts = ends - lengths
        inner = (lengths >= MIN_RUN_SAMPLES) & (starts >= 2) & (ends + 2 <= self._channel.size)
        starts, ends, lengths = starts[inner], ends[inner], lengths[inner]
        if not lengths.size or np.unique(self._channel).size < MIN_VALUES:
            return None
        entries = np.abs(self._channel[starts - 1] - self._channel[starts - 2])
        exits = np.abs(self._channel[ends + 1] - self._channel[ends])
        fast = self._fast_steps(lengths)
        value = self._channel[starts]
        is_clipped = np.zeros(starts.size, dtype=bool)
        for limit in (self._channel.min(), self._channel.max()):
            at = value == limit
            is_many = at.sum() >= MIN_RUNS and lengths[at].sum() >= MIN_CLIPPED_SHARE * self._channel.size
            if is_many and np.median((np.minimum(entries, exits) / fast)[at]) > 1:
                is_clipped |= at
        clipped, elsewhere = lengths[is_clipped].sum(), lengths[~np.isin(value, self._limits)].sum()
        if clipped and elsewhere <= MAX_STICKING * clipped and clipped <= MAX_CLIPPED_SHARE * self._channel.size:
            values = (Quantity(of, self._unit, "end of its range") for of in np.unique(value[is_clipped]).tolist())
            return _WrongSamples(self._finding("clipped", int(starts[is_clipped][0]), *values))
        is_lost = (lengths >= max(MIN_LOST_SAMPLES, MIN_LOST_SHARE * self._samples)) & (
            np.maximum(entries, exits) > fast
        )
        if (
            not is_lost.any() or 2 * is_lost.sum() >= self._channel.size / self._samples
        ):  # machines stick in each period
            return None
        longest = int(np.argmax(np.where(is_lost, lengths, 0)))
        found = (
            Quantity(float(value[longest]), self._unit, "value"),
            Quantity(float(lengths[longest]), "1", "number of equal samples"),
        )
        return _WrongSamples(self._finding("lost signal", int(starts[longest]), *found))

    @property
    def _limits(self) -> tuple[float, float]:
        return float(self._channel.min()), float(self._channel.max())

    def _fast_steps(self, lengths: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the step beside each run of equal samples from which the motion did not slow down, shape (n,)."""
        near = np.convolve(np.isin(self._channel, self._limits), np.ones(5), "same")[1:-1] > 0
        bends = np.abs(np.diff(self._steps))[~near]
        bend = float(np.quantile(bends, USUAL_BEND)) if bends.size else np.inf
        usual = float(np.sqrt(np.mean(self._steps**2)))
        counts = np.maximum(MIN_ENTRY_COUNTS, _rounded_top_steps(lengths))
        return np.maximum(min(MIN_ENTRY_STEP * usual, MIN_ENTRY_BENDS * bend), counts * smallest_step(self._channel))

    def wraps(self) -> _WrongSamples | None:
        """Return where a position jumps by nearly its range, against the direction in which it moves beside."""
        span = float(np.ptp(self._channel))
        jumps = np.flatnonzero(np.abs(self._steps[1:-1]) > WRAP_SHARE * span) + 1
        before, jump, after = self._steps[jumps - 1], self._steps[jumps], self._steps[jumps + 1]
        alone = np.maximum(np.abs(before), np.abs(after)) < MAX_STEP_SHARE * span
        onward = alone & (before * jump < 0) & (after * jump < 0)
        turns = np.abs(jump - (before + after) / 2)[onward] / (2 * np.pi)
        least = 1 if self._unit == "rad" and np.all(np.abs(turns - 1) < TURN_TOLERANCE) else MIN_WRAPS
        if onward.sum() < max(least, MIN_ONWARD_SHARE * alone.sum()):
            return None
        found = Quantity(span, self._unit, "range"), Quantity(float(jumps.size), "1", "number of jumps")
        return _WrongSamples(self._finding("wraps", int(jumps[np.argmax(onward)]), *found))


def _rounded_top_steps(samples: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the greatest step [steps of rounding] just before or after runs that rounding makes of a smooth top.

    n samples that are rounded alike fall by one step at most from the middle to the ends, (n - 1)/2 samples away. The
    flattest top of a wave with its third harmonic falls as the fourth power does: by at most ((n + 3)⁴ - (n + 1)⁴) /
    (n - 1)⁴ steps between the two samples that follow, which are rounded as well. Rounder tops fall by less.
    """
    return ((samples + 3.0) ** 4 - (samples + 1.0) ** 4) / (samples - 1.0) ** 4 + 1
