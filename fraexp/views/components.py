"""Components as plugins declare them: plain data, and a row of text for each parameter."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic.fields import FieldInfo

from fraexp.components.kinds import KINDS
from fraexp.components.parameters import inherited_from, unit_of
from fraexp.components.registry import Provider, Registry
from fraexp.views.words import plural, value_text

BOUND_SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


@dataclass(frozen=True)
class Offer:
    """A component that plugins provide, or a plugin that fails to load."""

    kind: str
    name: str
    version: str
    origin: str
    """The file in the workspace, or name and version of the installed package."""
    reason: str = ""
    """Why it cannot be used; empty if it can."""
    provider: Provider | None = None

    def uses(self, sources: Mapping[str, Mapping[str, int]]) -> tuple[int, int]:
        """Return how many stored sweeps used it, and how many of them with a different source."""
        found = sources.get(f"{self.kind}:{self.name}", {}) if self.provider else {}
        now = found.get(self.provider.source_hash, 0) if self.provider else 0
        return sum(found.values()), sum(found.values()) - now

    def state(self, sources: Mapping[str, Mapping[str, int]]) -> str:
        """Return its state in words."""
        stale = self.uses(sources)[1]
        return "broken" if self.reason else f"ok, {stale} stale" if stale else "ok"


def list_offers(registry: Registry) -> list[Offer]:
    """Return the broken plugins, then all components: friction first, by name."""
    order = [str(kind.kind) for kind in KINDS]
    broken = [Offer("broken", _file_name(of.place), "", of.place, of.reason) for of in registry.failures]
    known = sorted(registry.providers, key=lambda key: (order.index(key[0]), key[1]))
    return [*broken, *(_offer(registry.providers[key], registry.clashes.get(key, "")) for key in known)]


def _offer(provider: Provider, clash: str) -> Offer:
    component = provider.component
    origin = f"plugins/{provider.file.name}" if provider.distribution == "workspace" else provider.distribution
    return Offer(component.kind, component.name, str(component.version), origin, clash, provider)


def _file_name(place: str) -> str:
    return place.replace("\\", "/").rpartition("/")[2]


def usage_text(used: int, stale: int) -> str:
    """Return in words how many stored sweeps used a component."""
    what = f"used by {plural(used, 'stored sweep')}" if used else "used by no stored sweep"
    return (
        f"{what}, {stale} of them with a different source; fraexp run STUDY --rerun stale computes them again"
        if stale
        else what
    )


def component_document(provider: Provider) -> dict[str, Any]:
    """Return a component with its parameters: required ones first, then its own, then those that it inherits."""
    component = provider.component
    own = vars(component).get("__annotations__", {})
    parameters = [parameter_document(name, info) for name, info in component.model_fields.items()]
    parameters.sort(key=lambda parameter: (not parameter["required"], parameter["name"] not in own))
    return {
        "kind": component.kind,
        "name": component.name,
        "version": component.version,
        "meaning": (component.__doc__ or "").strip().partition("\n")[0],
        "distribution": provider.distribution,
        "file": str(provider.file),
        "parameters": parameters,
    }


def parameter_document(name: str, info: FieldInfo, *, rotary: bool = False) -> dict[str, Any]:
    """Return a parameter as it was declared, or as it is for a rotary axis."""
    bounds = {word: getattr(item, word) for item in info.metadata for word in BOUND_SIGNS if hasattr(item, word)}
    return {
        "name": name,
        "unit": unit_of(info, rotary=rotary),
        "meaning": info.description or "",
        "required": info.is_required() and inherited_from(info) is None,
        "default": None if info.is_required() else _plain_default(info),
        "inherited_from": inherited_from(info),
        "bounds": {BOUND_SIGNS[word]: value for word, value in bounds.items()},
    }


def _plain_default(info: FieldInfo) -> object:
    default = info.get_default(call_default_factory=True, validated_data={})
    if isinstance(default, tuple):
        return list(default)
    return default if isinstance(default, int | float | str | bool | None) else str(default)


def parameter_row(parameter: dict[str, Any]) -> list[str]:
    """Return name, unit, default, bounds and meaning of a parameter."""
    default = "required" if parameter["required"] else value_text(parameter["default"])
    if parameter["inherited_from"]:
        default = f"from {parameter['inherited_from']}"
    bounds = ", ".join(f"{sign} {value:g}" for sign, value in parameter["bounds"].items())
    return [f"  {parameter['name']}", parameter["unit"], default, bounds, parameter["meaning"]]
