"""The section [record] of a study: which file, which columns, how it is sampled and where its periods are."""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, Self

from pydantic import field_validator

from fraexp.components.parameters import Parameters, param
from fraexp.errors import ParameterError
from fraexp.records.channels import Channel, channel_of

LEVEL, REALISATION = "{level}", "{realisation}"
"""What stands in names for the level, and for the realisation."""
Name = str | int | float
INJECTED = ("excitation", "reference")
"""Names of channels that hold a signal from outside the loop, which neither friction nor feedback touches."""
MOST = 2**40
"""Greatest number of samples or periods."""
BLOCKS = 2
"""Least number of blocks: their scatter is the variance."""


class Step(Parameters):
    """The stretch of a stepped-sine record with one frequency."""

    start: float = param("s", "start, from the first sample", at_least=0)
    stop: float = param("s", "end, from the first sample", above=0)
    frequency: float = param("Hz", "frequency", above=0)


class RecordSettings(Parameters):
    """A measured record: periodic (`period` or `period_time`), a stepped sine (`steps` or `frequency`), or neither.

    A channel is a table ``{column = "x", unit = "mm", scale = -1}`` or short ``"x"``, ``"x [mm]"`` or
    ``"volts * 31.5 [N]"``; the unit that the file states is used where none is given. In the names of files and
    columns, and in `where`, ``{level}`` and ``{realisation}`` stand for what `level` and `realisations` say.
    """

    file: tuple[str, ...] = param("", "file of the record, relative to the study, or several of one experiment")
    reader: str = param("", "name of the reader; found by the file's suffix if empty", "")
    channels: dict[str, Channel] = param("", "channels by name: the columns of the file")
    input: str = param(
        "", "channel in which lines are looked for; if empty excitation or reference, if there is one, or the first", ""
    )
    sample_rate: float | None = param("Hz", "sample rate", None, above=0)
    time: Channel | None = param("", "column with the time; in s if it has no unit", None)
    level: Name | None = param("", "what {level} stands for in names; a grid over it compares levels", None)
    realisations: tuple[Name, ...] = param("", "what {realisation} stands for in names, one after another", ())
    where: str = param("", "which samples are taken, such as 'amplitude = 12'; each run of them is a segment", "")
    segment: Channel | None = param(
        "", "column that numbers the segments, each analysed by itself; 0 or below between them", None
    )
    periodic: bool = param("", "whether the record repeats itself; if not, all of it is one period", True)
    period: int | None = param("1", "samples per period", None, at_least=2, at_most=MOST)
    period_time: float | None = param("s", "duration of a period", None, above=0)
    periods: int | None = param(
        "1", "periods of each realisation, where several follow one another", None, at_least=1, at_most=MOST
    )
    steps: tuple[Step, ...] = param("", "stretches of a stepped sine: start, stop, frequency", ())
    frequency: Channel | None = param("", "column with the frequency of a stepped sine; 0 where there is none", None)
    skip: int = param("1", "periods dropped at the start of the record, or of each step", 0, at_least=0, at_most=MOST)
    skip_time: float = param("s", "time dropped at the start of the record, or of each step", 0.0, at_least=0)
    lowest: float | None = param("Hz", "lowest excited frequency", None, above=0)
    highest: float | None = param("Hz", "highest excited frequency", None, above=0)
    every: int | None = param(
        "1",
        "every how many harmonics one is excited, from lowest to highest; found if absent",
        None,
        at_least=1,
    )
    lines: tuple[int, ...] = param("1", "excited harmonics of the period, if they are not to be found", ())
    coherence: float = param(
        "1", "greatest phase slip of a block of whole periods, in periods", 1e-3, above=0, below=0.1
    )

    @field_validator("channels", mode="before")
    @classmethod
    def _read_channels(cls, value: Any) -> dict[str, Channel]:
        if not isinstance(value, Mapping) or not value:
            raise ParameterError('channels is no table of channels; expected such as u = "iq [A]"')
        return {str(name): channel_of(channel, f"channels.{name}") for name, channel in value.items()}

    @field_validator("time", "frequency", "segment", mode="before")
    @classmethod
    def _read_column(cls, value: Any) -> Channel | None:
        return None if value is None else channel_of(value, "time, frequency or segment")

    @field_validator("file", mode="before")
    @classmethod
    def _read_file(cls, value: Any) -> tuple[str, ...]:
        names = (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list | tuple) else ()
        if not names or not all(isinstance(name, str) for name in names):
            raise ParameterError(f"file is {value!r}; expected the name of a file, or a list of names")
        return names

    @field_validator("steps", mode="before")
    @classmethod
    def _read_steps(cls, value: Any) -> tuple[Step, ...]:
        if not isinstance(value, list | tuple) or not all(isinstance(step, Step | Mapping) for step in value):
            raise ParameterError("steps is no list of tables; expected such as [{start = 0, stop = 1, frequency = 10}]")
        return tuple(
            step if isinstance(step, Step) else Step.parse(step, f"steps.{number}")
            for number, step in enumerate(value, start=1)
        )

    @property
    def least_blocks(self) -> int:
        """Blocks that a segment needs at least: their scatter is the variance, or that of the realisations."""
        return 1 if self.realisations or len(self.file) > 1 or self.segment or self.periods == 1 else BLOCKS

    @property
    def reference(self) -> str:
        """Name of the input: it tells whether the record repeats itself, and at which level."""
        return self.input or next(iter(self.channels))

    @property
    def injected(self) -> str:
        """Name of the channel that holds what was injected, in which lines are looked for; else the input."""
        given = (name for name in INJECTED if name in self.channels)
        return self.input or next(given, self.reference)

    def parts(self) -> Iterator[tuple[str, Self]]:
        """Yield the name of each file with its settings, for each realisation, in which nothing is left to fill in.

        ParameterError if a placeholder has nothing to stand for, or the other way round.
        """
        texts = (*self.file, *(name for channel in self._named() for name in channel.columns), self.where)
        for mark, given in ((LEVEL, self.level is not None), (REALISATION, bool(self.realisations))):
            key = "level" if mark == LEVEL else "realisations"
            if given != any(mark in text for text in texts):
                finding = f"{key} is given, but {mark} stands in no name" if given else f"{mark} stands in a name"
                remedy = "write it into a column, a file or where" if given else f"give {key} (--{key.rstrip('s')})"
                raise ParameterError(f"record: {finding}; {remedy}")
        for file, realisation in product(self.file, self.realisations or ("",)):
            names = {LEVEL: _text(self.level), REALISATION: _text(realisation)}
            filled = {
                "channels": {name: _filled(channel, names) for name, channel in self.channels.items()},
                "where": _replaced(self.where, names),
                **{key: _filled(getattr(self, key), names) for key in AUXILIARY if getattr(self, key) is not None},
            }
            yield _replaced(file, names), self.model_copy(update=filled)

    def _named(self) -> list[Channel]:
        extra = [getattr(self, key) for key in AUXILIARY]
        return [*self.channels.values(), *(channel for channel in extra if channel is not None)]


AUXILIARY = ("time", "frequency", "segment")
"""Settings that are a column beside the channels."""


def _text(name: Name | None) -> str:
    return f"{name:g}" if isinstance(name, float) else str(name)


def _replaced(text: str, names: Mapping[str, str]) -> str:
    for mark, name in names.items():
        text = text.replace(mark, name)
    return text


def _filled(channel: Channel, names: Mapping[str, str]) -> Channel:
    changes = {key: _replaced(getattr(channel, key), names) for key in ("column", "plus", "minus")}
    return channel.model_copy(update=changes)
