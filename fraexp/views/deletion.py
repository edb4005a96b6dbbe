"""What is lost when runs or sweeps are deleted."""

from collections.abc import Sequence

from fraexp.store import Store
from fraexp.views.words import duration, plural

TOLD = 1000
"""More sweeps than this are only counted."""


def loss_of_sweeps(store: Store, keys: Sequence[str]) -> str:
    """Return what is lost with sweeps, in words."""
    lost = f"{plural(len(keys), 'sweep')} with results, also in the runs that have {'it' if len(keys) == 1 else 'them'}"
    if len(keys) > TOLD:
        return f"{lost}; with their tags and notes"
    sweeps = [store.find(key) for key in keys]
    tags = sorted({tag for sweep in sweeps for tag in sweep.tags})
    notes = sum(bool(sweep.note) for sweep in sweeps)
    took = sum(sweep.elapsed for sweep in sweeps)
    told = [
        *([f"computed in {duration(took)}"] if took else []),
        *([f"tagged {', '.join(tags)}"] if tags else []),
        *([f"{plural(notes, 'note')} on {'it' if len(keys) == 1 else 'them'}"] if notes else []),
    ]
    return "; ".join([lost, *told])


def loss_of_run(store: Store, number: int) -> str:
    """Return what is lost with a run, in words; its sweeps that other runs have stay."""
    run = store.run(number)
    return f"run {number} of {run.study}, with those of its {plural(run.total, 'sweep')} that are in no other run"
