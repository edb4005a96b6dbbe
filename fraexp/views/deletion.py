"""What is lost when runs or sweeps are deleted, in words."""

from collections.abc import Sequence

from fraexp.store import Store
from fraexp.views.words import duration_text, plural

MAX_DETAILED_SWEEPS = 1000
"""Maximum number of sweeps whose tags, notes and computing times are read."""


def deletion_text(runs: int, sweeps: int) -> str:
    """Return how many runs and sweeps are deleted, or come back."""
    return f"{plural(runs, 'run')} and {plural(sweeps, 'sweep')}" if runs else plural(sweeps, "sweep")


def sweep_loss_text(store: Store, keys: Sequence[str]) -> str:
    """Return in words what is lost when sweeps are deleted."""
    lost = f"{plural(len(keys), 'sweep')} with results, also in the runs that have {'it' if len(keys) == 1 else 'them'}"
    if len(keys) > MAX_DETAILED_SWEEPS:
        return f"{lost}; with their tags and notes"
    sweeps = [store.find(key) for key in keys]
    tags = sorted({tag for sweep in sweeps for tag in sweep.tags})
    notes = sum(bool(sweep.note) for sweep in sweeps)
    took = sum(sweep.elapsed for sweep in sweeps)
    told = [
        *([f"computed in {duration_text(took)}"] if took else []),
        *([f"tagged {', '.join(tags)}"] if tags else []),
        *([f"{plural(notes, 'note')} on {'it' if len(keys) == 1 else 'them'}"] if notes else []),
    ]
    return "; ".join([lost, *told])


def run_loss_text(store: Store, number: int) -> str:
    """Return in words what is lost when a run is deleted; sweeps that other runs have are kept."""
    run = store.run(number)
    return f"run {number} of {run.study}, and those of its {plural(run.total, 'sweep')} that no other run has"
