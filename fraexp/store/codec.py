"""Results as rows and back; arrays as .npy bytes, in which no code can hide."""

import io
from collections.abc import Iterable, Mapping
from dataclasses import fields
from functools import lru_cache
from typing import Any

import numpy as np

from fraexp.data.results import Curve, Fit, FrequencyResponse, Metric, Result
from fraexp.errors import StoreError
from fraexp.store.validation import DamagedError, sound

DTYPES: dict[str, type] = {
    "frequency": np.float64,
    "response": np.complex128,
    "covariance": np.float64,
    "input_amplitude": np.float64,
    "output_amplitude": np.float64,
    "settled": np.bool_,
    "settling_time": np.float64,
    "residual": np.float64,
    "harmonics": np.complex128,
}
"""Type of each array of a frequency response."""
SIDES = {"covariance": (2, 2), "model_covariance": (2, 2), "harmonics": (6,)}
"""Sides of those that have more than one, beside the frequencies."""
OPTIONAL = ("freedom", "noise_variance", "nonlinear_variance", "coherence", "model_covariance")
"""Arrays of floats that a response may lack."""


NUMBERS = "biufc"
"""Kinds of types that are numbers."""
MAGIC = b"\x93NUMPY\x01\x00"
AGAIN = "compute the sweep again with --rerun all"
HEADER = 10
"""Bytes of the .npy format's first part: magic, version, and the length of the second in the last two."""


def encode(array: Any, what: str, dtype: type | None = None) -> bytes:
    """Return an array as .npy bytes, converted to `dtype` if that loses nothing; StoreError names `what`."""
    values = np.asarray(array)
    if values.dtype.hasobject:
        raise StoreError(f"{what} holds Python objects; expected an array of numbers")
    if dtype is not None:
        if not np.can_cast(values.dtype, dtype, "same_kind"):
            raise StoreError(f"{what} is an array of {values.dtype}; expected {np.dtype(dtype)}")
        values = values.astype(dtype, copy=False)
    values = np.ascontiguousarray(values).reshape(values.shape)
    # As numpy writes it, without the blanks that make room for files that grow: they are half of a short array.
    layout = f"{{'descr':{values.dtype.str!r},'fortran_order':False,'shape':{values.shape}}}\n".encode()
    return MAGIC + len(layout).to_bytes(2, "little") + layout + values.tobytes()


def decode(data: bytes, key: str = "") -> np.ndarray:
    """Return the array in .npy bytes; DamagedError, with the key of the sweep that has it, if they are damaged."""
    try:
        begin = HEADER + int.from_bytes(data[HEADER - 2 : HEADER], "little")
        shape, dtype = _layout(data[:begin])
        array: np.ndarray = np.frombuffer(data, dtype, offset=begin).reshape(shape).copy()
    except Exception as error:  # parsing what a header says raises whatever it leads it into
        raise DamagedError(key, f"a stored array is damaged ({error}); {AGAIN}") from error
    return array


