"""The scales of a Bode plot: decibels in a readable unit, and phases on a common branch."""

from collections.abc import Iterable
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fraexp.data.units import with_powers

ANCHOR_WEIGHT = 0.2
"""Weight of the distance to the anchor: it decides steps of about 180° (above 144°), and no smaller ones."""


def readable_unit(unit: str) -> tuple[float, str]:
    """Return the factor to the unit in which a response is shown, and that unit (``m/N`` → 1000, ``mm/N``)."""
    return (1000.0, f"m{unit}") if unit == "m" or unit.startswith(("m/", "rad/(")) else (1.0, unit)


def displacement_unit(greatest: float, unit: str = "m") -> tuple[float, str]:
    """Return the factor from m, or rad, to the unit in which displacements up to the greatest one are shown, and it."""
    prefixes = ((0.9995e-3, 1e3, "m"), (0.9995e-6, 1e6, "µ"), (1e-300, 1e9, "n"))  # 0.9995 would be rounded to 1
    factor, prefix = next(((factor, prefix) for least, factor, prefix in prefixes if greatest >= least), (1e3, "m"))
    return factor, f"{prefix}{unit}"


DISPLACEMENT_UNITS = ("m", "rad")
"""Units of displacements: of straight and of rotary axes."""


def column_unit(values: Iterable[object], unit: str) -> tuple[float, str]:
    """Return the factor to the unit in which a column of numbers is read, and it: displacements in mm, µm or nm."""
    sizes = [abs(value) for value in values if isinstance(value, int | float) and isfinite(value)]
    if unit in DISPLACEMENT_UNITS and 0 < max(sizes, default=0.0) < 1:
        return displacement_unit(max(sizes), unit)
    return 1.0, with_powers(unit)


PLANT_UNITS = ("m/N", "rad/(N m)")
"""Units of a plant's response: of straight and of rotary axes."""
FORCE_NAMES = {"N": "force", "N m": "torque"}
"""What a force is called by its unit."""


def decibel(response: NDArray[np.inexact]) -> NDArray[np.float64]:
    """Return the magnitude [dB] of a complex response, shape (n,); NaN where it is zero or not finite."""
    magnitude = np.abs(response)
    usable = np.isfinite(magnitude) & (magnitude > 0)
    levels: NDArray[np.float64] = 20 * np.log10(magnitude, where=usable, out=np.full(magnitude.shape, np.nan))
    return levels


def decibel_limits(limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return relative limits of a magnitude in dB: -inf for 0 or less, inf without a limit, NaN if unknown."""
    with np.errstate(divide="ignore"):
        levels: NDArray[np.float64] = 20 * np.log10(np.where(limits < 0, 0.0, limits))
    return levels


def degree_limits(limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return limits [rad] relative to a phase in degrees: infinite from half a turn on, which leaves every phase."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(limits) >= np.pi, np.copysign(np.inf, limits), np.degrees(limits))


def degrees(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the phase [deg] of a complex response, shape (n,), within ±180°; NaN where it is not finite."""
    finite = np.isfinite(response)
    return np.where(finite, np.degrees(np.angle(np.where(finite, response, 1.0))), np.nan)


def continuous_phase(
    phase: NDArray[np.float64], trusted: NDArray[np.bool_], anchor: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return phases [deg] without jumps by 360°, shape (n,) or (m, n): each row on the branch nearest to `anchor`.

    Only `trusted` points continue the branch; the others follow it. Without an anchor [deg], of the shape of the
    phase, the branch is the one whose median lies above -270° and up to 90°.
    """
    rows = np.atleast_2d(phase)
    known = np.atleast_2d(trusted) & np.isfinite(rows)
    if anchor is None:
        chained = _chain_phases(rows, known, None, np.zeros(len(rows)))
        middle = [np.median(row[seen]) if seen.any() else 0.0 for row, seen in zip(chained, known, strict=True)]
        return (chained - 360 * np.ceil((np.array(middle) - 90) / 360)[:, None]).reshape(phase.shape)
    target = np.atleast_2d(anchor)
    candidates = np.stack([_chain_phases(rows, known, target, target[:, 0] + turn) for turn in (-360, 0, 360)])
    distances = np.where(known, np.abs(candidates - target), 0).sum(axis=2)
    nearest: NDArray[np.float64] = candidates[np.argmin(distances, axis=0), np.arange(len(rows))]
    return nearest.reshape(phase.shape)


def _chain_phases(
    phase: NDArray[np.float64], known: NDArray[np.bool_], anchor: NDArray[np.float64] | None, start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return phases of shape (m, n), each within half a turn of the one before, from `start`, shape (m,), on."""
    chained, previous = np.full(phase.shape, np.nan), start
    for column in range(phase.shape[1]):
        here = phase[:, column]
        turns = here + 360 * (np.round((previous - here) / 360) + np.arange(-1, 2)[:, None])
        cost = np.abs(turns - previous)
        if anchor is not None:
            cost = cost + ANCHOR_WEIGHT * np.abs(turns - anchor[:, column])
        chained[:, column] = turns[np.argmin(cost, axis=0), np.arange(len(here))]
        previous = np.where(known[:, column], chained[:, column], previous)
    return chained
