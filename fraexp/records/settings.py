"""The section [record] of a study: which file, which columns, how it is sampled and where its periods are."""

import re
from collections.abc import Mapping
from typing import Any

from pydantic import field_validator

from fraexp.errors import ParameterError
from fraexp.parameters import Parameters, param

SHORT = re.compile(r"^(?P<column>.*\S)\s*\[(?P<unit>[^\]]*)\]$")
"""A column with its unit in square brackets, such as ``iq [A]``."""


class Channel(Parameters):
    """A column of the file and how its numbers become a quantity."""

    column: str = param("", "name of the column in the file")
    unit: str = param("", "unit of the numbers in the file, such as mm; 1 for a pure number", "")
    scale: float = param("1", "factor on the numbers, such as -1", 1.0)


class Step(Parameters):
    """The stretch of a stepped-sine record with one frequency."""

    start: float = param("s", "start, from the first sample", at_least=0)
    stop: float = param("s", "end, from the first sample", above=0)
    frequency: float = param("Hz", "frequency", above=0)


class RecordSettings(Parameters):
    """A measured record: either periodic (`period` or `period_time`) or a stepped sine (`steps` or `frequency`).

    A channel is a table ``{column = "x", unit = "mm", scale = -1}`` or short ``"x"`` or ``"x [mm]"``; the
    unit that the file states is used where none is given.
    """

    file: str = param("", "file of the record, relative to the study")
    reader: str = param("", "name of the reader; found by the file's suffix if empty", "")
    channels: dict[str, Channel] = param("", "channels by name: the columns of the file")
    input: str = param("", "channel in which lines are looked for; the first one if empty", "")
    sample_rate: float | None = param("Hz", "sample rate", None, above=0)
    time: Channel | None = param("", "column with the time; in s if it has no unit", None)
    period: int | None = param("1", "samples per period", None, at_least=2)
    period_time: float | None = param("s", "duration of a period", None, above=0)
    steps: tuple[Step, ...] = param("", "stretches of a stepped sine: start, stop, frequency", ())
    frequency: Channel | None = param("", "column with the frequency of a stepped sine; 0 where there is none", None)
    skip: int = param("1", "periods dropped at the start of the record, or of each step", 0, at_least=0)
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
        return {str(name): _channel(channel, f"channels.{name}") for name, channel in value.items()}

    @field_validator("time", "frequency", mode="before")
    @classmethod
    def _read_column(cls, value: Any) -> Channel | None:
        return None if value is None else _channel(value, "time or frequency")

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
    def reference(self) -> str:
        """Name of the channel in which lines are looked for."""
        return self.input or next(iter(self.channels))


def _channel(value: Any, place: str) -> Channel:
    if isinstance(value, Channel):
        return value
    if isinstance(value, str):
        short = SHORT.match(value)
        return Channel(column=short["column"], unit=short["unit"]) if short else Channel(column=value)
    if not isinstance(value, Mapping):
        raise ParameterError(f"{place} is {value!r}; expected the name of a column, or a table with column and unit")
    return Channel.parse(value, place)
