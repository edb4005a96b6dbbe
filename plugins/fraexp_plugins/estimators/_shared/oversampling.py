"""The points per sample at which the measured position must drive a friction model."""

from collections.abc import Callable, Sequence
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Segment

LEAST, MOST = 4, 64
"""Least and greatest number of points per sample."""
ERROR_RATIO = 2 / 3
"""Error over the change by twice as many points: a third for a method of second order, and as much again where the
friction turns."""
MAX_EXAMINED = 3
"""Maximum number of segments that are tried with several numbers of points."""

Phasors = Callable[[Sequence[Segment]], list[NDArray[np.complex128]]]
"""Returns the phasors of the input without friction per segment."""
FrictionPhasors = Callable[[Sequence[int], Sequence[Segment]], list[list[NDArray[np.complex128]]]]
"""Returns the phasors of the friction force per segment, for each of several numbers of points per sample."""


def choose_oversampling(
    segments: Sequence[Segment], tolerance: float, linear: Phasors, friction: FrictionPhasors
) -> int:
    """Return the points per sample with which the effective input errs by less than a relative tolerance.

    How many that are follows from the widths of the friction model's elements and from the motion, and is tried on a
    few segments.
    """
    waiting, points = _examined(segments), LEAST
    given = linear(waiting)
    coarse, fine = friction((points // 2, points), waiting)  # side by side: the longest motion is all that it costs
    while True:
        is_coarse = [
            ERROR_RATIO * _relative_change(*forces) > tolerance for forces in zip(given, coarse, fine, strict=True)
        ]
        if not any(is_coarse):
            break
        waiting = list(compress(waiting, is_coarse))
        given, coarse = list(compress(given, is_coarse)), list(compress(fine, is_coarse))
        points *= 2
        if points >= MOST:
            break
        (fine,) = friction((points,), waiting)
    return points


def _examined(segments: Sequence[Segment]) -> list[Segment]:
    """Return the segments that are tried: one of several realisations, which are alike."""
    if any(segment.lines.size > 1 for segment in segments):
        return list(segments[:1])
    numbers = sorted(set(np.linspace(0, len(segments) - 1, MAX_EXAMINED).round().astype(int).tolist()))
    return [segments[number] for number in numbers]


def _relative_change(
    linear: NDArray[np.complex128], coarse: NDArray[np.complex128], fine: NDArray[np.complex128]
) -> float:
    """Return the relative change of the mean effective input over periods, over all lines, by the friction force."""
    change, effective = (coarse - fine).mean(axis=0), (linear - fine).mean(axis=0)
    size = float(np.linalg.norm(effective))
    return float(np.linalg.norm(change)) / size if size else 0.0
