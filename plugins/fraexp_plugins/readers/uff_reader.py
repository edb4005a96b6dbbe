"""Universal files of structural dynamics, dataset 58: functions over time or frequency."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import check_size, format_errors, load_package, only_one, pick_columns
from fraexp_plugins.readers._shared.text_lines import unique_names

FUNCTION_DATASET = 58
FUNCTIONS = {
    0: "general", 1: "signal", 2: "autospectrum", 3: "crossspectrum", 4: "response", 6: "coherence", 9: "psd",
    12: "spectrum",
}  # fmt: skip
"""Names of the function types of the format."""
DIRECTIONS = {0: "", 1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}
EVEN_TOLERANCE = 1e-6


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
        numbers = [n for n, kind in enumerate(file.get_set_types()) if int(kind) == FUNCTION_DATASET]
        sets = [file.read_sets(number) for number in numbers]
    if not sets:
        raise RecordError(f"{path.name}: it has no dataset 58; expected functions over time or frequency")
    found: dict[str, Function] = {}
    for name, one in zip(unique_names([_name(one) for one in sets]), sets, strict=True):
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
    unit = str(one.get("ordinate_axis_units_lab", "") or "").strip()
    unit = "" if unit.upper() in ("NONE", "") else unit
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
