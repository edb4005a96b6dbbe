"""Checks of every component: what it says about itself, and that it is plain data."""

import inspect
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import get_args

from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, nested_kind
from fraexp.components.parameters import TYPICAL, Parameters, unit_of
from fraexp.components.providers import Provider, Providers
from fraexp.components.registry import Registry
from fraexp.data import units as unit_texts
from fraexp.errors import FraexpError
from fraexp.testing.conformance_check import require
from fraexp.testing.examples import installed_components

SOURCE = re.compile(
    r"10\.\d{4,9}/\S"  # a DOI
    r"|\beqs?\.? ?\(?\d"  # an equation
    r"|\bpaper(,|'s) (eqs?|Fig|Table|section)\b"
    r"|\b(1[5-9]|20)\d\d\b"  # a name in the literature with its year
)


def units(component: type[Component]) -> None:
    """Every parameter has a description, and every number a known unit ("1" for a pure number)."""
    for place, info in _parameter_fields(component, component.name):
        require(info.description, f"{place} has no description")
        if nested_kind(info) is None and {float, int} & set(_nested_annotations(info.annotation)):
            require(unit_of(info), f"{place} has no unit")
            if unit_of(info) not in ("1", *TYPICAL):  # the others are looked up among all units that there are
                scale, name = unit_texts.si(unit_of(info))
                require(scale == 1, f"{place} is in {unit_of(info)}; expected an SI unit, such as {name}")


def source(component: type[Component]) -> None:
    """The docstring cites the source of the component: a DOI, an equation, or a name with its year."""
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


def plain_data(model: Component) -> None:
    """Name, version and parameters recreate an equal component, also through JSON."""
    spec = model.spec()
    again = registry_with(type(model)).create(model.kind, json.loads(json.dumps(spec)))
    require(dict(again) == dict(model), f"{_difference_text(spec, again.spec())} after a round trip through plain data")
    require(again.spec() == spec, f"{_difference_text(spec, again.spec())} after a round trip through plain data")


def registry_with(component: type[Component]) -> Registry:
    """Return all installed components and this one, which need not be installed."""
    provider = Provider(component, Path(inspect.getfile(component)), "under test")
    return Registry(Providers({**installed_components().providers, (component.kind, component.name): provider}))


def _difference_text(first: Mapping[str, object], second: Mapping[str, object]) -> str:
    for key, value in first.items():
        if value != second.get(key):
            return f"{key} is {second.get(key)!r}, was {value!r}"
    return "something other than a parameter differs"


def _parameter_fields(owner: type[Parameters], path: str) -> Iterator[tuple[str, FieldInfo]]:
    """Yield all parameters with their place, those of nested groups included."""
    for name, info in owner.model_fields.items():
        yield f"{path}.{name}", info
        for part in _nested_annotations(info.annotation):
            if inspect.isclass(part) and issubclass(part, Parameters) and not issubclass(part, Component):
                yield from _parameter_fields(part, f"{path}.{name}")


def _nested_annotations(annotation: object) -> list[object]:
    """Return an annotation and all that it is made of."""
    return [annotation, *(inner for part in get_args(annotation) for inner in _nested_annotations(part))]
