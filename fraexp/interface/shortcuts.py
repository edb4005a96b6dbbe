"""Functions that work in the current folder, for those who need no `Workspace` object."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fraexp.components.kinds import Component
from fraexp.interface.callable_law import FrictionLaw
from fraexp.interface.recordings import Recording
from fraexp.interface.result_sets import Run
from fraexp.interface.session import Workspace
from fraexp.interface.study_source import Study
from fraexp.interface.sweep_results import SweepResult


def run(study: str | Path | Study, changes: Mapping[str, object] | None = None, **options: Any) -> Run:
    """Run a study in the current folder and return its results; see `Workspace.run`."""
    return Workspace().run(study, changes, **options)


def friction_law(name: str, **parameters: object) -> FrictionLaw:
    """Return a friction law by name with its parameters, to be called; see `Workspace.friction_law`."""
    return Workspace().friction_law(name, **parameters)


def simulate(
    machine: str | Mapping[str, Any], excitation: str | Mapping[str, Any] | Component, **sections: Any
) -> Recording:
    """Return the signals of a simulated experiment, without a database; see `Workspace.simulate`."""
    return Workspace().simulate(machine, excitation, **sections)


def read_record(
    file: str | Path | Sequence[str | Path], channels: Mapping[str, Any] | None = None, **keys: Any
) -> Recording:
    """Return the signals of a measured record, without a database; see `Workspace.read_record`."""
    return Workspace().read_record(file, channels, **keys)


def estimate(recording: Recording, estimator: str | Mapping[str, Any] | Component, **parameters: Any) -> SweepResult:
    """Return what an estimator makes of signals, without a database; see `Workspace.estimate`."""
    return Workspace().estimate(recording, estimator, **parameters)


def identify(recording: Recording, estimator: str | Mapping[str, Any] | Component, **parameters: Any) -> SweepResult:
    """Return the plant or friction law that an estimator identifies, without a database; see `Workspace.identify`."""
    return Workspace().identify(recording, estimator, **parameters)
