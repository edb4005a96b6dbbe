"""What the store answers with, apart from results: plain records without arrays."""

from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from fraexp.data.results import Outcome
from fraexp.store.liveness import Process

MOST_TOLD = 32
"""Running sweeps that a run tells of, at most."""


@dataclass(frozen=True)
class Supplied:
    """Where a component came from when it was used."""

    source_hash: str
    """Content hash of the file that defined it."""
    distribution: str
    """Name and version of the installed package, or ``workspace``."""


@dataclass(frozen=True)
class StoredState:
    """What decides whether a stored sweep is reused."""

    outcome: Outcome
    sources: dict[str, str]
    """Source hash at the time, by ``kind:name``."""
    elapsed: float
    """Computing time [s]."""


@dataclass(frozen=True)
class RunProgress:
    """How far a run has come with what it computes."""

    done: float
    """Sweeps that are done, with the fractions of those that are running."""
    total: int
    """Sweeps to compute."""
    workers: int
    """How many are computed at once, at most."""
    running: dict[str, float]
    """Fraction done of sweeps that are being computed, by key; of the first MOST_TOLD of them."""
    doing: str = ""
    """What is done before a first sweep gets on, such as compiling."""


@dataclass(frozen=True)
class RunSummary:
    """One execution of a study and how far it came."""

    number: int
    study: str
    study_file: str
    command: str
    started: datetime
    """In UTC."""
    ended: datetime | None
    """In UTC; None while it runs, and for a run whose process died."""
    state: str
    """``running``, ``complete``, ``partial`` or ``interrupted``."""
    provenance: dict[str, Any]
    total: int
    computed: int
    reused: int
    failed: int
    process: Process
    """The process that writes it, or wrote it."""
    heartbeat: datetime
    """When that process last gave a sign of life, in UTC."""
    progress: RunProgress | None = None
    """What it then told of its progress; None if nothing."""


@dataclass(frozen=True)
class StoredSweep:
    """One sweep, without its arrays, as the run that asks for it (or the latest one) saw it."""

    key: str
    experiment: dict[str, Any]
    estimator: dict[str, Any]
    labels: dict[str, Any]
    outcome: Outcome | None
    """None while there is no result."""
    message: str
    """Why the attempt failed if it did, else the message of the result."""
    elapsed: float
    """Computing time of the result [s]; 0 while there is none."""
    created: datetime | None
    """When the result was stored, in UTC."""
    state: str
    """``pending``, ``computed``, ``reused`` or ``failed``."""
    sources: dict[str, Supplied] = field(default_factory=dict)
    """Origin of each component used, by ``kind:name``."""
    tags: tuple[str, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Listed:
    """One sweep in a listing, as its latest run (or the one that is asked for) saw it."""

    key: str
    labels: dict[str, Any]
    state: str
    """``pending``, ``computed``, ``reused`` or ``failed``."""
    outcome: Outcome | None
    """None while there is no result."""
    message: str
    """Why the attempt failed if it did, else the message of the result."""
    estimator: str | None
    friction: str | None
    plant: str | None
    controller: str | None
    excitation: str | None
    source: str | None
    """``loop``, ``drive`` or ``record``."""
    elapsed: float
    """Computing time of the result [s]; 0 while there is none."""
    created: datetime | None
    """When the result was stored, in UTC."""
    run: int | None
    """Number of that run; None for a sweep that is in no run."""
    study: str | None
    tags: tuple[str, ...]
    note: str


@dataclass(frozen=True)
class ListingPage:
    """A part of a listing."""

    rows: tuple[Listed, ...]
    total: int
    """Number of sweeps in the whole listing."""


@dataclass(frozen=True)
class Conflict:
    """A sweep that two databases answer differently."""

    key: str
    what: tuple[str, ...]
    """Of ``outcome``, ``response``, ``metrics``, ``curves`` and ``fits``; or ``key`` if it is damaged."""
    how: str
    """In what, and how far: differences of arrays are relative to their largest value."""


@dataclass(frozen=True)
class Merged:
    """What came of joining a database to another one."""

    sweeps: int
    """Sweeps that were added, with a result or without."""
    results: int
    """Results that were added."""
    same: int
    """Results that both have."""
    runs: int
    """Runs that were added."""
    known_runs: int
    """Runs that both have."""
    conflicts: tuple[Conflict, ...]
    """What both have and differs; the database that was added to keeps its own."""


@dataclass(frozen=True)
class Migrated:
    """What came of bringing a database up to date."""

    before: str
    now: str
    """Revisions of its schema."""
    size_before: int
    size: int
    """Room that it takes, before unused room was given back and after [bytes]."""
