"""The segments of an experiment from which plant and friction can be identified."""

from dataclasses import replace

import numpy as np

from fraexp.api import RecordError, Signals
from fraexp_plugins.estimators._shared.effective_input_observer import is_from_rest


def usable_signals(signals: Signals, output: str, estimator: str) -> Signals:
    """Return the signals with the settled segments that move; RecordError names the estimator if there are none."""
    if any(is_from_rest(segment) for segment in signals.segments):
        raise RecordError(f"{estimator}: the record begins at rest; expected the steady state: set transient = false")
    settled = [s for s in signals.segments if s.settling is None or s.settling.settled]
    moving = tuple(s for s in settled if np.ptp(s.channels[output]) > 0)
    if not moving:
        raise RecordError(
            f"{estimator}: no segment in the steady state moves; raise excitation.amplitude or "
            "excitation.settling_timeout"
        )
    return replace(signals, segments=moving)
