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
from fraexp.store import Store, StoredState, StoredSweep
from fraexp.study.paths import unit_at

MAX_COMPARED_SWEEPS = 20_000
"""Maximum number of stored sweeps with whose values new ones are compared."""
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
            each[sweep.key] = state.outcome.words
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
    """Yield the reasons of new sweeps: the values that no sweep of the study's newest run has."""
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
        why = f"not stored; the attempt of run {run.number} failed"
        yield Why(True, "failed", why, again, {sweep.key: broken[sweep.key] for sweep in again})
    usable = [of for of in stored if of.outcome is not None]
    if not usable:
        rest = [sweep for sweep in new if sweep.key not in broken]
        yield from (
            [Why(True, "new", f"not stored; run {run.number} has no result to compare with", rest)] if rest else []
        )
        return
    known = _StoredValues(usable, registry)
    groups: dict[tuple[str, ...], list[tuple[Sweep, dict[str, Any]]]] = defaultdict(list)
    for sweep in new:
        if sweep.key not in broken:
            fresh = known.fresh_values(sweep.sections)
            groups[tuple(fresh)].append((sweep, fresh))
    for paths, found in groups.items():
        texts = [known.difference_text(path, [fresh[path] for _, fresh in found], found[0][0]) for path in paths]
        reason = ", ".join(texts) or "its values are stored, but not together"
        each = {
            sweep.key: ", ".join(known.difference_text(path, [value], sweep) for path, value in fresh.items())
            for sweep, fresh in found
            if fresh
        }
        yield Why(True, "new", f"{reason} (in run {run.number})", [sweep for sweep, _ in found], each, paths)


class _StoredValues:
    """All values that stored sweeps have, by path."""

    def __init__(self, stored: Sequence[StoredSweep], registry: Registry) -> None:
        self._registry = registry
        self._known: dict[str, dict[str, Any]] = defaultdict(dict)
        sections = {id(section): (name, section) for of in stored for name, section in of.sections.items()}
        for name, section in sections.values():  # which sweeps share
            self._add(name, section)

    def _add(self, path: str, data: Any) -> None:
        if isinstance(data, Mapping):
            for key, value in data.items():
                self._add(f"{path}.{key}", value)
        else:
            self._known[path][canonical(data)] = data

    def fresh_values(self, data: Plain, path: str = "") -> dict[str, Any]:
        """Return the values that no stored sweep has, by path; of a component that none has its name alone."""
        found: dict[str, Any] = {}
        for key, value in data.items():
            at = f"{path}.{key}" if path else key
            if isinstance(value, Mapping):
                found |= self.fresh_values(value, at)
            elif canonical(value) not in self._known.get(at, ()):
                if key == "name":
                    return {at: value}
                found[at] = value
        return found

    def difference_text(self, path: str, now: Sequence[Any], sweep: Sweep) -> str:
        """Return new values of a path beside the stored ones."""
        unit = unit_at(sweep.sections, path, self._registry)
        then = list(self._known[path].values()) if path in self._known else [None]
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
