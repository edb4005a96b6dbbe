"""The parts of a plant fit that the data do not support, and why."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.plant._shared.modal_solver import MIN_GAIN_STDS, Solution

NORMAL_QUANTILE = 1.959964
"""Half width of a 95 % interval in standard deviations."""
MAX_PEAK_DAMPING = np.sqrt(0.5)
"""Damping ratio from which a mode has no resonance peak: such a mode follows the remains of friction."""
MAX_OUTSIDE_FREQUENCY_ERROR = 0.05
"""Relative half width of the 95 % interval of a natural frequency up to which it may lie outside of the range."""
MIN_RATIO_STDS = 3.0
"""Standard deviations from 0 that a modal gain ratio needs when points are left out."""


def unsupported_parts(solution: Solution) -> tuple[str, ...]:
    """Return rigid body and modes that the data do not support, each with the reason; empty if they support all.

    A modal gain ratio must be significant with points left out too; otherwise scatter at a few points makes a mode.
    A mode outside of the frequency range is supported if its natural frequency is known to 5 %, with points left out
    too, as that of a mode whose antiresonance lies within the range is.
    """
    if any(name == "rigid_body_gain" or "." not in name for name in solution.unidentifiable):
        return (f"an estimate of {', '.join(solution.unidentifiable)}",)
    return (*_rigid_body(solution), *_modes(solution))


def _rigid_body(solution: Solution) -> Iterator[str]:
    std = np.sqrt(solution.covariance[0, 0])
    if std * MIN_GAIN_STDS > 1:
        gain = np.exp(solution.p[0])
        yield f"a rigid body (k0 = {gain:.2g} ± {NORMAL_QUANTILE * gain * std:.1g}: may be 0)"


def _modes(solution: Solution) -> Iterator[str]:
    model, axes = solution.model, np.eye(solution.p.size)
    for number, (frequency, zeta) in enumerate(model.poles(solution.p)):
        place = 1 + 3 * number
        ratio = solution.p[place + 2]
        half = NORMAL_QUANTILE * zeta * np.sqrt(max(solution.covariance[place + 1, place + 1], 0.0))
        scatter = _std(solution, axes[place + 2] + ratio * axes[0])  # of k0 r, over k0
        uncertainty = NORMAL_QUANTILE * _std(solution, axes[place])
        is_outside = not model.min_frequency <= frequency <= model.max_frequency
        if is_outside and not uncertainty <= MAX_OUTSIDE_FREQUENCY_ERROR:
            why = f"outside of {model.min_frequency:.4g} to {model.max_frequency:.4g} Hz, and uncertain"
            why += f" by {uncertainty:.0%}" if uncertainty < 1 else ""
        elif f"modal_gain_ratios.{number}" in solution.unidentifiable or abs(ratio) < MIN_RATIO_STDS * scatter:
            why = f"its modal gain ratio {ratio:.2g} ± {NORMAL_QUANTILE * scatter:.1g} may be noise"
        elif zeta <= half:
            why = f"its damping ratio {zeta:.2g} ± {half:.1g} may be 0"
        elif zeta + half >= MAX_PEAK_DAMPING:
            why = f"its damping ratio {zeta:.2g} ± {half:.1g} may leave no resonance peak"
        else:
            continue
        yield f"a mode at {frequency:.4g} Hz ({why})"


def _std(solution: Solution, slope: NDArray[np.float64]) -> float:
    """Return the standard deviation of a quantity from its slope by p, shape (size,), with points left out too."""
    return float(np.sqrt(max(slope @ solution.covariance @ slope, slope @ solution.jackknife @ slope)))
