"""Why a sweep is computed or reused: which outcome, which plugin's source, which parameter, compared to what."""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from fraexp.components.registry import Provider, Registry
from fraexp.data.identity import canonical
from fraexp.data.results import UNUSABLE_OUTCOMES
from fraexp.data.sweep import Plain, Sweep, section_digest
from fraexp.data.units import with_powers
from fraexp.execution.events import Why
from fraexp.execution.used_components import component_sections
from fraexp.store import RunSummary, Store, StoredState, StoredSweep
from fraexp.study.paths import unit_at

MAX_COMPARED_SWEEPS = 20_000
"""Maximum number of stored sweeps, and of new ones, that are compared."""
MAX_CANDIDATES = 50
"""Maximum number of stored sweeps among which the nearest one is searched."""
MAX_VALUES = 8
"""Values of a parameter that a reason names."""


class Origins:
    """Source hashes of the components that sweeps use; sweeps that have a section in common share the answer."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._of: dict[tuple[str, bytes], dict[str, Provider]] = {}

    def changed(self, sweep: Sweep, state: StoredState) -> list[str]:
        """Return in a few words each component of which the source has changed since a result was stored."""
        stored = state.sources
        texts = (  # the same law may be in the machine and in the observer
            f"{name.replace(':', ' ')} (version {now.component.version} of {now.distribution}: source "
            f"{now.source_hash[:8]}, stored {stored[name][:8]})"
            for name, now in self._current_providers(sweep)
            if stored.get(name, now.source_hash) != now.source_hash
        )
        return list(dict.fromkeys(texts))

    def _current_providers(self, sweep: Sweep) -> Iterator[tuple[str, Provider]]:
        for kind, spec in component_sections(sweep.experiment, [sweep.estimator]):
            key = (kind, section_digest(spec))
            if key not in self._of:
                providers = self._registry.used_providers(kind, spec)
                self._of[key] = {f"{of.component.kind}:{of.component.name}": of for of in providers}
            yield from self._of[key].items()


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
        unusable = state is not None and state.outcome in UNUSABLE_OUTCOMES
        if state is not None and unusable:
            each[sweep.key] = state.outcome.name.lower().replace("_", " ")
        if state is None:
            groups[True, "new", ""].append(sweep)
        elif sweep.key in stale:
            reason = f"the source has changed since of {' and '.join(stale[sweep.key])}"
            groups[anew, "stale", reason + (", and there is no result of use" if unusable else "")].append(sweep)
        elif unusable:
            groups[anew, "failed", "stored, but without a result of use"].append(sweep)
        else:
            groups[anew, "same", "stored, computed by the same sources"].append(sweep)
    new = groups.pop((True, "new", ""), [])
    found = [
        Why(anew, state, reason, of, {sweep.key: each[sweep.key] for sweep in of if sweep.key in each})
        for (anew, state, reason), of in groups.items()
    ]
    return (*found, *_explain_new(new, store, study, registry))


def _explain_new(new: list[Sweep], store: Store | None, study: str, registry: Registry) -> Iterator[Why]:
    """Yield the reasons of new sweeps: in what they differ from the nearest one of the study's newest run."""
    if not new:
        return
    run = next((run for run in store.runs() if run.study == study), None) if store else None
    if store is None or run is None:
        yield Why(True, "new", "no run of this study is stored", new)
        return
    if run.total > MAX_COMPARED_SWEEPS:
        yield Why(True, "new", f"not stored; run {run.number} has too many sweeps to be compared with", new)
        return
    stored = store.sweeps(run.number)
    broken = {of.key: of.message for of in stored if of.outcome is None and of.state == "failed"}
    again = [sweep for sweep in new if sweep.key in broken]
    if again:
        texts = {sweep.key: broken[sweep.key] for sweep in again}
        yield Why(True, "failed", f"not stored; the attempt of run {run.number} failed", again, texts)
    new = [sweep for sweep in new if sweep.key not in broken]
    if new:
        yield from _compare_with_run(
            new[:MAX_COMPARED_SWEEPS], [of for of in stored if of.outcome is not None], run, registry
        )
    if new[MAX_COMPARED_SWEEPS:]:
        yield Why(True, "new", "not stored; too many to be compared with others", new[MAX_COMPARED_SWEEPS:])


