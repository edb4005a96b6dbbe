"""The resolved parameters of a sweep, each with unit, meaning and the origin of its value."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fraexp.components.parameters import inherited_from, unit_of
from fraexp.components.registry import Registry
from fraexp.data.rotary_axes import is_rotary
from fraexp.errors import StudyError
from fraexp.store import StoredSweep
from fraexp.study.paths import declared_at, value_at
from fraexp.views.words import flatten, scale_values, summarise_segments, value_text, with_unit


@dataclass(frozen=True)
class ResolvedParameter:
    """A resolved parameter of a sweep."""

    path: str
    value: str
    unit: str
    origin: str
    """``grid``, ``study``, ``default``, or the path from which the value is inherited; empty where it is not known."""
    meaning: str

    @property
    def quantity(self) -> str:
        """Value with unit."""
        return with_unit(self.value, self.unit)


def resolved_parameters(sweep: StoredSweep, registry: Registry) -> list[ResolvedParameter]:
    """Return all parameters of a sweep in the order of its experiment, the estimator last."""
    sections = sweep.sections
    shown = flatten({**summarise_segments(sweep.experiment), "estimator": sweep.estimator})
    named = [(path, value) for path, value in shown.items() if not path.endswith(".version")]
    return [_resolve(path, value, sections, sweep, registry) for path, value in named]


def _resolve(
    path: str, value: object, sections: Mapping[str, object], sweep: StoredSweep, registry: Registry
) -> ResolvedParameter:
    owner, _, last = path.rpartition(".")
    if last == "name" and owner:
        return _resolve_component(owner, sections, sweep, registry)
    try:
        info = declared_at(sections, path, registry)
    except (ValueError, IndexError):  # the section of a record has a different structure
        info = None
    if info is None:
        return ResolvedParameter(path, value_text(value), "", "grid" if _is_in_grid(path, sweep) else "", "")
    unit = unit_of(info, rotary=is_rotary(sections))
    origin = "grid" if _is_in_grid(path, sweep) else "study"
    inherited = inherited_from(info)
    if origin == "study" and inherited and _value(sections, inherited) == value:
        origin = inherited
    elif origin == "study" and not info.is_required() and _default(info) == value:
        origin = "default"
    (scaled,), shown = scale_values([value], unit)
    return ResolvedParameter(path, value_text(scaled), shown, origin, info.description or "")


def _resolve_component(
    path: str, sections: Mapping[str, object], sweep: StoredSweep, registry: Registry
) -> ResolvedParameter:
    """Return the row of a component: name, version and meaning."""
    spec = _value(sections, path)
    name, version = spec.get("name"), spec.get("version")
    found = [provider.component for (_, of), provider in registry.providers.items() if of == name]
    meaning = (found[0].__doc__ or "").strip().partition("\n")[0] if len(found) == 1 else ""
    text = f"{name}, version {version}" if version else str(name)
    return ResolvedParameter(path, text, "", "grid" if _is_in_grid(f"{path}.name", sweep) else "study", meaning)


def _is_in_grid(path: str, sweep: StoredSweep) -> bool:
    for label, value in sweep.labels.items():
        if path == label or (path.startswith(f"{label}.") and not isinstance(value, Mapping)):
            return True
        if isinstance(value, Mapping) and path.startswith(f"{label}."):
            return path.removeprefix(f"{label}.").split(".")[0] in value
    return False


def _value(sections: Mapping[str, object], path: str) -> Any:
    try:
        return value_at(sections, path)
    except StudyError:
        return None


def _default(info: Any) -> Any:
    default = info.get_default(call_default_factory=True, validated_data={})
    return list(default) if isinstance(default, tuple) else default
