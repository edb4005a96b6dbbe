"""Units of the grid's values, from the components that declare them."""

from collections.abc import Iterable, Mapping
from typing import Any

from fraexp.components.registry import Registry
from fraexp.study.paths import unit_at


def label_units(sweeps: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]], registry: Registry) -> dict[str, str]:
    """Return the unit of each label, such as ``excitation.amplitude``, that has one.

    Each sweep is given by its labels and its sections: its experiment, and its estimator under ``estimator``.
    """
    units = {path: unit_at(sections, path, registry) for labels, sections in sweeps for path in labels}
    return {path: unit for path, unit in units.items() if unit not in ("", "1")}
