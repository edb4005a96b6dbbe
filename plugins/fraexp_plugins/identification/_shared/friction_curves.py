"""Curves of identified friction: the virgin curve, and force over velocity."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import NORMAL_QUANTILE, Curve


def virgin_curve(x: NDArray[np.float64], force: NDArray[np.float64], std: NDArray[np.float64]) -> Curve:
    """Return the virgin curve with its 95 % limits, from ascending displacement [m], force and its std [N].

    The curve begins at 0 and never falls. Nor do its limits: they leave out values that only a falling curve could
    reach from a place where it is better known.
    """
    lower, upper = force - NORMAL_QUANTILE * std, force + NORMAL_QUANTILE * std
    columns = {
        "displacement": x,
        "force": force,
        "lower 95 %": np.fmax.accumulate(np.maximum(lower, 0.0)),
        "upper 95 %": np.fmin.accumulate(upper[::-1])[::-1],
    }
    return Curve("virgin curve", columns, dict(zip(columns, ("m", "N", "N", "N"), strict=True)))


def force_over_velocity(velocity: NDArray[np.float64], force: NDArray[np.float64], model: NDArray[np.float64]) -> Curve:
    """Return force and model [N] over ascending velocity [m/s], with a gap between the two directions."""
    order = np.argsort(velocity, kind="stable")
    first_positive = int(np.sum(velocity < 0))
    columns = (
        np.insert(values[order], first_positive, gap)
        for values, gap in ((velocity, 0), (force, np.nan), (model, np.nan))
    )
    named = dict(zip(("velocity", "force", "model"), columns, strict=True))
    return Curve("force over velocity", named, {"velocity": "m/s", "force": "N", "model": "N"})
