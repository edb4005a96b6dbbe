"""Which modes of a fit the data do not carry, and why."""

from collections.abc import Iterator

import numpy as np

from fraexp_plugins.identification.modal_solver import CLEAR, Solution

WIDE = 1.959964
"""Standard deviations of a 95 % interval."""
PEAKLESS = np.sqrt(0.5)
"""Damping ratio from which a mode has no resonance peak: such a one follows what friction leaves."""
SIGNIFICANT = 3.0
"""Standard deviations that a residue must be from 0 when points are left out."""


def doubts(solution: Solution) -> tuple[str, ...]:
    """Return a reason for each mode that the data do not carry, and for the rigid body; empty if they carry all.

    A residue must stand against leaving out points as well: else scatter at a few points makes a mode.
    """
    if any(name == "gain" or "." not in name for name in solution.untold):
        return (f"any telling of {', '.join(solution.untold)}",)
    return (*_rigid_body(solution), *_modes(solution))


def _rigid_body(solution: Solution) -> Iterator[str]:
    deviation = np.sqrt(solution.covariance[0, 0])
    if deviation * CLEAR > 1:
        gain = np.exp(solution.p[0])
        yield f"a rigid body (k0 = {gain:.2g} ± {WIDE * gain * deviation:.1g} may be 0)"


def _modes(solution: Solution) -> Iterator[str]:
    model, axes = solution.model, np.eye(solution.p.size)
    for number, (frequency, zeta) in enumerate(model.poles(solution.p)):
        place = 1 + 3 * number
        residue = solution.p[place + 2]
        half = WIDE * zeta * np.sqrt(solution.covariance[place + 1, place + 1])
        scatter = _scatter(solution, axes[place + 2] + residue * axes[0])
        if not model.lowest <= frequency <= model.highest:
            why = f"outside of the band, {model.lowest:.4g} to {model.highest:.4g} Hz"
        elif f"residues.{number}" in solution.untold or abs(residue) < SIGNIFICANT * scatter:
            why = f"its residue {residue:.2g} ± {WIDE * scatter:.1g} may be noise"
        elif zeta <= half:
            why = f"its damping ζ = {zeta:.2g} ± {half:.1g} cannot be told from 0"
        elif zeta + half >= PEAKLESS:
            why = f"damped so much, ζ = {zeta:.2g} ± {half:.1g}, that it may have no peak"
        else:
            continue
        yield f"a mode at {frequency:.4g} Hz ({why})"


def _scatter(solution: Solution, slope: np.ndarray) -> float:
    """Return the standard deviation of k0 r over k0, of which the slope by p is given."""
    return float(np.sqrt(max(slope @ solution.covariance @ slope, slope @ solution.jackknife @ slope)))
