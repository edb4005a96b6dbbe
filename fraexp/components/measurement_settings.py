"""The section [measurement] of a study: the machine on which it is measured, and when a point is good enough."""

from fraexp.components.kinds import MachineDriver
from fraexp.components.parameters import Parameters, param

MIN_RAMP_OUT_S, MIN_RAMP_OUT_SAMPLES = 0.01, 10
"""Shortest ramp out: what an excitation does that ends within a sample depends on the moment at which it is stopped."""


class MeasurementSettings(Parameters):
    """Where and how `fraexp measure` plays the excitation of a study."""

    machine: MachineDriver = param("", "machine on which it is played, such as {name = 'simulated'}")
    band: float | None = param(
        "1", "half-width [dB] of the 95 % band that each frequency is to reach; none: the periods of [excitation]",
        None, above=0, at_most=20,
    )  # fmt: skip
    max_record_time: float = param("s", "longest record of a frequency that has not reached its band", 30.0, above=0)
    attempts: int = param("1", "how often a point is played at most, after faults or for its band", 4, at_least=1)
    adapt_amplitude: bool = param(
        "", "whether amplitudes are lowered near a limit, and raised where the band would take too long", False
    )
    margin: float = param("1", "part of each limit that predicted motion must leave free", 0.1, at_least=0, below=1)
    ramp_out: float = param(
        "s", "time in which the excitation falls to 0, at the end and at a stop",
        0.05, at_least=MIN_RAMP_OUT_S,
    )  # fmt: skip


def ramp_out_samples(seconds: float, sample_time: float) -> int:
    """Return the samples of a ramp out of so many seconds."""
    return max(round(seconds / sample_time), MIN_RAMP_OUT_SAMPLES)
