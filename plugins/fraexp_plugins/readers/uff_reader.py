"""Universal files of structural dynamics, dataset 58: functions over time or frequency."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import check_size, format_errors, load_package, only_one, pick_columns
from fraexp_plugins.readers._shared.text_lines import unique_names

UNITS_DATASET, FUNCTION_DATASET = 164, 58
FUNCTIONS = {
    0: "general", 1: "signal", 2: "autospectrum", 3: "crossspectrum", 4: "response", 6: "coherence", 9: "psd",
    12: "spectrum",
}  # fmt: skip
"""Names of the function types of the format."""
DIRECTIONS = {0: "", 1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}
EVEN_TOLERANCE = 1e-6
QUANTITIES = {8: "length", 9: "force", 11: "length/s", 12: "length/s^2", 13: "force"}
"""Quantities of axes in dataset 58, by their types: displacement, reaction force, velocity, acceleration, force."""
UNITS = {
    "length": {1.0: "m", 100.0: "cm", 1e3: "mm", 39.37: "in", 3.2808: "ft"},
    "force": {1.0: "N", 1e-3: "kN", 0.22481: "lbf", 0.10197: "kgf"},
}
"""Units by the factors of dataset 164, by which numbers are divided to be in SI units."""
FACTOR_TOLERANCE = 1e-3
"""Relative: programs print the factors with few digits."""


class UffReader(RecordReader, name="uff", version=1):
    """A universal file; each dataset 58 is a column such as ``response_1Z_1Z``, by type, response and reference node.

    Of a complex one there are ``.real`` and ``.imaginary``; ``frequency`` is its abscissa. A function over time brings
    its sample time. Equal names are numbered: ``signal_1Z #2``.
    """

    suffixes = (".uff", ".unv", ".uf", ".bunv")

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        found = pick_columns(path, columns, _functions(path))
        units = {column: unit for column, (_, unit, _) in found.items()}
        values = {column: values for column, (values, _, _) in found.items()}
        return RecordTable(values, only_one(step for _, _, step in found.values()), units)

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every column, by name."""
        return {name: (values.shape, unit) for name, (values, unit, _) in _functions(path).items()}


Function = tuple[NDArray[np.float64], str, float | None]
"""Values, unit and sample time [s]."""


def _functions(path: Path) -> dict[str, Function]:
    check_size(path, "the file", path.stat().st_size)
    pyuff = load_package(path, "pyuff", "uff")
    with format_errors(path, "a universal file"):
        file = pyuff.UFF(str(path))
        units: dict[str, Any] = {}
        sets: list[dict[str, Any]] = []
        for number, kind in enumerate(map(int, file.get_set_types())):
            if kind == UNITS_DATASET:  # of the functions behind it
                units = file.read_sets(number)
            elif kind == FUNCTION_DATASET:
                sets.append({**file.read_sets(number), "units": units})
    if not sets:
        raise RecordError(f"{path.name}: it has no dataset 58; expected functions over time or frequency")
    found: dict[str, Function] = {}
    for name, one in zip(unique_names([_name(one) for one in sets]), sets, strict=True):
        stated, size = int(one["num_pts"]), np.size(one["data"])
        if size != stated:
            raise RecordError(
                f"{path.name}: '{name}' has {size} points, and its header states {stated}; export the file again, or "
                "correct the header"
            )
        found |= _columns(name, one)
    return found


def _name(one: dict[str, Any]) -> str:
    kind = FUNCTIONS.get(int(one.get("func_type", 0)), f"type{one.get('func_type')}")
    response = f"{one.get('rsp_node', 0)}{DIRECTIONS.get(abs(int(one.get('rsp_dir', 0))), '')}"
    if kind == "signal":
        return f"{kind}_{response}"
    return f"{kind}_{response}_{one.get('ref_node', 0)}{DIRECTIONS.get(abs(int(one.get('ref_dir', 0))), '')}"


def _columns(name: str, one: dict[str, Any]) -> dict[str, Function]:
    x, data = np.asarray(one["x"], dtype=float), np.asarray(one["data"])
    label = str(one.get("ordinate_axis_units_lab", "") or "").strip()
    unit = label if label.upper() not in ("NONE", "") else _unit_by_factors(one)
    steps = np.diff(x)
    even = steps.size > 0 and float(np.ptp(steps)) <= EVEN_TOLERANCE * abs(float(steps[0])) and steps[0] > 0
    if int(one.get("func_type", 0)) == 1:
        return {name: (np.asarray(data.real, dtype=float), unit, float(steps.mean()) if even else None)}
    found: dict[str, Function] = {"frequency": (x, "Hz", None)}
    if np.iscomplexobj(data):
        return {
            **found,
            f"{name}.real": (np.ascontiguousarray(data.real), unit, None),
            f"{name}.imaginary": (np.ascontiguousarray(data.imag), unit, None),
        }
    return {**found, name: (np.asarray(data, dtype=float), unit, None)}


def _unit_by_factors(one: dict[str, Any]) -> str:
    """Return the unit that the factors of dataset 164 give a function; empty if there are none, or they are unknown."""
    unit, over = _quantity(one, "ordinate", "rsp_dir"), _quantity(one, "orddenom", "ref_dir")
    return unit if int(one.get("func_type", 0)) == 1 else f"{unit}/{over}" * bool(unit and over)


def _quantity(one: dict[str, Any], axis: str, direction: str) -> str:
    """Return the unit of a translation or a force along an axis of the function."""
    name = QUANTITIES.get(int(one.get(f"{axis}_spec_data_type", 0)), "") * (abs(int(one.get(direction, 0))) <= 3)
    quantity = name.partition("/")[0]
    factor, known = one["units"].get(quantity, math.nan), UNITS.get(quantity, {})
    units = (unit for of, unit in known.items() if math.isclose(of, factor, rel_tol=FACTOR_TOLERANCE))
    return next((name.replace(quantity, unit) for unit in units), "")
