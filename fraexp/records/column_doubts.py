"""Doubts about the columns of a record whose excitation is known: what they are instead, and the remedy."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import line_amplitude, phasors
from fraexp.data.findings import Finding, Quantity
from fraexp.data.signals import Segment
from fraexp.records.cutting import Cut
from fraexp.records.loop_equation import FaultKind, LoopController, LoopFault, judge_columns

WRONG = "wrong column"
"""Kind of all findings of this module."""
TRUSTED = {"N": (1 / 1.4, 1.4), "m": (1 / 300, 10.0)}
TRUSTED |= {"N m": TRUSTED["N"], "rad": TRUSTED["m"]}
"""Amplitude over the predicted one, in the median of all segments, within which a channel of a unit is not in doubt.

Most of the control input is the excitation. How far a machine moves depends on what the measurement is to show: by
friction it may move much less. Simulated with half and twice the gain, and with friction from none to what nearly
holds the axis, control inputs had ratios of 0.9 to 1.15, and positions of 0.005 to 4.
"""
FACTORS = {"N": {1e-3: "kN", 1e3: "mN"}, "m": {1e3: "mm", 1e6: "um", 100.0: "cm", 1e9: "nm"}}
FACTORS |= {"N m": {1e-3: "kN m", 1e3: "mN m"}, "rad": {1e3: "mrad", 180 / np.pi: "deg"}}
"""Units by the ratio that they make of one that was meant to be SI."""
UNIT_RATIO = {"N": 1.4, "m": 3.0, "N m": 1.4, "rad": 1.7}
"""Ratio to such a factor, either way, up to which the unit is named."""


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


EXACT_RATIO = 1.05
"""Ratio to a unit, either way, up to which it is named: what the controller answers shows it exactly."""
LIKELY_GAINS = (0.5, 2.0)
"""Factors on the position that are more likely another gain of the controller."""
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
    than amplitudes that were predicted, which count where it says nothing. A record with its excitation and without a
    loop to compare it with is not verified, whatever the amplitudes: they cannot take the place of the comparison.
    """
    predicted = [cut.expected for cut in cuts]
    if controller is None or (units.get("u"), units.get("y")) not in LOOP_UNITS:
        unverified = (Finding("not verified", place="'u' and 'y'"),) if any(cut.excitation for cut in cuts) else ()
        return prediction_doubts(segments, predicted, units) + unverified
    known = LoopController(*(np.array(part) for part in controller))
    verdict = judge_columns(segments, [cut.excitation for cut in cuts], known)
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


def fault_finding(fault: LoopFault, units: Mapping[str, str]) -> Finding:
    """Return what was found in the columns of a record, and the remedy."""
    if fault.kind in FACTORED:
        name, right = FACTORED[fault.kind]
        unit = _unit(fault, units)
        text = f"'{name}' is {fault.factor:,.4g} times {right}{f', as if its column were in {unit}' if unit else ''}"
        text = f"'{name}' has the opposite sign of {right}" if _is_opposite(fault) else text
    elif fault.samples:
        size, time = abs(fault.samples), "late" if fault.samples > 0 else "early"
        text = f"{DELAYED[fault.kind]} {size:,} sample{'' if size == 1 else 's'} {time}"
    else:
        text = TEXTS[fault.kind][0].format(factor=fault.factor, unit=units["u"])
    return Finding(WRONG, text=text, remedy=_remedy(fault, units))


def _remedy(fault: LoopFault, units: Mapping[str, str]) -> str:
    if fault.kind in FACTORED:
        name, _ = FACTORED[fault.kind]
        unit = _unit(fault, units)
        column = f"{name} [{unit}]" if unit else f"{name} * {1 / fault.factor:.4g} [{units[name]}]"
        stated = f'state record.channels.{name} = "{column}"'
        if name == "y" and not _is_opposite(fault):  # a controller of another gain answers as much
            gain = f"correct record.controller if its gain is {1 / fault.factor:.4g} times as great"
            is_likely = LIKELY_GAINS[0] <= fault.factor <= LIKELY_GAINS[1]
            return f"{gain}; if 'y' is wrong, {stated}" if is_likely else f"{stated}, or {gain}"
        return stated
    if fault.kind is FaultKind.BEGUN_LATE:
        change = "lower" if fault.samples > 0 else "raise"
        return f"begin it with the excitation, or {change} start and rest of record.segments by {abs(fault.samples)}"
    if fault.samples:
        delay = ", or state a delay of the controller in record.controller"
        is_slow = fault.kind is FaultKind.OUTPUT_SHIFT and fault.samples < 0
        return f"record 'y' as the controller reads it, and 'u' of the same cycle{delay if is_slow else ''}"
    return TEXTS[fault.kind][1]


def _is_opposite(fault: LoopFault) -> bool:
    return fault.factor < 0 and abs(np.log(-fault.factor)) < np.log(EXACT_RATIO)


def _unit(fault: LoopFault, units: Mapping[str, str]) -> str:
    """Return the unit that explains a factor; empty if none does."""
    known = FACTORS[units[FACTORED[fault.kind][0]]].items()
    near = (of for factor, of in known if fault.factor > 0 and abs(np.log(fault.factor / factor)) < np.log(EXACT_RATIO))
    return next(near, "")


FACTORED = {
    FaultKind.INPUT_FACTOR: ("u", "the excitation minus what the controller makes of 'y'"),
    FaultKind.OUTPUT_FACTOR: ("y", "the position that the controller answers in 'u'"),
}
"""Channels that may be in another unit, and what they are to be."""
DELAYED = {
    FaultKind.INPUT_SHIFT: "'u' is recorded",
    FaultKind.OUTPUT_SHIFT: "beside the controller's answer in 'u', 'y' is recorded",
    FaultKind.BEGUN_LATE: "the record begins",
}
"""What may be late."""
TEXTS = {
    FaultKind.ALONE: (
        "'u' is the excitation alone, without what the controller makes of 'y'",
        "record the controller's whole output; if the machine has no feedback, state that with record.controller = "
        '{name = "transfer_function", numerator = [0], denominator = [1]}',
    ),
    FaultKind.FEEDBACK: (
        "'u' is what the controller makes of 'y', without the excitation",
        "record the sum of both",
    ),
    FaultKind.EXCITATION_FACTOR: (
        "'u' has {factor:,.4g} times the excitation that was written",
        "correct gain and sign of the output that plays it, or leave excitation out of record.segments if it is meant",
    ),
    FaultKind.SWAPPED: (
        "'u' and 'y' are swapped, as 'y' is the excitation minus what the controller makes of 'u'",
        "exchange their columns in record.channels",
    ),
    FaultKind.COMPENSATION: (
        "'u' has {factor:.3g} {unit} in the direction of motion beside the excitation minus what the controller makes "
        "of 'y', as by a friction compensation of the machine",
        "switch it off while the machine is measured",
    ),
    FaultKind.UNKNOWN: (
        "'u' is not the excitation minus what the controller makes of 'y', and no factor or delay explains it",
        "state the machine's own numbers in record.controller; if they are right, correct column, sign and unit of 'u' "
        "and 'y' in record.channels, sample_rate, or the start of record.segments",
    ),
}
"""What else was found, and the remedy."""


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
