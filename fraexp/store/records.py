"""What the store answers with, apart from results: plain records without arrays."""

from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from fraexp.results import Outcome


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
