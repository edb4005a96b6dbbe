"""What a scheduler and its workers send each other: a job, and why it failed."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fraexp.data.sweep import Plain


@dataclass(frozen=True)
class Job:
    """The sweeps that share an experiment, as plain data."""

    experiment: Plain
    estimators: tuple[Plain, ...]
    files: Mapping[str, str] = field(default_factory=dict)
    plugins: str = ""
    """Folder of the local plugins; empty if there is none."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Source hashes of the local plugins that are to compute it, under ``kind:name``."""


@dataclass(frozen=True)
class Failure:
    """Why a sweep has no result: a sentence for the user, and the traceback for the log."""

    message: str
    log: str
    lacks_memory: bool = False
    """Whether memory was too little."""
