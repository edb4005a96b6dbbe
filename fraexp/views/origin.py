"""Provenance of a result: the run that computed it, the code, and whether the sources have changed."""

from dataclasses import dataclass

from fraexp.components.registry import Registry
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.views.fields import run_fields


@dataclass(frozen=True)
class SourceState:
    """The file that defined a component when a sweep was computed."""

    component: str
    distribution: str
    source_hash: str
    status: str
    """Whether the source is the same now, in words."""


def computing_and_latest_run(store: Store, sweep: StoredSweep) -> tuple[RunSummary | None, RunSummary | None]:
    """Return the run that computed a sweep, None if it was deleted, and the latest run that has the sweep."""
    latest = store.find_all([sweep.key]).get(sweep.key)
    newest = store.run(latest.run) if latest and latest.run is not None else None
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


def source_states(sweep: StoredSweep, registry: Registry) -> list[SourceState]:
    """Return the sources of a sweep's components, and whether they have changed since."""
    found = []
    for name, supplied in sweep.sources.items():
        kind, _, own = name.partition(":")
        provider = registry.providers.get((kind, own))
        same = provider is not None and provider.source_hash == supplied.source_hash
        now = "gone" if provider is None else "unchanged" if same else "changed since; --rerun stale computes it again"
        found.append(SourceState(name, supplied.distribution, supplied.source_hash[:12], now))
    return found
