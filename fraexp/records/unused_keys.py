"""Keys of a record that say nothing about it: they are refused, as whoever writes one expects that it acts."""

from fraexp.errors import ParameterError
from fraexp.records.record_settings import RecordSettings

RESPONSE_KEYS = ("response_unit", "input_amplitude", "averages")
"""Keys of a response that was measured elsewhere."""
COMMON_KEYS = ("file", "join_files", "reader", "channels", "level", "realisations")
LINE_KEYS = ("harmonics", "harmonic_step", "min_frequency", "max_frequency")
UNUSED_KEYS = {
    "steps": ("periods_per_realisation", *LINE_KEYS),
    "frequency_column": ("periods_per_realisation", *LINE_KEYS),
    "segments": ("periods_per_realisation", "skip_periods", "skip_time", "max_phase_slip", *LINE_KEYS),
}
"""What the key that states the frequencies of a record leaves no use for."""


def check_response_keys(settings: RecordSettings) -> None:
    """Raise ParameterError if a response has a key of samples over time."""
    used = (*COMMON_KEYS, *RESPONSE_KEYS)
    given = [key for key in type(settings).model_fields if key not in used and _is_given(settings, key)]
    if given:
        raise ParameterError(
            f"{given[0]} describes samples over time, and channel 'frequency' makes this record a response; leave "
            f"{given[0]} out, or the channel"
        )


def check_sample_keys(settings: RecordSettings) -> None:
    """Raise ParameterError if a record over time has a key of a response, or one that another key makes useless."""
    for key in RESPONSE_KEYS:
        if _is_given(settings, key):
            raise ParameterError(
                f"{key} describes a response; expected channels frequency with magnitude and phase, or with real and "
                f"imaginary: leave {key} out of a record over time"
            )
    if settings.controller is not None and not settings.segments:
        raise ParameterError(
            "controller is compared with what was played, which segments state; leave controller out of a record "
            "without segments"
        )
    for way, unused in UNUSED_KEYS.items():
        given = [key for key in unused if getattr(settings, way) and _is_given(settings, key)]
        if given:
            raise ParameterError(f"{way} states the periods of the record and their frequencies; leave {given[0]} out")


def _is_given(settings: RecordSettings, key: str) -> bool:
    return bool(getattr(settings, key) != type(settings).model_fields[key].default)
