"""How finely a period is sampled."""

from fraexp.api import ParameterError

LEAST, MOST = 16, 2_000_000
"""Samples per period that make a wave, and that fit into memory."""


def samples_per_period(name: str, frequency: float, sample_time: float) -> int:
    """Return the whole number nearest to 1/(f Ts); ParameterError if `LEAST` are not reached."""
    samples = round(1 / (frequency * sample_time))
    if samples > MOST:
        raise ParameterError(
            f"{name} has {samples:,} samples per period at {frequency:g} Hz and a sample time of {sample_time:g} s; "
            f"expected {MOST:,} at most: raise 'frequency', or lengthen loop.sample_time"
        )
    if samples < LEAST:
        raise ParameterError(
            f"{name} has {samples} samples per period at {frequency:g} Hz and a sample time of {sample_time:g} s; "
            f"expected {LEAST} at least: lower 'frequency', or shorten loop.sample_time"
        )
    return samples