def _compare_with_run(
    new: Sequence[Sweep], stored: Sequence[StoredSweep], run: RunSummary, registry: Registry
) -> Iterator[Why]:
    near = _Nearest(stored)
    groups: dict[tuple[str, ...], list[tuple[Sweep, StoredSweep, dict[str, tuple[Any, Any]]]]] = defaultdict(list)
    for sweep in new:
        nearest, differing = near.nearest_to(sweep)
        if nearest is None:
            yield Why(True, "new", f"run {run.number} of this study has no result", new)
            return
        groups[tuple(differing)].append((sweep, nearest, differing))
    for paths, found in groups.items():
        units = {path: unit_at(found[0][0].sections, path, registry) for path in paths}
        texts = []
        for path in paths:
            values = [differing[path] for _, _, differing in found]
            texts.append(_difference_text(path, [now for now, _ in values], [then for _, then in values], units[path]))
        each = {sweep.key: _sweep_differences(nearest, differing, units) for sweep, nearest, differing in found}
        reason = f"{', '.join(texts)} (compared with the nearest sweep of run {run.number})"
        yield Why(True, "new", reason, [sweep for sweep, _, _ in found], each)


def _difference_text(path: str, now: Sequence[Any], then: Sequence[Any], unit: str) -> str:
    return f"{path} = {_values_text(now, unit)}, stored {_values_text(then, unit)}"


def _values_text(values: Sequence[Any], unit: str) -> str:
    distinct = list(dict.fromkeys(map(_value_text, values)))
    more = len(distinct) - MAX_VALUES
    measured = unit not in ("", "1") and any(type(value) in (int, float, list) for value in values)
    of = f" {with_powers(unit)}" if measured else ""
    return ", ".join(distinct[:MAX_VALUES]) + (f" and {more} more" if more > 0 else "") + of


def _value_text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = "none" if value is None else value if isinstance(value, str) else canonical(value)
    return text if len(text) <= 30 else f"{text[:27]}..."


def _sweep_differences(nearest: StoredSweep, differing: Mapping[str, tuple[Any, Any]], units: Mapping[str, str]) -> str:
    texts = (_difference_text(path, [now], [then], units[path]) for path, (now, then) in differing.items())
    return f"{', '.join(texts)} in sweep {nearest.key[4:12]}"


class _Nearest:
    """Stored sweeps, found by all sections but one: what differs is nearly always in one section."""

    def __init__(self, stored: Sequence[StoredSweep]) -> None:
        self._stored = stored
        self._but_one: dict[tuple[Any, ...], list[StoredSweep]] = defaultdict(list)
        for sweep in stored:
            for omitted in self._hashes_without_one(sweep):
                self._but_one[omitted].append(sweep)

    def nearest_to(self, sweep: Sweep) -> tuple[StoredSweep | None, dict[str, tuple[Any, Any]]]:
        """Return the stored sweep that differs least from one, and the differences: path with new and stored value."""
        candidates = [
            of for omitted in self._hashes_without_one(sweep) for of in self._but_one.get(omitted, ())[:MAX_CANDIDATES]
        ]
        best: tuple[StoredSweep | None, dict[str, tuple[Any, Any]]] = (None, {})
        for candidate in candidates or self._stored[:MAX_CANDIDATES]:
            differing = dict(_differences(candidate.sections, sweep.sections))
            if best[0] is None or _distance(differing) < _distance(best[1]):
                best = (candidate, differing)
        return best

    def _hashes_without_one(self, sweep: Sweep | StoredSweep) -> list[tuple[Any, ...]]:
        hashes = [(name, section_digest(section)) for name, section in sorted(sweep.sections.items())]
        return [(name, *hashes[:at], *hashes[at + 1 :]) for at, (name, _) in enumerate(hashes)]


def _distance(differing: Mapping[str, tuple[Any, Any]]) -> tuple[int, float]:
    """Return how far two sweeps are from each other: in how many parameters, then by how much."""
    return len(differing), sum(_relative_difference(now, then) for now, then in differing.values())


def _relative_difference(now: Any, then: Any) -> float:
    if any(type(value) not in (int, float) for value in (now, then)):
        return 1.0
    return float(abs(now - then) / (max(abs(now), abs(then)) or 1))


def _differences(then: Plain, now: Plain, path: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Yield path, value now and value then of what differs; of another component its name alone."""
    if now.get("name") != then.get("name"):
        yield (path or "name"), (now.get("name"), then.get("name"))
        return
    for key in dict.fromkeys((*now, *then)):
        one, other = now.get(key), then.get(key)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from _differences(other, one, f"{path}.{key}" if path else key)
        elif one != other:
            yield (f"{path}.{key}" if path else key), (one, other)
