"""Dotted paths into the sections of an experiment, such as ``plant.frequencies.0``: what is there, its unit, a copy."""

import inspect
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

from pydantic.fields import FieldInfo

from fraexp.components.kinds import KINDS_BY_PORT, nested_kind
from fraexp.components.parameters import Parameters, unit_of
from fraexp.components.position_dependence import positioned_class
from fraexp.components.registry import Registry
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import Plain, components_by_port
from fraexp.errors import StudyError, did_you_mean
from fraexp.simulation.experiments import Compensation
from fraexp.simulation.machine import ControlLoop, Numerics
from fraexp.study.accuracy import Accuracy

SETTINGS: dict[str, type[Parameters]] = {
    "loop": ControlLoop,
    "numerics": Numerics,
    "compensation": Compensation,
    "accuracy": Accuracy,
}
"""Sections that are no components."""
Owner = type[Parameters] | None
"""What declares the parameters at a place; None where that is not known."""


def value_at(sections: Mapping[str, Any], path: str) -> Any:
    """Return what is at a path; StudyError tells how far it leads."""
    value: Any = sections
    for depth, part in enumerate(parts := path.split(".")):
        here = ".".join(parts[:depth]) or "the experiment"
        if isinstance(value, list):
            if not part.isdecimal() or int(part) >= len(value):
                raise StudyError(
                    f"'{path}' leads nowhere: {here} has {len(value)} values, which are counted from 0; "
                    f"expected a number below {len(value)} in place of '{part}'"
                )
            value = value[int(part)]
        elif isinstance(value, Mapping) and part in value:
            value = value[part]
        else:
            options = list(value) if isinstance(value, Mapping) else []
            raise StudyError(f"'{path}' leads nowhere: {here} has no '{part}'{did_you_mean(part, options)}")
    return value


def replace_at(data: Any, parts: Sequence[str], value: Any) -> Any:
    """Return plain data with another value at a path that is there; what lies beside the path is shared."""
    if not parts:
        return value
    head, *rest = parts
    if isinstance(data, list):
        index = int(head)
        return [*data[:index], replace_at(data[index], rest, value), *data[index + 1 :]]
    return {**data, head: replace_at(data[head], rest, value)}


def unit_at(sections: Mapping[str, Any], path: str, registry: Registry) -> str:
    """Return the unit that is declared for what is at a path; empty where there is none, or nothing."""
    info = declared_at(sections, path, registry)
    return unit_of(info, rotary=is_rotary(sections)) if info else ""


def label_units(sweeps: Iterable[tuple[Plain, Plain]], registry: Registry) -> dict[str, str]:
    """Return the unit of each label, such as ``excitation.amplitude``, that has one.

    Each sweep is given by its labels and its sections: its experiment, and its estimator under ``estimator``.
    """
    having = {path: sections for labels, sections in sweeps for path in labels}
    units = {path: unit_at(sections, path, registry) for path, sections in having.items()}
    return {path: unit for path, unit in units.items() if unit not in ("", "1")}


def declared_at(sections: Mapping[str, Any], path: str, registry: Registry) -> FieldInfo | None:
    """Return how the parameter at a path is declared; None where that is not known."""
    section, parts, value = _descend(sections, path)
    owner = SETTINGS.get(section) or component_of(section, value, registry)
    info: FieldInfo | None = None
    for part in parts:
        if isinstance(value, list):  # whose unit is that of its values
            value = value[int(part)] if part.isdecimal() and int(part) < len(value) else None
        else:
            info = owner.model_fields.get(part) if owner else None
            value = value.get(part) if isinstance(value, Mapping) else None
        owner = _owner(info, value, registry)
    return info


def _descend(sections: Mapping[str, Any], path: str) -> tuple[str, list[str], Any]:
    """Return a path's section, the parts below the component that stands there, and this component in plain data."""
    section, *parts = path.split(".")
    value = sections.get(section)
    models = components_by_port(value) if section in KINDS_BY_PORT else {}
    return (section, parts[1:], models[parts[0]]) if parts and parts[0] in models else (section, parts, value)


def _owner(info: FieldInfo | None, value: Any, registry: Registry) -> Owner:
    if info is None or not isinstance(value, Mapping):
        return None
    kind = nested_kind(info)
    if kind is not None:
        return component_of(kind.kind, value, registry)
    return next(iter(parameters_in(info)), None)


def component_of(kind: str, spec: Any, registry: Registry) -> Owner:
    """Return the component class that plain data name; None if they name none, or an unknown one."""
    provider = registry.providers.get((kind, str(spec.get("name")))) if isinstance(spec, Mapping) else None
    return positioned_class(provider.component, spec) if provider else None


def units_of(path: str, registry: Registry) -> dict[str, set[str]]:
    """Return the units that a parameter can have on a straight axis, by the component whose path it is.

    The name is empty for a section that is no component. A component without this parameter, or that declares it
    without a unit, is left out.
    """
    section, *parts = path.split(".")
    owners = {"": SETTINGS[section]} if section in SETTINGS else _components_of_kind(section, registry)
    units = {name: _units_below(owner, parts, registry) for name, owner in owners.items()}
    return {name: found for name, found in units.items() if found}


def _units_below(owner: type[Parameters], parts: Sequence[str], registry: Registry) -> set[str]:
    """Return the units that are declared for a parameter of a component, or of a component inside it."""
    owners, found = [owner], list[FieldInfo]()
    for part in parts:
        if not part.isdecimal():  # the unit of a list is that of its values
            found = [one.model_fields[part] for one in owners if part in one.model_fields]
            owners = [inner for info in found for inner in _owners(info, registry)]
    units = {unit_of(info) for info in found}
    return set() if "" in units else units


def _owners(info: FieldInfo, registry: Registry) -> list[type[Parameters]]:
    kind = nested_kind(info)
    return list(_components_of_kind(kind.kind, registry).values()) if kind else parameters_in(info)


def parameters_in(info: FieldInfo) -> list[type[Parameters]]:
    """Return the classes of parameters that a parameter's own type names, such as that of a table in a list."""
    candidates = (info.annotation, *get_args(info.annotation))
    return [of for of in candidates if inspect.isclass(of) and issubclass(of, Parameters)]


def _components_of_kind(kind: str, registry: Registry) -> dict[str, type[Parameters]]:
    return {name: provider.component for (of, name), provider in registry.providers.items() if of == kind}
