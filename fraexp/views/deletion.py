"""What is lost when runs or sweeps are deleted, in words."""

from collections.abc import Sequence

from fraexp.store import Store
from fraexp.views.words import duration_text, plural

MAX_DETAILED_SWEEPS = 1000
"""Maximum number of sweeps whose tags and computing times are read."""


def deletion_text(runs: int, sweeps: int) -> str:
    """Return how many runs and sweeps are deleted, or come back."""
    return f"{plural(runs, 'run')} and {plural(sweeps, 'sweep')}" if runs else plural(sweeps, "sweep")


def hidden_text(store: Store, keys: Sequence[str], wanted: str) -> str:
    """Return how many of the sweeps a filter hides, to follow their number: ``, 2 of them hidden by the filter``."""
    hidden = len(set(keys).difference(store.keys(wanted))) if wanted.strip() else 0
    count = "" if len(keys) == 1 else "all of them " if hidden == len(keys) else f"{hidden:,} of them "
    return f", {count}hidden by the filter" if hidden else ""


def sweep_loss_text(store: Store, keys: Sequence[str], wanted: str = "") -> str:
    """Return in words what is lost when sweeps are deleted, and how many of them a filter hides."""
    hidden, them = hidden_text(store, keys, wanted), "it" if len(keys) == 1 else "them"
    comma = "," if hidden else ""
    lost = f"{plural(len(keys), 'sweep')}{hidden}{comma} with results, also in the runs that have {them}"
    if len(keys) > MAX_DETAILED_SWEEPS:
        return f"{lost}; with their tags"
    sweeps = [store.find(key) for key in keys]
    tags = sorted({tag for sweep in sweeps for tag in sweep.tags})
    took = sum(sweep.elapsed for sweep in sweeps)
    told = [*([f"computed in {duration_text(took)}"] if took else []), *([f"tagged {', '.join(tags)}"] if tags else [])]
    return "; ".join([lost, *told])


def run_loss_text(store: Store, number: int) -> str:
    """Return in words what is lost when a run is deleted; sweeps that other runs have are kept."""
    run = store.run(number)
    return f"run {number} of {run.study}, and those of its {plural(run.total, 'sweep')} that no other run has"
