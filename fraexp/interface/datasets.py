"""Results and signals as xarray datasets and pandas tables, with units and provenance."""

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Curve, FrequencyResponse, Result
from fraexp.data.signals import Signals
from fraexp.data.sweep import DRAW
from fraexp.errors import FraexpError
from fraexp.figures.result_files import json_value, outcome_name, response_arrays, response_units, table_columns

if TYPE_CHECKING:
    import pandas
    import xarray

PURPOSE = "this conversion"
INNER_DIMENSIONS: Mapping[str, tuple[str, ...]] = {
    "covariance": ("part", "other_part"),
    "model_covariance": ("part", "other_part"),
    "harmonics": ("harmonic",),
}
"""Dimensions of the fields of a response beside the frequency."""
PARTS = ["real", "imaginary"]
FIRST_HARMONIC = 2


def describe(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes that any file format holds: texts and numbers as they are, everything else as JSON."""
    return {key: value if isinstance(value, str | int | float) else json_text(value) for key, value in values.items()}


def json_text(value: object) -> str:
    """Return plain data as JSON."""
    return json.dumps(json_value(value), ensure_ascii=False)


def response_dataset(response: FrequencyResponse, attributes: Mapping[str, Any]) -> "xarray.Dataset":
    """Return a response over ``frequency``: each field is a variable with its unit in the attribute ``units``.

    A covariance has the dimensions ``part`` and ``other_part``, which are real and imaginary.
    """
    xarray = import_optional("xarray", PURPOSE)
    units = response_units(response)
    arrays = {name: value for name, value in response_arrays(response).items() if isinstance(value, np.ndarray)}
    frequency = arrays.pop("frequency")
    variables = {
        name: (("frequency", *INNER_DIMENSIONS.get(name, ())), value, {"units": units[name]} if name in units else {})
        for name, value in arrays.items()
    }
    coordinates = {
        "frequency": ("frequency", frequency, {"units": "Hz"}),
        "part": PARTS,
        "other_part": PARTS,
        "harmonic": np.arange(FIRST_HARMONIC, FIRST_HARMONIC + response.harmonics.shape[1]),
    }
    channels = {"input": response.input, "output": response.output}
    return xarray.Dataset(variables, coordinates, describe({**channels, **attributes}))


def curve_dataset(curve: Curve, attributes: Mapping[str, Any]) -> "xarray.Dataset":
    """Return the columns of a curve over ``point``: a hysteresis loop has no ascending abscissa."""
    xarray = import_optional("xarray", PURPOSE)
    variables = {
        name: ("point", values, {"units": curve.units.get(name, "")}) for name, values in curve.columns.items()
    }
    return xarray.Dataset(variables, attrs=describe({"curve": curve.name, **attributes}))


def signals_dataset(signals: Signals, attributes: Mapping[str, Any]) -> "xarray.Dataset":
    """Return all recorded samples over ``sample``, with the coordinates ``time`` [s], ``segment`` and ``period``.

    A segment is one experiment, such as a frequency of a stepped sine; its time starts at 0 with its first recorded
    period.
    """
    xarray = import_optional("xarray", PURPOSE)
    shapes = [next(iter(segment.channels.values())).shape for segment in signals.segments]
    names = [name for name in signals.units if all(name in segment.channels for segment in signals.segments)]
    numbers = [np.full(periods * samples, number) for number, (periods, samples) in enumerate(shapes)]
    counted = [np.repeat(np.arange(periods), samples) for periods, samples in shapes]
    pairs = zip(signals.segments, shapes, strict=True)
    times = [np.arange(periods * samples) * segment.sample_time for segment, (periods, samples) in pairs]
    variables = {
        name: (
            "sample",
            _concatenate([segment.channels[name].ravel() for segment in signals.segments]),
            {"units": signals.units[name]},
        )
        for name in names
    }
    coordinates = {
        "time": ("sample", _concatenate(times), {"units": "s"}),
        "segment": ("sample", _concatenate(numbers)),
        "period": ("sample", _concatenate(counted)),
    }
    return xarray.Dataset(variables, coordinates, describe(attributes))


def _concatenate(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.concatenate(parts) if parts else np.empty(0)


def response_table(response: FrequencyResponse, attributes: Mapping[str, Any]) -> "pandas.DataFrame":
    """Return a response with the columns of the CSV export, indexed by ``frequency_Hz``."""
    pandas = import_optional("pandas", PURPOSE)
    table = pandas.DataFrame(table_columns(response)).set_index("frequency_Hz")
    table.attrs |= {"unit": response.unit, "input": response.input, "output": response.output, **attributes}
    return table


def stack_datasets(
    datasets: Sequence["xarray.Dataset"], axes: Mapping[str, Sequence[Any]], attributes: Mapping[str, Any]
) -> "xarray.Dataset":
    """Return datasets as one: a dimension for each axis if its values are a full grid, else ``sweep``.

    `axes` has the value of each dataset, by the name of its coordinate. Points that a dataset lacks are NaN.
    """
    xarray = import_optional("xarray", PURPOSE)
    if not datasets:
        raise FraexpError("there is no response to convert; expected at least one; see to_pandas() for metrics")
    units = {of.response.attrs["units"] for of in datasets}
    if len(units) > 1:
        raise FraexpError(f"the responses have different units ({', '.join(sorted(units))}); filter those of one unit")
    places = list(zip(*axes.values(), strict=True))
    grid = {name: list(dict.fromkeys(values)) for name, values in axes.items()}
    is_grid = bool(axes) and len(set(places)) == len(places) == int(np.prod([len(values) for values in grid.values()]))
    aligned = _align(datasets)
    if not is_grid:
        stacked = xarray.concat(aligned, "sweep", combine_attrs="drop_conflicts", **CONCATENATION)
        whole = stacked.assign_coords({name: ("sweep", list(values)) for name, values in axes.items()})
        return _tidy(whole, attributes)
    placed = [
        one.expand_dims({name: [value] for name, value in zip(grid, place, strict=True)})
        for one, place in zip(aligned, places, strict=True)
    ]
    whole = xarray.combine_by_coords(placed, combine_attrs="drop_conflicts", **COMBINATION).reindex(grid)
    return _tidy(whole, attributes)


def place_drawn_values(whole: "xarray.Dataset", names: Sequence[str]) -> "xarray.Dataset":
    """Return a dataset in which values that were drawn at random are coordinates, over ``draw`` alone if possible."""
    for name in names:
        values = whole[name]
        first = values.isel(dict.fromkeys(set(values.dims) - {DRAW}, 0))
        found = first if bool((values == first).all()) else values
        whole = whole.drop_vars(name).assign_coords({name: (found.dims, found.values)})
    return whole


def _align(datasets: Sequence["xarray.Dataset"]) -> "Sequence[xarray.Dataset]":
    """Return datasets over all of their frequencies; FraexpError if one repeats a frequency that others lack."""
    xarray = import_optional("xarray", PURPOSE)
    first = datasets[0].frequency
    if all(of.frequency.equals(first) for of in datasets):
        return datasets
    if any(not of.indexes["frequency"].is_unique for of in datasets):
        raise FraexpError("some responses repeat a frequency, and others have not the same; convert each by itself")
    return list(xarray.align(*datasets, join="outer"))


def _tidy(whole: "xarray.Dataset", attributes: Mapping[str, Any]) -> "xarray.Dataset":
    """Return a dataset with its attributes, in which a point that a sweep lacks is not settled."""
    settled = (whole.settled == 1).assign_attrs(whole.settled.attrs)
    return whole.assign(settled=settled).assign_attrs(describe(attributes))


CONCATENATION: Mapping[str, Any] = {"data_vars": "all", "coords": "minimal", "compat": "override", "join": "outer"}
COMBINATION: Mapping[str, Any] = {"data_vars": "all", "coords": "minimal", "compat": "no_conflicts", "join": "outer"}


def label_values(values: Sequence[object]) -> list[Any]:
    """Return the values of a label as coordinates: numbers and texts; components by their names where these differ."""
    names = {json_text(of): str(of["name"]) for of in values if isinstance(of, Mapping) and "name" in of}
    are_telling = len(set(names.values())) == len(names)
    return [names[json_text(of)] if are_telling and json_text(of) in names else _plain_label(of) for of in values]


def _plain_label(value: object) -> str | int | float:
    return value if isinstance(value, str | int | float) else "" if value is None else json_text(value)


def outcome_attributes(result: Result) -> dict[str, Any]:
    """Return outcome, message, numerics and metrics of a result."""
    return {
        "outcome": outcome_name(result),
        "message": result.message,
        "numerics": result.numerics,
        "metrics": {metric.name: {"value": metric.value, "unit": metric.unit} for metric in result.metrics},
    }


def import_optional(name: str, purpose: str) -> Any:
    """Return a package of the extra ``notebook``; FraexpError says how to install it if it is missing."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise FraexpError(
            f"{purpose} needs the package {name}: pip install {name} (the extra 'notebook' has all of them)"
        ) from None
