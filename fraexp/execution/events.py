"""What the scheduler tells of a run while it goes on: front ends render it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fraexp.data.results import Result
from fraexp.data.sweep import Sweep


@dataclass(frozen=True)
class Why:
    """Sweeps of a plan for which one reason holds."""

    computed: bool
    """Whether the run computes them; else it takes what is stored."""
    state: str
    """``new``, ``same``, ``stale``, ``failed``: what is stored of them."""
    reason: str
    """In one line, for all of them."""
    sweeps: Sequence[Sweep]
    each: Mapping[str, str] = field(default_factory=dict)
    """By key what is to be said of single ones."""


@dataclass(frozen=True)
class Planned:
    """What a run will do."""

    study: str
    title: str
    total: int
    reused: int
    missing: int
    stale: int
    """Sweeps that are reused although a plugin's source has changed since."""
    seconds: float | None
    """Expected time, compiling included [s]; None if nothing is missing."""
    compiling: float = 0.0
    """Part of it in which friction laws are compiled [s]."""
    executor: str = ""
    """The executor that computes what is missing; empty if nothing is."""
    whys: tuple[Why, ...] = ()
    """Why sweeps are computed or reused, each sweep under one reason; empty if that was not asked for."""


@dataclass(frozen=True)
class Begun:
    """The run has been recorded in the database."""

    run: int
    """Its number."""


@dataclass(frozen=True)
class Preparing:
    """Something that takes its time before the first sweep."""

    what: str


@dataclass(frozen=True)
class Noticed:
    """Something that people should know, such as a worker that is left out."""

    what: str


@dataclass(frozen=True)
class Progress:
    """Sweeps done, with the fraction of those that are running."""

    done: float
    total: float
    running: int | None = None
    """Sweeps that are being computed; None if that is not told."""
    doing: str = ""
    """What is done before a first sweep gets on, such as compiling."""


@dataclass(frozen=True)
class Finished:
    """One sweep has come to its end: `computed`, `reused` or `failed`."""

    sweep: Sweep
    result: Result | None
    state: str
    error: str = ""


@dataclass(frozen=True)
class Ended:
    """The run is over: `complete`, `partial`, `interrupted` or `dry`."""

    run: int | None
    state: str
    figures: tuple[Path, ...] = ()
    """Files that show the sweeps, one for each unit of their responses."""
    note: str = ""
    """Why there is no figure, where there should be one."""


Event = Planned | Begun | Preparing | Noticed | Progress | Finished | Ended