@lru_cache(256)
def _layout(header: bytes) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type that a header tells: thousands of arrays have the same one, and numpy parses slowly."""
    stream = io.BytesIO(header)
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"format {version}; expected (1, 0)")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if fortran or dtype.kind not in NUMBERS or min(shape, default=0) < 0:
        raise ValueError("an array of Python objects, or by columns; expected numbers by rows")
    return shape, dtype


def response_rows(key: str, response: FrequencyResponse | None) -> list[dict[str, Any]]:
    """Return the row of a frequency response, or none."""
    if response is None:
        return []
    row = {item.name: getattr(response, item.name) for item in fields(response)}
    types = DTYPES | {name: np.float64 for name in OPTIONAL if row[name] is not None}
    row |= {name: encode(row[name], f"the response's {name}", dtype) for name, dtype in types.items()}
    return [{"key": key, "points": len(response.frequency), **row}]


def response_of(row: Mapping[Any, Any]) -> FrequencyResponse:
    """Return the frequency response in a row."""
    values: dict[str, Any] = {name: row[name] for name in ("unit", "input", "output")}
    key = row["key"]
    values |= {name: decode(row[name], key) for name in DTYPES}
    values |= {name: decode(row[name], key) for name in OPTIONAL if row[name] is not None}
    points = values["frequency"].shape
    for name, dtype in {**DTYPES, **dict.fromkeys(OPTIONAL, np.float64)}.items():
        array, sides = values.get(name), SIDES.get(name, ())
        if array is not None and (array.dtype != dtype or array.shape != (*points, *sides) or len(points) != 1):
            expected = f"{np.dtype(dtype)} {(*points, *sides)}"
            raise DamagedError(key, f"a stored {name} is {array.dtype} {array.shape}; expected {expected}: {AGAIN}")
    return sound(FrequencyResponse(**values))


def metric_rows(key: str, metrics: Iterable[Metric]) -> list[dict[str, Any]]:
    """Return a row for each metric."""
    return [
        {"key": key, "position": position, "name": item.name, "value": float(item.value), "unit": item.unit}
        for position, item in enumerate(metrics)
    ]


def metric_of(row: Mapping[Any, Any]) -> Metric:
    """Return the metric in a row."""
    return sound(Metric(row["name"], row["value"], row["unit"]))


def curve_rows(key: str, curves: Iterable[Curve]) -> list[dict[str, Any]]:
    """Return a row for each curve."""
    return [{"key": key, "position": position, "name": item.name} for position, item in enumerate(curves)]


def column_rows(key: str, curves: Iterable[Curve]) -> list[dict[str, Any]]:
    """Return a row for each column of each curve; a unit without a column is left out."""
    return [
        {
            "key": key,
            "curve": number,
            "position": position,
            "name": name,
            "unit": item.units.get(name),
            "samples": encode(samples, f"column '{name}' of curve '{item.name}'"),
        }
        for number, item in enumerate(curves)
        for position, (name, samples) in enumerate(item.columns.items())
    ]


def curve_of(name: str, columns: Iterable[Mapping[Any, Any]]) -> Curve:
    """Return the curve of a name from the rows of its columns, in order."""
    rows = list(columns)
    units = {row["name"]: row["unit"] for row in rows if row["unit"] is not None}
    found = {row["name"]: decode(row["samples"], row["key"]) for row in rows}
    if not all(isinstance(text, str) for text in (*found, *units.values())):
        raise TypeError("a column's name or unit is no text")
    return sound(Curve(name, found, units))


def fit_rows(key: str, fits: Iterable[Fit]) -> list[dict[str, Any]]:
    """Return a row for each fit."""
    return [
        {
            "key": key,
            "position": position,
            "kind": item.kind,
            "component": dict(item.component),
            "parameters": list(item.parameters),
            "units": list(item.units),
            "values": encode(item.values, "the fit's values", np.float64),
            "covariance": encode(item.covariance, "the fit's covariance", np.float64),
        }
        for position, item in enumerate(fits)
    ]


def fit_of(row: Mapping[Any, Any]) -> Fit:
    """Return the fit in a row."""
    texts = (tuple(row["parameters"]), tuple(row["units"]))
    arrays = (decode(row[name], row["key"]) for name in ("values", "covariance"))
    found = Fit(row["kind"], row["component"], *texts, *arrays)
    count = len(found.parameters)
    if found.values.shape != (count,) or found.covariance.shape != (count, count) or len(found.units) != count:
        unlike = f"the stored fit of {found.kind!r} has not as many values as parameters; {AGAIN}"
        raise DamagedError(row["key"], unlike)
    if not all(isinstance(text, str) for of in texts for text in of):
        raise TypeError("the name or unit of a fitted parameter is no text")
    return sound(found)


def result_rows(key: str, result: Result) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of a result by table name, parents first."""
    return {
        "frequency_response": response_rows(key, result.response),
        "metric": metric_rows(key, result.metrics),
        "curve": curve_rows(key, result.curves),
        "curve_column": column_rows(key, result.curves),
        "fit": fit_rows(key, result.fits),
    }
