"""The section [record] of a study: files, columns, sample rate and periods."""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, Literal, Self

from pydantic import ValidationInfo, field_validator

from fraexp.components.parameters import Parameters, param
from fraexp.errors import ParameterError
from fraexp.records.channels import Channel, parse_channel

LEVEL_MARK, REALISATION_MARK = "{level}", "{realisation}"
"""Placeholders in names for the level and the realisation."""
Name = str | int | float
INJECTED_CHANNELS = ("excitation", "reference")
"""Names of channels with a signal from outside the loop, which neither friction nor feedback changes."""
MAX_SAMPLES = 2**40
"""Largest number of samples or periods."""
MIN_BLOCKS = 2
"""Least number of blocks, whose scatter is the variance."""


class Step(Parameters):
    """The part of a stepped-sine record with one frequency."""

    start: float = param("s", "start, from the first sample", at_least=0)
    stop: float = param("s", "end, from the first sample", above=0)
    frequency: float = param("Hz", "frequency", above=0)


class PlayedSegment(Parameters):
    """Whole periods of a record, counted in samples: whoever has played the excitation knows them."""

    start: int = param("1", "first sample of the periods, from 0", at_least=0, at_most=MAX_SAMPLES)
    periods: int = param("1", "number of periods", at_least=1, at_most=MAX_SAMPLES)
    samples: int = param("1", "samples per period", at_least=2, at_most=MAX_SAMPLES)
    harmonics: tuple[int, ...] = param("1", "excited harmonics of the period")
    rest: int | None = param("1", "sample before which the machine was at rest", None, at_least=0, at_most=MAX_SAMPLES)
    settled: bool | None = param("", "whether it was periodic when the periods began; not stated if absent", None)
    residual: float | None = param("1", "relative difference of the last periods compared", None, at_least=0)
    expected: dict[str, float] = param("", "amplitude of channels at the excited lines, as it was predicted in SI", {})
    excitation: tuple[tuple[float, float], ...] = param(
        "", "amplitude in SI and phase [deg] of what is played at each of the harmonics, from `start` on", ()
    )


TABLES: Mapping[str, tuple[type[Step | PlayedSegment], str]] = {
    "steps": (Step, "; expected such as [{start = 0, stop = 1, frequency = 10}]"),
    "segments": (PlayedSegment, ", such as those that fraexp measure and excite write"),
}
"""Settings that are lists of tables, and how to write them."""


