"""The resolved parameters of a sweep, each with its unit, its meaning and where its value is from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fraexp.components.parameters import inherited_from, unit_of
from fraexp.components.registry import Registry
from fraexp.errors import StudyError
from fraexp.store import StoredSweep
from fraexp.study.paths import declared_at, value_at
from fraexp.views.words import flat, value_text, without_segments


@dataclass(frozen=True)
class Resolved:
    """A parameter as a sweep has it."""

    path: str
    value: str
    unit: str
    origin: str
    """``grid``, ``study``, ``default``, or the path from which the value is inherited; empty where it is not known."""
    meaning: str


def resolved_parameters(sweep: StoredSweep, registry: Registry) -> list[Resolved]:
    """Return all parameters of a sweep in the order of its experiment, the estimator last."""
    sections = {**sweep.experiment, "estimator": sweep.estimator}
    shown = flat({**without_segments(sweep.experiment), "estimator": sweep.estimator})
    return [_resolved(path, value, sections, sweep, registry) for path, value in shown.items() if not _version(path)]


def _version(path: str) -> bool:
    return path.endswith(".version")


def _resolved(path: str, value: Any, sections: Mapping[str, Any], sweep: StoredSweep, registry: Registry) -> Resolved:
    owner, _, last = path.rpartition(".")
    if last == "name" and owner:
        return _component(owner, sections, sweep, registry)
    try:
        info = declared_at(sections, path, registry)
    except (ValueError, IndexError):  # a record's section has a shape of its own
        info = None
    if info is None:
        return Resolved(path, value_text(value), "", "grid" if _in_grid(path, sweep) else "", "")
    unit = unit_of(info)
    origin = "grid" if _in_grid(path, sweep) else "study"
    inherited = inherited_from(info)
    if origin == "study" and inherited and _value(sections, inherited) == value:
        origin = inherited
    elif origin == "study" and not info.is_required() and _default(info) == value:
        origin = "default"
    return Resolved(path, value_text(value), "" if unit == "1" else unit, origin, info.description or "")


def _component(path: str, sections: Mapping[str, Any], sweep: StoredSweep, registry: Registry) -> Resolved:
    """Return the row of a component: its name and version, and what it is."""
    spec = _value(sections, path)
    name, version = spec.get("name"), spec.get("version")
    found = [supply.component for (_, of), supply in registry.supplies.items() if of == name]
    meaning = (found[0].__doc__ or "").strip().partition("\n")[0] if len(found) == 1 else ""
    text = f"{name}, version {version}" if version else str(name)
    return Resolved(path, text, "", "grid" if _in_grid(f"{path}.name", sweep) else "study", meaning)


def _in_grid(path: str, sweep: StoredSweep) -> bool:
    for label, value in sweep.labels.items():
        if path == label or (path.startswith(f"{label}.") and not isinstance(value, Mapping)):
            return True
        if isinstance(value, Mapping) and path.startswith(f"{label}."):
            return path.removeprefix(f"{label}.").split(".")[0] in value
    return False


def _value(sections: Mapping[str, Any], path: str) -> Any:
    try:
        return value_at(sections, path)
    except StudyError:
        return None


def _default(info: Any) -> Any:
    default = info.get_default(call_default_factory=True, validated_data={})
    return list(default) if isinstance(default, tuple) else default
