"""Units of labels, which the components declare."""

from collections.abc import Iterable

from fraexp.components.registry import Registry
from fraexp.data.sweep import Plain
from fraexp.study.paths import unit_at


def label_units(sweeps: Iterable[tuple[Plain, Plain]], registry: Registry) -> dict[str, str]:
    """Return the unit of each label, such as ``excitation.amplitude``, that has one.

    Each sweep is given by its labels and its sections: its experiment, and its estimator under ``estimator``.
    """
    having = {path: sections for labels, sections in sweeps for path in labels}
    units = {path: unit_at(sections, path, registry) for path, sections in having.items()}
    return {path: unit for path, unit in units.items() if unit not in ("", "1")}
