"""Progress events of a run, which the scheduler yields and the user interfaces display."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from fraexp.data.results import Result
from fraexp.data.sweep import Sweep


@dataclass(frozen=True)
class Why:
    """Sweeps that a plan computes, or reuses, for the same reason."""

    computed: bool
    """Whether the run computes them; otherwise it reuses what is stored."""
    state: str
    """State of what is stored: ``new``, ``same``, ``stale`` or ``failed``."""
    reason: str
    """The reason, in one line."""
    sweeps: Sequence[Sweep]
    each: Mapping[str, str] = field(default_factory=dict)
    """Details of single sweeps, by key."""
    paths: Sequence[str] = ()
    """Paths of the values that are new."""


class TimeLeft(NamedTuple):
    """The expected time until the last sweep of a run has been computed."""

    seconds: float | None = None
    """Time of the sweeps of which it is known [s]; None if it is unknown of all."""
    like: int = 0
    """Number of computed like sweeps from which it follows."""
    unlike: int = 0
    """Number of sweeps of which it is unknown, because none like them has been computed."""


UNKNOWN_TIME = TimeLeft()


@dataclass(frozen=True)
class Planned:
    """The plan of a run."""

    study: str
    title: str
    total: int
    reused: int
    missing: int
    stale: int
    """Sweeps that are reused although a plugin's source has changed since."""
    time: TimeLeft = UNKNOWN_TIME
    """The expected time to compute the missing sweeps."""
    executor: str = ""
    """The executor that computes the missing sweeps; empty if there are none."""
    whys: tuple[Why, ...] = ()
    """Reasons why sweeps are computed or reused, each sweep under one of them; empty unless requested."""


@dataclass(frozen=True)
class Begun:
    """The run has been recorded in the database."""

    run: int
    """Its number."""


@dataclass(frozen=True)
class Preparing:
    """Something that takes time before the first sweep."""

    what: str


@dataclass(frozen=True)
class Noticed:
    """Something that the user should know, such as a worker that is not used."""

    what: str


@dataclass(frozen=True)
class Progress:
    """Number of finished sweeps, plus the fractions of the running ones."""

    done: float
    total: float
    running: int | None = None
    """Number of sweeps that are being computed; None if unknown."""
    doing: str = ""
    """What delays the run, such as compiling, or a cluster without workers."""
    time: TimeLeft = UNKNOWN_TIME
    """The expected time until the last sweep is computed."""


@dataclass(frozen=True)
class Finished:
    """A sweep has ended; its state is ``computed``, ``reused`` or ``failed``."""

    sweep: Sweep
    result: Result | None
    state: str
    error: str = ""


@dataclass(frozen=True)
class Ended:
    """The run has ended; its state is ``complete``, ``partial``, ``interrupted`` or ``dry``."""

    run: int | None
    state: str
    figures: tuple[Path, ...] = ()
    """Files with the figures of the sweeps, one for each unit of their responses."""
    note: str = ""
    """Why a figure is missing."""


Event = Planned | Begun | Preparing | Noticed | Progress | Finished | Ended
