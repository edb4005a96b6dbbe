"""Conversion of results to rows and back; arrays are .npy bytes, which cannot contain code."""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fraexp.data.findings import Finding
from fraexp.data.results import Curve, Fit, FrequencyResponse, Metric, Outcome, Result
from fraexp.errors import StoreError
from fraexp.store.tables import RESPONSE_ARRAYS, RowValues, TableRow
from fraexp.store.validation import DamagedError, check_types

NUMBER_KINDS = "biufc"
"""Kinds of numpy types that are numbers."""
NPY_MAGIC = b"\x93NUMPY\x01\x00"
RECOMPUTE_HINT = "compute the sweep again with --rerun all"
NPY_PREFIX_BYTES = 10
"""Length of the .npy format's prefix: magic, version, and the length of the header in the last two bytes."""


def encode_array(array: ArrayLike, what: str, dtype: type | None = None) -> bytes:
    """Return an array as .npy bytes, converted to `dtype` if that is lossless; StoreError mentions `what`."""
    values = np.asarray(array)
    if values.dtype.hasobject:
        raise StoreError(f"{what} contains Python objects; expected an array of numbers")
    if dtype is not None:
        if not np.can_cast(values.dtype, dtype, "same_kind"):
            raise StoreError(f"{what} is an array of {values.dtype}; expected {np.dtype(dtype)}")
        values = values.astype(dtype, copy=False)
    values = np.ascontiguousarray(values).reshape(values.shape)
    # The header of numpy without the padding for growing files, which is half of a short array.
    layout = f"{{'descr':{values.dtype.str!r},'fortran_order':False,'shape':{values.shape}}}\n".encode()
    return NPY_MAGIC + len(layout).to_bytes(2, "little") + layout + values.tobytes()


def decode_array(data: bytes, key: str = "") -> NDArray[Any]:
    """Return the array in .npy bytes of a sweep; DamagedError if they are invalid."""
    try:
        begin = NPY_PREFIX_BYTES + int.from_bytes(data[NPY_PREFIX_BYTES - 2 : NPY_PREFIX_BYTES], "little")
        shape, dtype = _parse_header(data[:begin])
        array: NDArray[Any] = np.frombuffer(data, dtype, offset=begin).reshape(shape).copy()
    except Exception as error:  # numpy may raise anything for an invalid header
        raise DamagedError(key, f"a stored array is invalid ({error}); {RECOMPUTE_HINT}") from error
    return array


