"""One point of a study's grid as plain data: an experiment and an estimator, identified by content."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from fraexp.identity import key_of

Plain = Mapping[str, Any]
DRAW = "draw"
"""Label of a sweep that was drawn at random: the number of its draw. The labels behind it are what was drawn."""


@dataclass(frozen=True)
class Sweep:
    """An experiment and an estimator, fully resolved: the unit of reuse and storage."""

    experiment: Plain
    """What is simulated or read. `source` is ``loop``, ``drive`` or ``record``; the rest are its sections."""
    estimator: Plain
    """Name, version and parameters of the estimator."""
    labels: Plain = field(default_factory=dict)
    """The grid's values at this point, for people: not part of the identity."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Where the files are whose hashes the experiment names: not part of the identity."""

    @cached_property
    def experiment_key(self) -> str:
        """Key shared by all sweeps that use the same signals."""
        return key_of(self.experiment)

    @cached_property
    def key(self) -> str:
        """Key of this sweep, independent of names, paths, labels and executors."""
        return key_of({"experiment": self.experiment, "estimator": self.estimator})
