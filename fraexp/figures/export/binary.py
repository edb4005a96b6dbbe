"""Export to MATLAB (structs of arrays) and HDF5 (datasets with their units)."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fraexp.data.results import Result
from fraexp.figures.export.content import (
    Header,
    json_value,
    outcome_name,
    response_arrays,
    response_units,
    result_document,
    unique_name,
)


def write_mat(result: Result, header: Header, path: Path) -> None:
    """Write everything as one struct `fraexp` (version 5); its header is JSON for jsondecode."""
    from scipy.io import savemat

    content = result_document(result, header)
    content["header"] = json.dumps(json_value(content["header"]))
    with path.open("wb") as stream:
        savemat(
            stream, {"fraexp": _matlab_structs(content)}, long_field_names=True, oned_as="column", do_compression=True
        )


def _matlab_structs(value: object) -> object:
    """Return plain data as structs with valid names: letters, digits and underscores, unique and not too long."""
    if not isinstance(value, Mapping):
        return value
    named: dict[str, object] = {}
    for key, item in value.items():
        name = re.sub(r"\W", "_", str(key), flags=re.ASCII)[:60]
        name = name if name[:1].isalpha() else f"x{name}"
        named[unique_name(name, named)] = _matlab_structs(item)
    return named


def write_hdf5(result: Result, header: Header, path: Path) -> None:
    """Write everything as groups of datasets, each with its unit as an attribute."""
    import h5py

    with h5py.File(path, "w") as file:
        content = result_document(result, header)
        file["header"] = json.dumps(json_value(content["header"]))  # not an attribute, which is limited to 64 KiB
        file.attrs["outcome"], file.attrs["message"] = outcome_name(result), result.message
        if result.response is not None:
            _add_group(file.create_group("response"), response_arrays(result.response), response_units(result.response))
        metrics = file.create_group("metrics")
        _add_group(metrics, {m.name: m.value for m in result.metrics}, {m.name: m.unit for m in result.metrics})
        curves = file.create_group("curves")
        for curve in result.curves:
            group = curves.create_group(unique_name(curve.name.replace("/", "_"), curves))
            _add_group(group, curve.columns, curve.units)
        for what in ("fits", "models"):
            for name, values in content.get(what, {}).items():
                _add_group(file.create_group(f"{what}/{name}"), values, {})


def _add_group(group: Any, values: Mapping[str, object], units: Mapping[str, str]) -> None:
    for name, value in values.items():
        if isinstance(value, str):
            group.attrs[name] = value
            continue
        dataset = group.create_dataset(unique_name(name.replace("/", "_"), group), data=value)
        if units.get(name):
            dataset.attrs["unit"] = units[name]
