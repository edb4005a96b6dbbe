"""Why a sweep is computed or reused: which outcome, which plugin's source, which parameter, compared to what."""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from fraexp.components.registry import Registry
from fraexp.components.supplies import Supply
from fraexp.data.identity import canonical
from fraexp.data.results import Outcome
from fraexp.data.sweep import Plain, Sweep
from fraexp.data.units import with_powers
from fraexp.execution.events import Why
from fraexp.store import RunSummary, Store, StoredState, StoredSweep
from fraexp.study.paths import unit_at

FRUITLESS = (Outcome.NO_SIGNAL, Outcome.DIVERGED, Outcome.FAILED)
"""Outcomes that ``rerun = "failed"`` computes again."""
MOST_COMPARED = 20_000
"""Stored sweeps with which new ones are compared, and new ones that are, at most."""
MOST_NEAR = 50
"""Stored sweeps of which the nearest to a new one is sought, at most."""
VALUES = 8
"""Values of a parameter that a reason names."""


class Origins:
    """Source hashes of the components that sweeps use; sweeps that have a section in common share the answer."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._of: dict[tuple[str, int], tuple[Any, dict[str, Supply]]] = {}

    def changed(self, sweep: Sweep, state: StoredState) -> list[str]:
        """Return in a few words each component of which the source has changed since a result was stored."""
        stored = state.sources
        told = (  # the same law may be in the machine and in the observer
            f"{name.replace(':', ' ')} (version {now.component.version} of {now.distribution}: source "
            f"{now.source_hash[:8]}, stored {stored[name][:8]})"
            for name, now in self._now(sweep)
            if stored.get(name, now.source_hash) != now.source_hash
        )
        return list(dict.fromkeys(told))

    def _now(self, sweep: Sweep) -> Iterator[tuple[str, Supply]]:
        sections = [*sweep.experiment.items(), ("estimator", sweep.estimator)]
        if "record" in sweep.experiment:
            sections.append(("reader", sweep.experiment["record"].get("reader")))
        for kind, spec in sections:
            if isinstance(spec, Mapping):
                found = self._of.get((kind, id(spec)))
                if found is None:
                    supplies = self._registry.used(kind, spec)
                    named = {f"{of.component.kind}:{of.component.name}": of for of in supplies}
                    found = self._of[kind, id(spec)] = (spec, named)
                yield from found[1].items()


def reasons(
    sweeps: Sequence[Sweep],
    known: Mapping[str, StoredState],
    again: Collection[str],
    stale: Mapping[str, Sequence[str]],
    store: Store | None,
    study: str,
    registry: Registry,
) -> tuple[Why, ...]:
    """Return every sweep under a reason: what is reused, what is stored but computed again, what is new."""
    groups: dict[tuple[bool, str, str], list[Sweep]] = defaultdict(list)
    each: dict[str, str] = {}
    for sweep in sweeps:
        state = known.get(sweep.key)
        anew = sweep.key in again
        fruitless = state is not None and state.outcome in FRUITLESS
        if state is not None and fruitless:
            each[sweep.key] = state.outcome.name.lower().replace("_", " ")
        if state is None:
            groups[True, "new", ""].append(sweep)
        elif sweep.key in stale:
            reason = f"the source has changed since of {' and '.join(stale[sweep.key])}"
            groups[anew, "stale", reason + (", and there is no result of use" if fruitless else "")].append(sweep)
        elif fruitless:
            groups[anew, "failed", "stored, but without a result of use"].append(sweep)
        else:
            groups[anew, "same", "stored, computed by the same sources"].append(sweep)
    new = groups.pop((True, "new", ""), [])
    found = [
        Why(anew, state, reason, of, {sweep.key: each[sweep.key] for sweep in of if sweep.key in each})
        for (anew, state, reason), of in groups.items()
    ]
    return (*found, *_of_new(new, store, study, registry))


def _of_new(new: list[Sweep], store: Store | None, study: str, registry: Registry) -> Iterator[Why]:
    """Yield the reasons of new sweeps: in what they differ from the nearest one of the study's newest run."""
    if not new:
        return
    run = next((run for run in store.runs() if run.study == study), None) if store else None
    if store is None or run is None:
        yield Why(True, "new", "no run of this study is stored", new)
        return
    if run.total > MOST_COMPARED:
        yield Why(True, "new", f"not stored; run {run.number} has too many sweeps to be compared with", new)
        return
    stored = store.sweeps(run.number)
    broken = {of.key: of.message for of in stored if of.outcome is None and of.state == "failed"}
    again = [sweep for sweep in new if sweep.key in broken]
    if again:
        told = {sweep.key: broken[sweep.key] for sweep in again}
        yield Why(True, "failed", f"not stored, for the attempt of run {run.number} broke off", again, told)
    new = [sweep for sweep in new if sweep.key not in broken]
    if new:
        yield from _compared(new[:MOST_COMPARED], [of for of in stored if of.outcome is not None], run, registry)
    if new[MOST_COMPARED:]:
        yield Why(True, "new", "not stored; too many to be compared with others", new[MOST_COMPARED:])


