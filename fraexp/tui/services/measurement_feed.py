"""What a measuring process reports to the terminal UI: the plan, progress, points, and how it ended."""

import pickle
from contextlib import suppress
from dataclasses import dataclass
from typing import IO

from fraexp.data.results import FrequencyResponse

LabelledResponse = tuple[str, FrequencyResponse]
"""What an estimator found at one point, with its name."""


@dataclass(frozen=True)
class LimitedMotion:
    """A quantity that has a limit, such as the stroke."""

    name: str
    unit: str
    limit: float
    predicted: float
    """What the plan asks for, by its greatest point [unit]."""
    place: int
    """Its place in a demand."""


@dataclass(frozen=True)
class PlanReport:
    """The plan of an experiment, within its limits."""

    label: str
    machine: str
    motions: tuple[LimitedMotion, ...]
    margin: float
    """Part of each limit that predicted motion leaves free."""
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    """Texts of each point, in the order in which they are played."""
    seconds: float
    """Machine time that the points are expected to take that are not kept [s]."""
    total: str
    """Number of points, how many of them are kept, and the machine time of the others, in words."""
    frequency_range: tuple[float, float]
    """Lowest and highest frequency [Hz]."""
    band: float | None
    """Half-width of the 95 % band that each point is to reach [dB]."""
    kept: int
    """Points that an earlier, interrupted measurement has stored."""
    is_other_stored: bool
    """Whether a measurement of another machine, excitation or setting is stored, which must be discarded."""
    total_afresh: str = ""
    """The same as `total` if nothing is kept."""
    drive: str = ""
    """What the user must know of a drive that cannot be switched off."""


@dataclass(frozen=True)
class PlansReport:
    """The plans of all experiments of a study; nothing has been played."""

    plans: tuple[PlanReport, ...]
    is_autonomous: bool = False
    """Whether stages take the place of points: then nothing is predicted."""


@dataclass(frozen=True)
class BeginReport:
    """A machine is connected, and an experiment begins."""

    plan: PlanReport
    """The plan by the limits of study and machine together."""
    points: int
    kept: int = 0
    """Points of an earlier measurement, which are not played again."""


@dataclass(frozen=True)
class ProgressReport:
    """The point that is being played."""

    frequency: str
    at: float
    """Its lowest frequency [Hz]."""
    peak: str
    """Peak of the excitation, with its unit."""
    seconds: float
    """Machine time of the play so far [s]."""
    is_settled: bool
    periods: int
    band: float | None
    """Half-width of the 95 % band so far [dB]."""
    demand: tuple[float, ...]
    """The greatest motion and force of the play so far."""
    predicted: tuple[float, ...]
    """The same, as predicted for all of it."""


@dataclass(frozen=True)
class PointReport:
    """A point that has been measured, now or before an interruption."""

    text: str
    done: int
    seconds_left: float
    responses: tuple[LabelledResponse, ...]


@dataclass(frozen=True)
class StageReport:
    """A stage of an autonomous measurement begins, or a level of it, or the evaluation after it."""

    name: str
    """Which of how many, in words."""
    begin: float
    """Part of all stages that is done."""
    share: float
    """Part of all stages that its points are."""
    rest: str = ""
    """Why the axis rests; empty while it moves."""
    rest_seconds: float = 0.0
    """Time that it is expected to rest [s]; 0 if it is not known."""


@dataclass(frozen=True)
class NoticeReport:
    """What was repeated or lost."""

    text: str


@dataclass(frozen=True)
class EndReport:
    """How it ended: ``complete``, ``stopped`` or ``failed``."""

    state: str
    text: str = ""
    study: str = ""
    """The study that analyses the record, if there is one."""


Report = PlansReport | BeginReport | ProgressReport | PointReport | StageReport | NoticeReport | EndReport


class ReportWriter:
    """The end of a pipe into which the measuring process writes its reports."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def send(self, report: Report) -> None:
        """Send a report; if nobody reads any more, the pipe of orders ends the measurement, not this one."""
        with suppress(OSError):
            pickle.dump(report, self._stream)
            self._stream.flush()


def read_report(stream: IO[bytes]) -> Report | None:
    """Return the next report; None at the end of the stream, also in the middle of a report."""
    try:
        return pickle.load(stream)
    except (EOFError, pickle.UnpicklingError, OSError, ValueError):
        return None