@lru_cache(256)
def _parse_header(header: bytes) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type in a header: thousands of arrays share one, and numpy parses slowly."""
    stream = io.BytesIO(header)
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"format {version}; expected (1, 0)")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if fortran or dtype.kind not in NUMBER_KINDS or min(shape, default=0) < 0:
        raise ValueError("an array of Python objects, or in column order; expected numbers in row order")
    return shape, dtype


def response_rows(key: str, response: FrequencyResponse | None) -> list[RowValues]:
    """Return the row of a frequency response as a list; empty without a response."""
    if response is None:
        return []
    row = {item.name: getattr(response, item.name) for item in fields(response)}
    for name, of in RESPONSE_ARRAYS.items():
        if not of.is_optional or row[name] is not None:
            row[name] = encode_array(row[name], f"the response's {name}", of.dtype)
    return [{"key": key, "points": len(response.frequency), **row}]


def parse_response(row: TableRow) -> FrequencyResponse:
    """Return the frequency response in a row."""
    values: RowValues = {name: row[name] for name in ("unit", "input", "output")}
    for name, of in RESPONSE_ARRAYS.items():
        if of.is_optional and row[name] is None:
            continue
        array = values[name] = decode_array(row[name], row["key"])
        points = values["frequency"].shape
        shape = (*points, *of.sides)
        if array.dtype != of.dtype or array.shape != shape or len(points) != 1:
            found, expected = f"{array.dtype} {array.shape}", f"{np.dtype(of.dtype)} {shape}"
            raise DamagedError(row["key"], f"a stored {name} is {found}; expected {expected}: {RECOMPUTE_HINT}")
    return check_types(FrequencyResponse(**values))


def metric_rows(key: str, metrics: Iterable[Metric]) -> list[RowValues]:
    """Return a row for each metric."""
    return [
        {"key": key, "position": position, "name": item.name, "value": float(item.value), "unit": item.unit}
        for position, item in enumerate(metrics)
    ]


def column_rows(key: str, curves: Iterable[Curve]) -> list[RowValues]:
    """Return a row for each column of each curve."""
    return [
        {
            "key": key,
            "curve": number,
            "position": position,
            "name": name,
            "unit": item.units.get(name),
            "samples": encode_array(samples, f"column '{name}' of curve '{item.name}'"),
        }
        for number, item in enumerate(curves)
        for position, (name, samples) in enumerate(item.columns.items())
    ]


def parse_curve(name: str, columns: Iterable[TableRow]) -> Curve:
    """Return the curve with a name and the rows of its columns, in their order."""
    rows = list(columns)
    units = {row["name"]: row["unit"] for row in rows if row["unit"] is not None}
    found = {row["name"]: decode_array(row["samples"], row["key"]) for row in rows}
    if not all(isinstance(text, str) for text in (*found, *units.values())):
        raise TypeError("a column's name or unit is not a text")
    return check_types(Curve(name, found, units))


def fit_rows(key: str, fits: Iterable[Fit]) -> list[RowValues]:
    """Return a row for each fit."""
    return [
        {
            "key": key,
            "position": position,
            "kind": item.kind,
            "component": dict(item.component),
            "parameters": list(item.parameters),
            "units": list(item.units),
            "values": encode_array(item.values, "the fit's values", np.float64),
            "covariance": encode_array(item.covariance, "the fit's covariance", np.float64),
        }
        for position, item in enumerate(fits)
    ]


def parse_fit(row: TableRow) -> Fit:
    """Return the fit in a row."""
    texts = (tuple(row["parameters"]), tuple(row["units"]))
    arrays = (decode_array(row[name], row["key"]) for name in ("values", "covariance"))
    found = Fit(row["kind"], row["component"], *texts, *arrays)
    count = len(found.parameters)
    if found.values.shape != (count,) or found.covariance.shape != (count, count) or len(found.units) != count:
        unlike = f"the stored fit of {found.kind!r} has different numbers of values and parameters; {RECOMPUTE_HINT}"
        raise DamagedError(row["key"], unlike)
    if not all(isinstance(text, str) for of in texts for text in of):
        raise TypeError("the name or unit of a fitted parameter is not a text")
    return check_types(found)


def parse_findings(stored: Iterable[TableRow]) -> tuple[Finding, ...]:
    """Return the findings in a sweep's row; those of a kind that this fraexp does not know are findings as well."""
    return tuple(check_types(Finding.from_plain(dict(data))) for data in stored)


def result_rows(key: str, result: Result) -> dict[str, list[RowValues]]:
    """Return the rows of a result by the name of their table, parents first."""
    return {
        "frequency_response": response_rows(key, result.response),
        "metric": metric_rows(key, result.metrics),
        "curve": [{"key": key, "position": at, "name": curve.name} for at, curve in enumerate(result.curves)],
        "curve_column": column_rows(key, result.curves),
        "fit": fit_rows(key, result.fits),
    }


def parse_result(state: TableRow, rows: Mapping[str, Sequence[TableRow]]) -> Result:
    """Return the result in the row of its sweep and the rows of its tables, by name."""
    columns = rows.get("curve_column", ())
    result = Result(
        Outcome[state["outcome"]],
        parse_findings(state["findings"]),
        next((parse_response(row) for row in rows.get("frequency_response", ())), None),
        tuple(check_types(Metric(row["name"], row["value"], row["unit"])) for row in rows.get("metric", ())),
        tuple(
            parse_curve(row["name"], [column for column in columns if column["curve"] == row["position"]])
            for row in rows.get("curve", ())
        ),
        tuple(parse_fit(row) for row in rows.get("fit", ())),
        numerics=state["numerics"],
        elapsed=state["elapsed"],
    )
    return check_types(result)
