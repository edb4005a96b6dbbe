"""Checks of every component: what it says about itself, and that it is plain data."""

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, nested_kind
from fraexp.components.parameters import TYPICAL, Parameters, unit_of
from fraexp.components.registry import Registry
from fraexp.components.supplies import Supplies, Supply
from fraexp.data import units as unit_texts
from fraexp.errors import FraexpError
from fraexp.testing.conformance_check import require
from fraexp.testing.examples import installed

SOURCE = re.compile(
    r"10\.\d{4,9}/\S"  # a DOI
    r"|\beqs?\.? ?\(?\d"  # an equation
    r"|\bpaper(,|'s) (eqs?|Fig|Table|section)\b"
    r"|\b(1[5-9]|20)\d\d\b"  # a name in the literature with its year
)


def units(component: type[Component]) -> None:
    """Every parameter has a meaning, and every number a unit that is known ("1" for a pure number)."""
    for place, info in _fields(component, component.name):
        require(info.description, f"{place} has no meaning")
        if nested_kind(info) is None and {float, int} & set(_flat(info.annotation)):
            require(unit_of(info), f"{place} has no unit")
            if unit_of(info) not in ("1", *TYPICAL):  # the others are looked up among all units that there are
                unit_texts.si(unit_of(info))


def source(component: type[Component]) -> None:
    """The docstring names where the component comes from: a DOI, an equation, or a name with its year."""
    texts = (component.__dict__.get("__doc__"), inspect.getmodule(component).__doc__)
    require(texts[0], f"{component.__name__} has no docstring")
    found = any(SOURCE.search(text or "") for text in texts)
    require(found, "no DOI (10.1109/...), no equation (eq 7), no name with its year (Dahl 1968)")


def presets(component: type[Component]) -> None:
    """Every preset is a complete set of parameters."""
    for name in component.presets:
        try:
            registry_with(component).create(component.kind, {"name": component.name, "preset": name})
        except FraexpError as error:
            require(False, f"preset {name}: {error}")


def plain_data(model: Any) -> None:
    """Name, version and parameters make an equal component again, also by way of JSON."""
    spec = model.spec()
    again = registry_with(type(model)).create(model.kind, json.loads(json.dumps(spec)))
    require(dict(again) == dict(model), f"{_difference(spec, again.spec())} after the way through plain data")
    require(again.spec() == spec, f"{_difference(spec, again.spec())} after the way through plain data")


def registry_with(component: type[Component]) -> Registry:
    """Return all installed components and this one, which need not be installed."""
    supply = Supply(component, Path(inspect.getfile(component)), "under test")
    return Registry(Supplies({**installed().supplies, (component.kind, component.name): supply}))


def _difference(first: dict[str, Any], second: dict[str, Any]) -> str:
    for key, value in first.items():
        if value != second.get(key):
            return f"{key} is {second.get(key)!r}, was {value!r}"
    return "something that is no parameter differs"


def _fields(owner: type[Parameters], path: str) -> Iterator[tuple[str, FieldInfo]]:
    """Yield all parameters with their place, those of nested groups included."""
    for name, info in owner.model_fields.items():
        yield f"{path}.{name}", info
        for part in _flat(info.annotation):
            if inspect.isclass(part) and issubclass(part, Parameters) and not issubclass(part, Component):
                yield from _fields(part, f"{path}.{name}")


def _flat(annotation: Any) -> list[Any]:
    return [annotation, *(inner for part in get_args(annotation) for inner in _flat(part))]
