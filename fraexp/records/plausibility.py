"""Questions about the units of a record: motions and masses that no machine has."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import phasors
from fraexp.data.signals import Segment


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


def unit_questions(segments: Sequence[Segment], units: Mapping[str, str]) -> str:
    """Return questions about the units of channels, in one line; empty if all values are plausible."""
    return "; ".join([*_span_questions(segments, units), *_inertia_questions(segments, units)])


def _span_questions(segments: Sequence[Segment], units: Mapping[str, str]) -> Iterator[str]:
    for name, unit in units.items():
        span = max(float(np.ptp(segment.channels[name])) for segment in segments)
        if unit in SPANS and span and not SPANS[unit].least <= span <= SPANS[unit].most:
            yield f"'{name}' spans {span:.3g} {unit}: are its unit and gain right?"


def _inertia_questions(segments: Sequence[Segment], units: Mapping[str, str]) -> Iterator[str]:
    for one, other in product(units, units):
        if (units[one], units[other]) in INERTIAS and all(segment.periodic for segment in segments):
            what, unit, plausible = INERTIAS[units[one], units[other]]
            found = _apparent_inertias(segments, one, other)
            if not found.size:
                continue
            low, high = float(found.min()), float(found.max())
            if low > plausible.most or high < plausible.least:
                value = low if low > plausible.most else high
                yield (
                    f"'{one}' over '{other}' is an apparent {what} of {value:.3g} {unit} or "
                    f"{'more' if value == low else 'less'}: are their units and gains right?"
                )


def _apparent_inertias(segments: Sequence[Segment], force: str, position: str) -> NDArray[np.float64]:
    """Return |U/(ω² Y)| at all lines at which the position moves, shape (n,)."""
    parts = []
    for segment in segments:
        u, y = (np.abs(phasors(segment, name).mean(axis=0)) for name in (force, position))
        moves = (y > 0) & (u > 0)
        parts.append(u[moves] / (y * (2 * np.pi * segment.frequency) ** 2)[moves])
    return np.concatenate(parts)