class RecordSettings(Parameters):
    """A measured record: periodic (`samples_per_period` or `period_time`), a stepped sine (`steps` or
    `frequency_column`), or neither.

    A channel is a table ``{column = "x", unit = "mm", scale = -1}`` or short ``"x"``, ``"x [mm]"`` or
    ``"volts * 31.5 [N]"``; the unit that the file states is used where none is given. In the names of files and
    columns, and in `select`, ``{level}`` and ``{realisation}`` stand for what `level` and `realisations` say.
    """

    file: tuple[str, ...] = param("", "file of the record, relative to the study, or several of one experiment")
    join_files: bool = param("", "whether the files are channels of one record, and not realisations", False)
    reader: str = param("", "name of the reader; found by the file's suffix if empty", "")
    channels: dict[str, Channel] = param(
        "", "channels by name: the columns of the file; frequency, magnitude and phase of a response"
    )
    response_unit: str = param("", "unit of a response, such as mm/N; 0 dB is 1 of it", "")
    input_amplitude: float | str | None = param(
        "", "amplitude of a response's input, in the SI unit or with one: friction depends on it", None
    )
    averages: int | None = param(
        "1", "averages of a response with coherence, for its standard deviation", None, at_least=1, at_most=MAX_SAMPLES
    )
    line_channel: str = param(
        "", "channel in which lines are looked for; if empty excitation or reference, if there is one, or the first", ""
    )
    sample_rate: float | None = param("Hz", "sample rate", None, above=0)
    time_column: Channel | None = param("", "column with the time; in s if it has no unit", None)
    resample: Literal["", "cubic", "linear"] = param(
        "", "interpolation between time stamps to a uniform clock; if empty, the clock must be uniform", ""
    )
    start_time: float = param("s", "time after the first sample at which the record begins", 0.0, at_least=0)
    end_time: float | None = param("s", "time after the first sample at which the record ends", None, above=0)
    level: Name | None = param("", "what {level} stands for in names; a grid over it compares levels", None)
    realisations: tuple[Name, ...] = param("", "what {realisation} stands for in names, one after another", ())
    select: str = param("", "which samples are taken, such as 'amplitude = 12'; each run of them is a segment", "")
    segment_column: Channel | None = param(
        "", "column that numbers the segments, each analysed by itself; 0 or below between them", None
    )
    periodic: bool = param("", "whether the record repeats itself; if not, all of it is one period", True)
    samples_per_period: int | None = param("1", "samples per period", None, at_least=2, at_most=MAX_SAMPLES)
    period_time: float | None = param("s", "duration of a period", None, above=0)
    periods_per_realisation: int | None = param(
        "1", "periods of each realisation, where several follow one another", None, at_least=1, at_most=MAX_SAMPLES
    )
    steps: tuple[Step, ...] = param("", "stretches of a stepped sine: start, stop, frequency", ())
    segments: tuple[PlayedSegment, ...] = param(
        "", "periods of an excitation that fraexp has played: start, periods, samples, harmonics", ()
    )
    controller: dict[str, Any] | None = param(
        "", "controller of the machine that has played the segments: its answer to y is looked for in u", None
    )
    frequency_column: Channel | None = param(
        "", "column with the frequency of a stepped sine; 0 where there is none", None
    )
    skip_periods: int = param(
        "1", "periods dropped at the start of the record, or of each step", 0, at_least=0, at_most=MAX_SAMPLES
    )
    skip_time: float = param("s", "time dropped at the start of the record, or of each step", 0.0, at_least=0)
    min_frequency: float | None = param("Hz", "lowest excited frequency", None, above=0)
    max_frequency: float | None = param("Hz", "highest excited frequency", None, above=0)
    harmonics: tuple[int, ...] = param("1", "excited harmonics of the period, if they are not to be found", ())
    max_phase_slip: float = param(
        "1", "greatest phase slip of a block of whole periods, in periods", 1e-3, above=0, below=0.1
    )

    @field_validator("channels", mode="before")
    @classmethod
    def _read_channels(cls, value: object) -> dict[str, Channel]:
        if not isinstance(value, Mapping) or not value:
            raise ParameterError('channels is no table of channels; expected such as u = "iq [A]"')
        return {str(name): parse_channel(channel, f"channels.{name}") for name, channel in value.items()}

    @field_validator("time_column", "frequency_column", "segment_column", mode="before")
    @classmethod
    def _read_column(cls, value: object) -> Channel | None:
        return None if value is None else parse_channel(value, "time_column, frequency_column or segment_column")

    @field_validator("file", mode="before")
    @classmethod
    def _read_file(cls, value: object) -> tuple[str, ...]:
        names = (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list | tuple) else ()
        if not names or not all(isinstance(name, str) for name in names):
            raise ParameterError(f"file is {value!r}; expected the name of a file, or a list of names")
        return names

    @field_validator("steps", "segments", mode="before")
    @classmethod
    def _read_tables(cls, value: object, info: ValidationInfo) -> tuple[Parameters, ...]:
        kind, such = TABLES[str(info.field_name)]
        if not isinstance(value, list | tuple) or not all(isinstance(one, kind | Mapping) for one in value):
            raise ParameterError(f"{info.field_name} is no list of tables{such}")
        return tuple(
            one if isinstance(one, kind) else kind.parse(one, f"{info.field_name}.{number}")
            for number, one in enumerate(value, start=1)
        )

    @property
    def min_blocks(self) -> int:
        """Least number of blocks of a segment: the variance is their scatter, or that of the realisations."""
        return (
            1
            if self.realisations
            or (len(self.file) > 1 and not self.join_files)
            or self.segment_column
            or self.periods_per_realisation == 1
            else MIN_BLOCKS
        )

    @property
    def reference(self) -> str:
        """Name of the input, which shows the period of the record and its level."""
        return self.line_channel or next(iter(self.channels))

    @property
    def injected(self) -> str:
        """Name of the channel with the injected signal, whose lines are used; otherwise the input."""
        given = (name for name in INJECTED_CHANNELS if name in self.channels)
        return self.line_channel or next(given, self.reference)

    @property
    def has_stated_runs(self) -> bool:
        """Whether the study says where segments or realisations begin."""
        return bool(self.select or self.segment_column or self.periods_per_realisation)

    def parts(self) -> Iterator[tuple[tuple[str, ...], Self]]:
        """Yield each file, or all that are joined, and its settings for each realisation, without placeholders.

        ParameterError if a placeholder has no value, or a value has no placeholder.
        """
        named = (*self.channels.values(), *self.auxiliary_columns)
        texts = (*self.file, *(name for channel in named for name in channel.columns), self.select)
        for mark, given in ((LEVEL_MARK, self.level is not None), (REALISATION_MARK, bool(self.realisations))):
            key = "level" if mark == LEVEL_MARK else "realisations"
            if given != any(mark in text for text in texts):
                finding = f"{key} is given, but {mark} stands in no name" if given else f"{mark} stands in a name"
                remedy = "write it into a column, a file or select" if given else f"give {key} (--{key.rstrip('s')})"
                raise ParameterError(f"record: {finding}; {remedy}")
        groups = [self.file] if self.join_files else [(file,) for file in self.file]
        for files, realisation in product(groups, self.realisations or ("",)):
            names = {LEVEL_MARK: _name_text(self.level), REALISATION_MARK: _name_text(realisation)}
            filled = {
                "channels": {name: _fill_marks(channel, names) for name, channel in self.channels.items()},
                "select": _replace_marks(self.select, names),
                **{
                    key: _fill_marks(getattr(self, key), names)
                    for key in AUXILIARY_COLUMNS
                    if getattr(self, key) is not None
                },
            }
            yield tuple(_replace_marks(file, names) for file in files), self.model_copy(update=filled)

    @property
    def auxiliary_columns(self) -> list[Channel]:
        """Columns beside the channels."""
        given = (getattr(self, key) for key in AUXILIARY_COLUMNS)
        return [channel for channel in given if channel is not None]


