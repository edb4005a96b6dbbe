"""Records that the store returns beside results: plain values without arrays."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime

from fraexp.data.findings import Finding, message_of
from fraexp.data.results import Outcome, Result
from fraexp.errors import StoreError
from fraexp.store.liveness import Process
from fraexp.store.validation import JsonTable

MAX_RUNNING_SHOWN = 32
"""Maximum number of running sweeps in a run's progress."""


@dataclass(frozen=True)
class ComponentOrigin:
    """Origin of a component that was used."""

    source_hash: str
    """Content hash of the file that defined it."""
    distribution: str
    """Name and version of the installed package, or ``workspace``."""


@dataclass(frozen=True)
class StoredState:
    """State of a stored sweep, which decides whether it is reused."""

    outcome: Outcome
    sources: dict[str, str]
    """Source hashes of the components that computed it, by ``kind:name``."""
    elapsed: float
    """Computing time [s]."""


Likeness = tuple[str | None, ...]
"""Source and names of plant, friction, controller, excitation and estimator of a sweep."""


@dataclass(frozen=True)
class RunProgress:
    """Progress of a run."""

    done: float
    """Number of finished sweeps, plus the fractions of the running ones."""
    total: int
    """Number of sweeps to compute."""
    workers: int
    """Number of sweeps that can be computed at the same time."""
    running: dict[str, float]
    """Fraction done of the running sweeps, by key, of the first MAX_RUNNING_SHOWN of them."""
    doing: str = ""
    """What delays the first sweep, such as compiling."""
    seconds_left: float | None = None
    """Expected time until the last sweep is computed [s]; None if it is unknown."""
    like: int = 0
    """Number of computed like sweeps from which that time follows."""
    unlike: int = 0
    """Number of sweeps that it leaves out, because none like them has been computed."""


@dataclass(frozen=True)
class RunSummary:
    """An execution of a study."""

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
    provenance: JsonTable
    total: int
    computed: int
    reused: int
    failed: int
    process: Process
    """The process that executes it, or executed it."""
    heartbeat: datetime
    """Time of the last heartbeat, in UTC."""
    progress: RunProgress | None = None
    """Progress at the last heartbeat; None if it was not reported."""
    silence: float = 0.0
    """Time since the last heartbeat, by the clock of the database [s]; 0 unless it is running."""
    unusable: int = 0
    """Number of results that cannot be used, such as those of diverged sweeps; `failed` ones have none."""
    deleted: int = 0
    """Number of sweeps that were deleted since, which are not among the `total`."""

    @property
    def end(self) -> str:
        """State as people read it: an interrupted run is stopped, or its process was lost without a word."""
        if self.state != "interrupted":
            return self.state
        return "process lost" if self.ended is None else "stopped"

    @property
    def is_unusable(self) -> bool:
        """Whether it has ended without a usable result."""
        return self.state in ("complete", "partial") and 0 < self.total == self.failed + self.unusable


@dataclass(frozen=True)
class StoredSweep:
    """A sweep without arrays, as in the requested run, or in its latest one."""

    key: str
    experiment: JsonTable
    estimator: JsonTable
    labels: JsonTable
    outcome: Outcome | None
    """None without a result."""
    findings: tuple[Finding, ...]
    """Those of the result; empty without one."""
    elapsed: float
    """Computing time of the result [s]; 0 without a result."""
    created: datetime | None
    """When the result was stored, in UTC."""
    state: str
    """``pending``, ``computed``, ``reused`` or ``failed``."""
    sources: dict[str, ComponentOrigin] = field(default_factory=dict)
    """Origin of each component used, by ``kind:name``."""
    tags: tuple[str, ...] = ()
    run: int | None = None
    """Number of that run; None for a sweep without a run."""
    study: str | None = None
    """Study of that run."""
    failure: str = ""
    """Reason of a failed attempt."""

    @property
    def message(self) -> str:
        """Reason of a failed attempt; otherwise the words of its findings."""
        return self.failure or message_of(self.findings)

    @property
    def sections(self) -> JsonTable:
        """Experiment and estimator as one table."""
        return {**self.experiment, "estimator": self.estimator}

    def component(self, kind: str) -> str | None:
        """Return the name of its component of a kind; None without one, and for those of several ports."""
        spec = self.sections.get(kind)
        return spec.get("name") if isinstance(spec, dict) else None

    def check_sound(self) -> None:
        """Raise StoreError if it is damaged."""
        if self.outcome is Outcome.DAMAGED:
            raise StoreError(f"sweep {self.key[4:12]}: {self.message}; {self.outcome.value}")


