"""Units of the grid's values, from the components that declare them."""

from collections.abc import Iterable, Mapping
from typing import Any

from fraexp.parameters import unit_of
from fraexp.plugins import Registry


def label_units(sweeps: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]], registry: Registry) -> dict[str, str]:
    """Return the unit of each label, such as ``excitation.amplitude``, that has one.

    Each sweep is given by its labels and its sections: its experiment, and its estimator under ``estimator``.
    """
    units = {path: _unit(path, sections, registry) for labels, sections in sweeps for path in labels}
    return {path: unit for path, unit in units.items() if unit not in ("", "1")}


def _unit(path: str, sections: Mapping[str, Any], registry: Registry) -> str:
    """Return the unit that the innermost component on the path declares; empty if there is none."""
    *parents, name = path.split(".")
    spec: Any = sections
    for part in parents:
        spec = spec.get(part) if isinstance(spec, Mapping) else None
    supply = (
        registry.supplies.get((parents[-1], spec.get("name", ""))) if parents and isinstance(spec, Mapping) else None
    )
    info = supply.component.model_fields.get(name) if supply else None
    return unit_of(info) if info else ""