AUXILIARY_COLUMNS = ("time_column", "frequency_column", "segment_column")
"""Settings that are columns beside the channels."""


def _name_text(name: Name | None) -> str:
    return f"{name:g}" if isinstance(name, float) else str(name)


def _replace_marks(text: str, names: Mapping[str, str]) -> str:
    for mark, name in names.items():
        text = text.replace(mark, name)
    return text


def _fill_marks(channel: Channel, names: Mapping[str, str]) -> Channel:
    changes = {key: _replace_marks(getattr(channel, key), names) for key in ("column", "plus", "minus")}
    return channel.model_copy(update=changes)


RESPONSE_KEYS = ("response_unit", "input_amplitude", "averages")
"""Keys of a response that was measured elsewhere."""
COMMON_KEYS = ("file", "join_files", "reader", "channels", "level", "realisations")
"""Keys of a response and of samples over time."""
LINE_KEYS = ("periods_per_realisation", "harmonics", "min_frequency", "max_frequency")
UNUSED_KEYS = {
    "steps": LINE_KEYS,
    "frequency_column": LINE_KEYS,
    "segments": ("skip_periods", "skip_time", "max_phase_slip", *LINE_KEYS),
}
"""What the key that states the frequencies of a record leaves no use for."""


def check_keys(settings: RecordSettings, is_response: bool) -> None:
    """Raise ParameterError if a key has no use in a response, in samples over time, or beside another key."""
    given = [key for key, of in type(settings).model_fields.items() if getattr(settings, key) != of.default]
    if is_response:
        for key in given:
            if key not in (*COMMON_KEYS, *RESPONSE_KEYS):
                raise ParameterError(
                    f"{key} describes samples over time, and channel 'frequency' makes this record a response; leave "
                    f"{key} out, or the channel"
                )
        return
    for key in given:
        if key in RESPONSE_KEYS:
            raise ParameterError(
                f"{key} describes a response; expected channels frequency with magnitude and phase, or with real and "
                f"imaginary: leave {key} out of a record over time"
            )
        if key == "controller" and not settings.segments:
            raise ParameterError(
                "controller is compared with what was played, which segments state; leave controller out of a record "
                "without segments"
            )
        for way in (way for way, unused in UNUSED_KEYS.items() if key in unused and getattr(settings, way)):
            raise ParameterError(f"{way} states the periods of the record and their frequencies; leave {key} out")
