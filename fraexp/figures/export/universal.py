"""Export to universal files: dataset 58, function at a nodal degree of freedom."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Curve, FrequencyResponse, Result
from fraexp.errors import FraexpError
from fraexp.figures.export.content import Header, one_line

MIN_POINTS = 2
"""Least number of points: an abscissa of one point has no spacing."""


def write_universal(result: Result, header: Header, path: Path) -> None:
    """Write the response, its frequencies and standard deviation, or else the curves."""
    try:
        import pyuff
    except ImportError:
        raise FraexpError(
            "a .unv file needs the package pyuff; pip install 'fraexp[uff]', or export to .json"
        ) from None
    title = one_line(header.get("title", header.get("study", "fraexp")))[:72]
    sets = _response_sets(result.response, title) if result.response is not None else _curve_sets(result.curves, title)
    if not sets or any(len(one["data"]) < MIN_POINTS for one in sets):
        raise FraexpError(f"a .unv file holds responses and curves of at least {MIN_POINTS} points; export to .json")
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")


def _response_sets(response: FrequencyResponse, title: str) -> list[dict[str, Any]]:
    """Return the response over uneven frequencies, and frequency and standard deviation as records of their own.

    ASCII in double precision carries ordinates to 12 digits, but an uneven abscissa to 6 only: hence the frequency
    is repeated as an ordinate over its number.
    """
    name = f"{response.output}/{response.input}"
    number = np.arange(1.0, response.frequency.size + 1)
    response_set = _dataset(response.frequency, response.response, "Hz", response.unit, (title, name), func_type=4)
    frequency_set = _dataset(number, response.frequency, "", "Hz", (title, f"frequency of {name}"))
    known = np.isfinite(response.standard_deviation).all()
    spread = _dataset(number, response.standard_deviation, "", response.unit, (title, f"standard deviation of {name}"))
    return [response_set, frequency_set, *([spread] if known else [])]


def _curve_sets(curves: Iterable[Curve], title: str) -> list[dict[str, Any]]:
    """Return each column of each curve over its number: a loop's abscissa does not ascend."""
    return [
        _dataset(
            np.arange(1.0, values.size + 1), values, "", curve.units.get(name, ""), (title, f"{curve.name}: {name}")
        )
        for curve in curves
        for name, values in curve.columns.items()
    ]


def _dataset(
    abscissa: NDArray[np.float64],
    ordinate: NDArray[np.float64] | NDArray[np.complex128],
    unit_x: str,
    unit_y: str,
    titles: tuple[str, str],
    func_type: int = 0,
) -> dict[str, Any]:
    frequency = func_type == 4
    return {
        "type": 58,
        "func_type": func_type,
        "id1": titles[0][:80],
        "id2": titles[1][:80],
        "rsp_node": 1,
        "rsp_dir": 0,
        "ref_node": 1,
        "ref_dir": 0,
        "x": abscissa,
        "data": ordinate if np.iscomplexobj(ordinate) else np.asarray(ordinate, dtype=float),
        "abscissa_spacing": 0 if frequency else 1,
        "abscissa_spec_data_type": 18 if frequency else 0,  # 18: frequency
        "orddenom_spec_data_type": 0,
        "abscissa_axis_units_lab": unit_x[:20] or "NONE",
        "ordinate_axis_units_lab": unit_y[:20] or "NONE",
    }