def _compared(
    new: Sequence[Sweep], stored: Sequence[StoredSweep], run: RunSummary, registry: Registry
) -> Iterator[Why]:
    near = _Nearest(stored)
    groups: dict[tuple[str, ...], list[tuple[Sweep, StoredSweep, dict[str, tuple[Any, Any]]]]] = defaultdict(list)
    for sweep in new:
        nearest, differing = near.of(sweep)
        if nearest is None:
            yield Why(True, "new", f"run {run.number} of this study has no result", new)
            return
        groups[tuple(differing)].append((sweep, nearest, differing))
    for paths, found in groups.items():
        units = {path: unit_at(_sections(found[0][0]), path, registry) for path in paths}
        told = []
        for path in paths:
            values = [differing[path] for _, _, differing in found]
            told.append(_told(path, [now for now, _ in values], [then for _, then in values], units[path]))
        each = {sweep.key: _single(nearest, differing, units) for sweep, nearest, differing in found}
        reason = f"{', '.join(told)} (compared with the nearest sweep of run {run.number})"
        yield Why(True, "new", reason, [sweep for sweep, _, _ in found], each)


def _told(path: str, now: Sequence[Any], then: Sequence[Any], unit: str) -> str:
    return f"{path} = {_some(now, unit)}, stored {_some(then, unit)}"


def _some(values: Sequence[Any], unit: str) -> str:
    distinct = list(dict.fromkeys(map(_short, values)))
    more = len(distinct) - VALUES
    measured = unit not in ("", "1") and any(type(value) in (int, float, list) for value in values)
    of = f" {with_powers(unit)}" if measured else ""
    return ", ".join(distinct[:VALUES]) + (f" and {more} more" if more > 0 else "") + of


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = "none" if value is None else value if isinstance(value, str) else canonical(value)
    return text if len(text) <= 30 else f"{text[:27]}..."


def _single(nearest: StoredSweep, differing: Mapping[str, tuple[Any, Any]], units: Mapping[str, str]) -> str:
    told = (_told(path, [now], [then], units[path]) for path, (now, then) in differing.items())
    return f"{', '.join(told)} in sweep {nearest.key[4:12]}"


class _Nearest:
    """Stored sweeps, found by all sections but one: what differs is nearly always in one section."""

    def __init__(self, stored: Sequence[StoredSweep]) -> None:
        self._texts: dict[int, tuple[Any, str]] = {}
        self._stored = stored
        self._but_one: dict[tuple[Any, ...], list[StoredSweep]] = defaultdict(list)
        for sweep in stored:
            for omitted in self._omitting(sweep):
                self._but_one[omitted].append(sweep)

    def of(self, sweep: Sweep) -> tuple[StoredSweep | None, dict[str, tuple[Any, Any]]]:
        """Return the stored sweep that differs least from one, and in what: path, with value now and then."""
        candidates = [of for omitted in self._omitting(sweep) for of in self._but_one.get(omitted, ())[:MOST_NEAR]]
        best: tuple[StoredSweep | None, dict[str, tuple[Any, Any]]] = (None, {})
        for candidate in candidates or self._stored[:MOST_NEAR]:
            differing = dict(_differing(_sections(candidate), _sections(sweep)))
            if best[0] is None or _far(differing) < _far(best[1]):
                best = (candidate, differing)
        return best

    def _omitting(self, sweep: Sweep | StoredSweep) -> list[tuple[Any, ...]]:
        texts = [(name, self._text(section)) for name, section in sorted(_sections(sweep).items())]
        return [(name, *texts[:at], *texts[at + 1 :]) for at, (name, _) in enumerate(texts)]

    def _text(self, section: Any) -> str:
        """Return a section as text; sections of a study are the same objects, and written once."""
        found = self._texts.get(id(section))
        if found is None:
            found = self._texts[id(section)] = (section, canonical(section))
        return found[1]


def _far(differing: Mapping[str, tuple[Any, Any]]) -> tuple[int, float]:
    """Return how far two sweeps are from each other: in how many parameters, then by how much."""
    return len(differing), sum(_apart(now, then) for now, then in differing.values())


def _apart(now: Any, then: Any) -> float:
    if any(type(value) not in (int, float) for value in (now, then)):
        return 1.0
    return float(abs(now - then) / (max(abs(now), abs(then)) or 1))


def _sections(sweep: Sweep | StoredSweep) -> dict[str, Any]:
    return {**sweep.experiment, "estimator": sweep.estimator}


def _differing(then: Plain, now: Plain, path: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Yield path, value now and value then of what differs; of another component its name alone."""
    if now.get("name") != then.get("name"):
        yield (path or "name"), (now.get("name"), then.get("name"))
        return
    for key in dict.fromkeys((*now, *then)):
        one, other = now.get(key), then.get(key)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from _differing(other, one, f"{path}.{key}" if path else key)
        elif one != other:
            yield (f"{path}.{key}" if path else key), (one, other)
