"""Where a sweep's result comes from: the run that computed it, the code, and whether that is still the same."""

from dataclasses import dataclass

from fraexp.components.registry import Registry
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.views.fields import run_fields


@dataclass(frozen=True)
class Source:
    """The file that defined a component when a sweep was computed."""

    component: str
    distribution: str
    source_hash: str
    now: str
    """Whether it is the same now."""


def runs_of(store: Store, sweep: StoredSweep) -> tuple[RunSummary | None, RunSummary | None]:
    """Return the run that computed a sweep, None if it is not there any more, and the latest run that has it."""
    latest = store.page(f"key={sweep.key}", limit=1).rows
    number = latest[0].run if latest else None
    newest = store.run(number) if number is not None else None
    if sweep.created is None:
        return None, newest
    for run in store.runs():
        during = run.started <= sweep.created and (run.ended is None or sweep.created <= run.ended)
        if during and store.page(f"key={sweep.key} state=computed", limit=1, run=run.number).total:
            return run, newest
    return None, newest


def provenance_fields(run: RunSummary) -> list[tuple[str, str]]:
    """Return names and values of the run that computed a sweep."""
    return [pair for pair in run_fields(run) if pair[0] not in ("sweeps", "took")]


def sources_now(sweep: StoredSweep, registry: Registry) -> list[Source]:
    """Return where a sweep's components came from, and whether their files have changed since."""
    found = []
    for name, supplied in sweep.sources.items():
        kind, _, own = name.partition(":")
        supply = registry.supplies.get((kind, own))
        same = supply is not None and supply.source_hash == supplied.source_hash
        now = "gone" if supply is None else "unchanged" if same else "changed since: --rerun stale computes it again"
        found.append(Source(name, supplied.distribution, supplied.source_hash[:12], now))
    return found