def mark_damaged(sweeps: Iterable[StoredSweep], results: Mapping[str, Result]) -> list[StoredSweep]:
    """Return sweeps of which those with a damaged result have this outcome: their rows alone do not show it."""
    damaged = {key: found for key, found in results.items() if found.outcome is Outcome.DAMAGED}
    return [
        replace(sweep, outcome=found.outcome, findings=found.findings) if (found := damaged.get(sweep.key)) else sweep
        for sweep in sweeps
    ]


def leave_out_damaged(
    sweeps: Iterable[StoredSweep], results: Mapping[str, Result], warn: Callable[[str], object]
) -> list[StoredSweep]:
    """Return the sweeps that are not damaged; `warn` is called with a line for each that is."""
    sound = []
    for sweep in mark_damaged(sweeps, results):
        if sweep.outcome is Outcome.DAMAGED:
            warn(f"sweep {sweep.key[4:12]} is damaged and left out: {Outcome.DAMAGED.value}")
        else:
            sound.append(sweep)
    return sound


@dataclass(frozen=True)
class ListingPage:
    """A page of a listing."""

    rows: tuple[StoredSweep, ...]
    total: int
    """Number of sweeps in the whole listing."""


@dataclass(frozen=True)
class Conflict:
    """A sweep or a run that differs between two databases, or is damaged in the one that is read."""

    key: str
    """Key of the sweep, or ``run`` and its number."""
    what: tuple[str, ...]
    """What differs: ``outcome``, ``message``, ``response``, ``metrics``, ``curves``, ``fits``, ``numerics``,
    ``origins``, ``key`` or ``run``; or what is damaged."""
    how: str
    """Description of the difference with both values; that of arrays is relative to their largest value."""

    def joined(self, other: "Conflict") -> "Conflict":
        """Return this finding with another one of the same sweep."""
        return Conflict(self.key, (*self.what, *other.what), f"{self.how}; {other.how}")


@dataclass
class MergeSummary:
    """Result of merging a database into another one.

    ``read`` is the sum of ``added``, ``there``, and the numbers of ``conflicts`` and ``damaged``; ``read_runs`` is that
    of ``runs``, ``known_runs``, ``run_conflicts`` and ``damaged_runs``.
    """

    sweeps: int = 0
    """Number of sweeps that were added, with or without a result."""
    results: int = 0
    """Number of results that were added."""
    same: int = 0
    """Number of results that both databases have."""
    runs: int = 0
    """Number of runs that were added."""
    known_runs: int = 0
    """Number of runs that both databases have."""
    conflicts: tuple[Conflict, ...] = ()
    """Sweeps that differ; the target database keeps its own."""
    read: int = 0
    """Number of sweeps that were read."""
    added: int = 0
    """Number of sweeps of which something was added: the sweep, its result or tags."""
    there: int = 0
    """Number of sweeps that the target database had already, without a difference."""
    tags: int = 0
    """Number of tags that were added."""
    damaged: tuple[Conflict, ...] = ()
    """Sweeps that are damaged, with what was left out."""
    read_runs: int = 0
    """Number of runs that were read."""
    run_conflicts: tuple[Conflict, ...] = ()
    """Runs that differ; the target database keeps its own."""
    damaged_runs: tuple[Conflict, ...] = ()
    """Runs that are damaged, with what was left out."""


@dataclass(frozen=True)
class Deletion:
    """Runs and sweeps that were deleted together, or that came back from the trash."""

    runs: tuple[int, ...]
    """Their numbers."""
    keys: tuple[str, ...]
    """Keys of the sweeps."""
