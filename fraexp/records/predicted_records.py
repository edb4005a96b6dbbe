"""Doubts about the channels of a record whose excitation is known: columns that are swapped, or in another unit."""

from collections.abc import Mapping, Sequence

import numpy as np

from fraexp.analysis.fourier import line_amplitude
from fraexp.data.signals import Segment

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


def prediction_doubt(
    segments: Sequence[Segment], expected: Sequence[Mapping[str, float]], units: Mapping[str, str]
) -> str:
    """Return what contradicts the prediction with which the excitation was written, in a line; empty if nothing does.

    `expected` has the amplitude of channels at the excited lines of each segment; none where nothing was predicted.
    """
    predicted = {name for of in expected for name in of if units.get(name) in TRUSTED}
    ratios = {name: _median_ratio(segments, expected, name, name) for name in sorted(predicted)}
    doubts = [name for name, ratio in ratios.items() if ratio and not _is_trusted(ratio, units[name])]
    if not doubts:
        return ""
    if len(predicted) == 2:
        first, second = sorted(predicted)
        crossed = [_median_ratio(segments, expected, *pair) for pair in ((first, second), (second, first))]
        if all(_is_trusted(ratio, units[name]) for ratio, name in zip(crossed, (second, first), strict=True)):
            return (
                f"'{first}' and '{second}' have the amplitudes that were predicted of each other when the excitation "
                "was written: their columns are swapped? exchange them in record.channels"
            )
    return "; ".join(_question(name, ratios[name], units[name]) for name in doubts)


def _question(name: str, ratio: float, unit: str) -> str:
    near = [other for factor, other in FACTORS[unit].items() if abs(np.log(ratio / factor)) < np.log(UNIT_RATIO[unit])]
    guess = f"in {near[0]}" if near else "in another unit, such as counts or percent, or was another gain played"
    remedy = f'"{name} [{near[0]}]"' if near else f'"{name} * {1 / ratio:.3g} [{unit}]"'
    return (
        f"'{name}' has {ratio:,.4g} times the amplitude that was predicted when the excitation was written: is its "
        f"column {guess}? if so, state it, such as record.channels.{name} = {remedy}"
    )


def _median_ratio(
    segments: Sequence[Segment], expected: Sequence[Mapping[str, float]], channel: str, predicted: str
) -> float:
    """Return the amplitude of a channel over that which was predicted of one, in the median of the segments; or 0."""
    both = [(segment, of[predicted]) for segment, of in zip(segments, expected, strict=True) if of.get(predicted)]
    return float(np.median([line_amplitude(segment, channel) / amplitude for segment, amplitude in both] or [0.0]))


def _is_trusted(ratio: float, unit: str) -> bool:
    low, high = TRUSTED[unit]
    return low <= ratio <= high
