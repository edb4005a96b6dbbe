"""The records from which plant and friction can be identified, and the refusal of others."""

from dataclasses import replace

import numpy as np

from fraexp.api import RecordError, Segment, Signals
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


FRICTION_PREFIX = "friction."
"""Start of the name of a simulated channel with the friction force at a contact, if the plant has several."""


CONTROL_INPUT_PREFIX = "u."
"""Start of the name of a channel with the control input of a thrust that is not excited."""


def check_one_thrust(signals: Signals, estimator: str) -> None:
    """Raise RecordError if a record has control inputs of thrusts that hold a position while another is excited."""
    thrusts = [
        name.removeprefix(CONTROL_INPUT_PREFIX) for name in signals.units if name.startswith(CONTROL_INPUT_PREFIX)
    ]
    if thrusts:
        raise RecordError(
            f"{estimator}: thrusts that are not excited move the machine too ({', '.join(thrusts)}), and a replay has "
            "one thrust; use effective_input"
        )


def check_one_contact(signals: Signals, estimator: str) -> None:
    """Raise RecordError if a simulated record shows friction at more than one contact.

    A measured record does not say so; what the model leaves of it does. Further thrusts are refused as well.
    """
    check_one_thrust(signals, estimator)
    forces = [name for name in signals.units if name.startswith(FRICTION_PREFIX)]
    contacts = [
        name.removeprefix(FRICTION_PREFIX)
        for name in forces
        if any(segment.channels[name].any() for segment in signals.segments)
    ]
    if len(contacts) > 1:
        raise RecordError(
            f"{estimator}: the machine has friction at {len(contacts)} contacts ({', '.join(contacts)}); expected one, "
            "as the plant that is fitted has it: give the model of each one, as maximum_likelihood.frictions"
        )


HARMONICS = (1, 3, 5, 7, 9)
"""Harmonics of a sine that show the force of friction."""
FORCE_FLOOR = 3e-4
"""Error of a force that is allowed for besides rounding and noise, over the amplitude of the control input."""
MAX_NOISE_RATIO = 3.0
"""Error, or scatter of records, over that by noise up to which noise explains it: the model has errors, too."""
MIN_SIZE_RATIO = 1.5
"""Greatest over least thrust or speed from which records separate what depends on it from what does not."""
HELD_OUT_STEP = 4
"""Every fourth cycle or record is held out to compare laws. Half of it fits half of them: intervals widen by 20 %."""
MAX_LINES = 64
"""Maximum number of excited lines of a segment, each of which takes two parameters of its own."""


SAMPLE_TIME_TOLERANCE = FORCE_FLOOR / 3
"""Relative difference up to which sample times are one: that of the inertia force, twice as large, is below
`FORCE_FLOOR`. Periods that are no whole number of samples, and rounded time stamps, make a record's differ by 1e-6."""


def check_segments(signals: Signals, estimator: str) -> None:
    """Raise RecordError, which names the estimator, for segments that a replay cannot follow."""
    if not all(segment.periodic for segment in signals.segments):
        raise RecordError(
            f"{estimator}: the record does not repeat itself (periodic = false); expected whole periods: state "
            "the record's period, or take h1_h2_hv or local_polynomial"
        )
    lines = max(segment.lines.size for segment in signals.segments)
    if lines > MAX_LINES:
        raise RecordError(
            f"{estimator}: a segment has {lines} excited lines; expected at most {MAX_LINES}: excite fewer at a "
            "time, or use effective_input"
        )
    times = sorted({segment.sample_time for segment in signals.segments})
    if times[-1] > (1 + SAMPLE_TIME_TOLERANCE) * times[0]:
        raise RecordError(
            f"{estimator}: the segments have sample times of {times[0]:g} to {times[-1]:g} s; expected one: "
            "estimate those of each sample time for themselves"
        )


def with_harmonics(segment: Segment, min_samples: float) -> Segment:
    """Return a record of a sine with its odd harmonics that have so many samples in a cycle; others as they are.

    Symmetric friction has no even ones.
    """
    if segment.lines.size > 1:
        return segment
    (line,) = segment.lines.tolist()
    known = [harmonic for harmonic in HARMONICS if harmonic == 1 or min_samples * harmonic * line <= segment.samples]
    return replace(segment, lines=line * np.array(known))
