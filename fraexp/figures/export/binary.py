"""Export to MATLAB (structs of arrays) and HDF5 (datasets with their units)."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fraexp.data.results import Result
from fraexp.figures.export.content import Header, arrays, distinct, document, outcome_name, plain, units_of


def write_mat(result: Result, header: Header, path: Path) -> None:
    """Write everything as one struct `fraexp` (version 5); its header is JSON for jsondecode."""
    from scipy.io import savemat

    content = document(result, header)
    content["header"] = json.dumps(plain(content["header"]))
    with path.open("wb") as stream:
        savemat(stream, {"fraexp": _matlab(content)}, long_field_names=True, oned_as="column", do_compression=True)


def _matlab(value: Any) -> Any:
    """Return structs of arrays: names made of letters, digits and underscores, distinct and not too long."""
    if not isinstance(value, Mapping):
        return value
    named: dict[str, Any] = {}
    for key, item in value.items():
        name = re.sub(r"\W", "_", str(key), flags=re.ASCII)[:60]
        name = name if name[:1].isalpha() else f"x{name}"
        named[distinct(name, named)] = _matlab(item)
    return named


def write_hdf5(result: Result, header: Header, path: Path) -> None:
    """Write everything as groups of datasets, each with its unit as an attribute."""
    import h5py

    with h5py.File(path, "w") as file:
        content = document(result, header)
        file["header"] = json.dumps(plain(content["header"]))  # no attribute: these are limited to 64 KiB
        file.attrs["outcome"], file.attrs["message"] = outcome_name(result), result.message
        if result.response is not None:
            _add_group(file.create_group("response"), arrays(result.response), units_of(result.response))
        metrics = file.create_group("metrics")
        _add_group(metrics, {m.name: m.value for m in result.metrics}, {m.name: m.unit for m in result.metrics})
        curves = file.create_group("curves")
        for curve in result.curves:
            group = curves.create_group(distinct(curve.name.replace("/", "_"), curves))
            _add_group(group, curve.columns, curve.units)
        for what in ("fits", "models"):
            for name, values in content.get(what, {}).items():
                _add_group(file.create_group(f"{what}/{name}"), values, {})


def _add_group(group: Any, values: Mapping[str, Any], units: Mapping[str, str]) -> None:
    for name, value in values.items():
        if isinstance(value, str):
            group.attrs[name] = value
            continue
        dataset = group.create_dataset(distinct(name.replace("/", "_"), group), data=value)
        if units.get(name):
            dataset.attrs["unit"] = units[name]
