"""Asymptotes of a plant: constant stiffness at low frequencies, and constant mass above."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import FrequencyResponse
from fraexp.figures.elements.scales import PLANT_UNITS

MAX_SPRING_PHASE = np.pi / 4
"""Phase [rad] up to which a response is that of a spring."""
MAX_STIFFNESS_RATIO = 1.5
"""Largest over smallest stiffness of the points that count as one."""
MIN_SPRING_POINTS = 3
"""Number of neighbouring points that show a stiffness."""
MASS_UNITS = {"m/N": "kg", "rad/(N m)": "kg m²"}
STIFFNESS_UNITS = {"m/N": (1e-6, "N/µm"), "rad/(N m)": (1.0, "N m/rad")}
"""Factor from SI, and unit, of a stiffness by the unit of a response."""


class Spring(NamedTuple):
    """The line of a constant stiffness."""

    frequency: NDArray[np.float64]
    """Ends of the line [Hz], shape (2,): the lowest point, and where it meets the line of the mass."""
    magnitude: float
    """1/K [unit of the response]."""


def spring_line(source: FrequencyResponse, rigid_body_gain: float) -> Spring | None:
    """Return the stiffness K that a response shows at its lowest frequencies; None if it shows none there.

    K = Re(1/G) + ω²/k0 with the rigid-body gain k0 is that of the spring beside the mass. At small amplitudes it is
    that of friction in presliding; a plant without friction moves freely, and has none.
    """
    order = np.argsort(source.frequency, kind="stable")
    order = order[(source.settled & np.isfinite(source.response) & (source.response != 0))[order]]
    if source.unit not in PLANT_UNITS or order.size < MIN_SPRING_POINTS or not rigid_body_gain > 0:
        return None
    frequency, inverse = source.frequency[order], 1 / source.response[order]
    stiffness = inverse.real + (2 * np.pi * frequency) ** 2 / rigid_body_gain
    is_spring = np.abs(np.angle(inverse)) < MAX_SPRING_PHASE
    with np.errstate(invalid="ignore"):
        ratio = np.maximum.accumulate(stiffness) / np.minimum.accumulate(stiffness)
    is_spring &= (stiffness > 0) & (ratio < MAX_STIFFNESS_RATIO)
    count = int(np.argmin(is_spring)) if not is_spring.all() else is_spring.size
    if count < MIN_SPRING_POINTS:
        return None
    value = float(np.median(stiffness[:count]))
    corner = np.sqrt(value * rigid_body_gain) / (2 * np.pi)
    return Spring(np.array([frequency[0], max(corner, frequency[count - 1])]), 1 / value)


def mass_text(gains: Sequence[float], unit: str) -> str:
    """Return the legend of the line of the apparent mass, with its value or range if the unit tells it."""
    if unit not in MASS_UNITS:
        return "rigid body (apparent mass)"
    name = "inertia" if unit.startswith("rad") else "mass"
    return f"rigid body (apparent {name} {_range_text([1 / gain for gain in gains], 4)} {MASS_UNITS[unit]})"


def stiffness_text(springs: Sequence[Spring], unit: str) -> str:
    """Return the legend of the line of the stiffness, with its value or range."""
    factor, shown = STIFFNESS_UNITS[unit]
    return f"stiffness {_range_text([factor / spring.magnitude for spring in springs], 3)} {shown}"


def _range_text(values: Sequence[float], digits: int) -> str:
    low, high = (_plain_number(value, digits) for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _plain_number(value: float, digits: int) -> str:
    """Return a number with so many digits, without an exponent while it is short."""
    return f"{float(f'{value:.{digits}g}'):.{max(digits, 6)}g}"
