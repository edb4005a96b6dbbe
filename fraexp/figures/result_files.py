"""Results as files for other tools: CSV, JSON, MATLAB and HDF5, chosen by the suffix.

Beside the response CSV has the metrics in its header, and the curves if there is no response; the others have
everything.
"""

import json
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.atomic_file import atomic_file
from fraexp.data.results import EXTREMUM_CURVES, Curve, Fit, FrequencyResponse, Outcome, Result
from fraexp.data.sweep import Plain
from fraexp.errors import FraexpError

Header = Plain
"""Description of a result as plain data: study, experiment, provenance; `models` are matrices by name."""


def outcome_name(result: Result) -> str:
    """Return the outcome as it is written: ``ok``, ``not_settled``."""
    return result.outcome.name.lower()


def result_document(result: Result, header: Header) -> dict[str, Any]:
    """Return the whole result by name."""
    description = dict(header)
    models = description.pop("models", None)
    content: dict[str, Any] = {"header": description, "outcome": outcome_name(result), "message": result.message}
    if result.response is not None:
        content["response"] = response_arrays(result.response)
        content["units"] = response_units(result.response)
    content["metrics"] = {metric.name: {"value": metric.value, "unit": metric.unit} for metric in result.metrics}
    content["curves"] = {curve.name: {"columns": curve.columns, "units": curve.units} for curve in result.curves}
    content["fits"] = {fit.kind: fit_content(fit) for fit in result.fits}
    if models:
        content["models"] = models
    return content


def fit_content(fit: Fit) -> dict[str, Any]:
    """Return a fit by name; its component is JSON, as a study has it."""
    return {
        "component": json.dumps(json_value(fit.component)),
        "parameters": list(fit.parameters),
        "units": list(fit.units),
        "values": fit.values,
        "covariance": fit.covariance,
    }


RESPONSE_FIELDS = {
    "frequency": "Hz", "response": "{unit}", "covariance": "({unit})^2", "standard_deviation": "{unit}", "input": "",
    "output": "", "unit": "", "input_amplitude": "{input}", "output_amplitude": "{output}", "settled": "",
    "settling_time": "s", "residual": "1", "harmonics": "1", "distortion": "1",
}  # fmt: skip
"""Fields of every response with their units; ``{unit}`` is its own, ``{input}`` and ``{output}`` are the channels'."""
OPTIONAL_FIELDS = {
    "freedom": "1", "noise_variance": "({unit})^2", "nonlinear_variance": "({unit})^2", "coherence": "1",
    "model_covariance": "1/({unit})^2", "numerical_error": "1",
}  # fmt: skip
"""Fields that only some estimators give."""


def response_arrays(response: FrequencyResponse) -> dict[str, Any]:
    """Return the fields of a response by name, with derived ones."""
    return {**{name: getattr(response, name) for name in RESPONSE_FIELDS}, **optional_arrays(response)}


def optional_arrays(response: FrequencyResponse) -> dict[str, NDArray[np.float64]]:
    """Return the arrays that only some estimators give."""
    found = {name: getattr(response, name) for name in OPTIONAL_FIELDS}
    return {name: values for name, values in found.items() if values is not None}


def channel_units(response: FrequencyResponse) -> tuple[str, str]:
    """Return the units of output and input; empty if the unit of the response is ambiguous."""
    output, *rest = response.unit.split("/")  # m/s/N may be (m/s)/N or m/(s/N)
    return (output, rest[0].strip("()")) if len(rest) == 1 else ("", "")


def response_units(response: FrequencyResponse) -> dict[str, str]:
    """Return the units of the fields of a response that have one; those of the amplitudes are empty if unknown."""
    output, entry = channel_units(response)
    units = {**RESPONSE_FIELDS, **OPTIONAL_FIELDS}
    return {name: unit.format(unit=response.unit, input=entry, output=output) for name, unit in units.items() if unit}


def json_value(value: object) -> Any:
    """Return JSON data: complex numbers are [re, im], numbers that are not finite null, times ISO 8601."""
    match value:
        case Outcome():
            found: Any = value.name.lower()
        case datetime():
            found = value.isoformat()
        case np.ndarray() | np.generic():
            found = json_value(value.tolist())
        case Mapping():
            found = {str(key): json_value(item) for key, item in value.items()}
        case list() | tuple() | set():
            found = [json_value(item) for item in value]
        case complex():
            found = [json_value(value.real), json_value(value.imag)]
        case float():
            found = value if math.isfinite(value) else None
        case None | str() | int():
            found = value
        case _:
            found = str(value)
    return found


def one_line(value: object) -> str:
    """Return plain data as one line of text."""
    return " ".join(value.split()) if isinstance(value, str) else json.dumps(json_value(value), ensure_ascii=False)


def unique_name(name: str, taken: Iterable[str]) -> str:
    """Return a name that is not taken, with a number if necessary."""
    number = 2
    found = name
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found


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


def write_csv(result: Result, header: Header, path: Path) -> None:
    """Write a table under comment lines, resonances among them; without a response, one table per curve."""
    notes = {**header, "outcome": outcome_name(result), "message": result.message}
    lines = [f"# {key}: {one_line(value)}" for key, value in notes.items()]
    lines += [f"# metric {metric.name}: {metric.value!r} {metric.unit}".rstrip() for metric in result.metrics]
    if result.response is not None:
        response = result.response
        lines.append(f"# response: {response.output}/{response.input} [{response.unit}]")
        lines.append("# columns: real, imag and std [unit]; cov_rr, cov_ri and cov_ii [unit²]; std² = cov_rr + cov_ii")
        lines.append(
            "# std and cov are by noise, low95 and high95 by all that is known; model_cov: of 1/response [1/unit²]"
        )
        units = zip(("output", "input"), channel_units(response), strict=True)
        lines += [f"# {name}_amplitude: [{unit}]" for name, unit in units if unit]
        for curve in result.curves:
            lines += [f"# {line}" for line in _curve_rows(curve)] if curve.name in EXTREMUM_CURVES else []
        lines += _csv_rows(table_columns(response))
    for curve in () if result.response is not None else result.curves:
        first, *rest = _curve_rows(curve)
        lines += [f"# {first}", *rest]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _curve_rows(curve: Curve) -> list[str]:
    """Return a curve's name, its heading and its rows."""
    columns = {_heading(name, curve.units.get(name, "")): values for name, values in curve.columns.items()}
    return [f"curve: {curve.name}", *_csv_rows(columns)]


def _heading(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def table_columns(response: FrequencyResponse) -> dict[str, NDArray[np.generic]]:
    """Return the columns of a response as a table, by name with unit, each of shape (n,)."""
    with np.errstate(divide="ignore"):
        magnitude = 20 * np.log10(np.abs(response.response))
    return {
        "frequency_Hz": response.frequency,
        "real": response.response.real,
        "imag": response.response.imag,
        "magnitude_dB": magnitude,
        "phase_deg": np.degrees(np.angle(response.response)),
        "std": response.standard_deviation,
        "cov_rr": response.covariance[:, 0, 0],
        "cov_ri": response.covariance[:, 0, 1],
        "cov_ii": response.covariance[:, 1, 1],
        "input_amplitude": response.input_amplitude,
        "output_amplitude": response.output_amplitude,
        "settled": response.settled.astype(int),
        "settling_time_s": response.settling_time,
        "residual": response.residual,
        "thd": response.distortion,
        **_limit_columns(response),
        **{name: values for name, values in optional_arrays(response).items() if values.ndim == 1},
        **_model_columns(response),
    }


def _limit_columns(response: FrequencyResponse) -> dict[str, NDArray[np.float64]]:
    """Return the 95 % limits, of noise and of the friction model's uncertainty where that is stated."""
    with np.errstate(divide="ignore", invalid="ignore"):
        magnitude, phase = confidence_limits(response)
        level = 20 * np.log10(np.abs(response.response) * np.where(magnitude > 0, magnitude, 0.0))
    angle = np.degrees(np.angle(response.response) + phase)
    return {
        "magnitude_dB_low95": level[0],
        "magnitude_dB_high95": level[1],
        "phase_deg_low95": angle[0],
        "phase_deg_high95": angle[1],
    }


def _model_columns(response: FrequencyResponse) -> dict[str, NDArray[np.float64]]:
    covariance = response.model_covariance
    if covariance is None:
        return {}
    places = {"rr": (0, 0), "ri": (0, 1), "ii": (1, 1)}
    return {f"model_cov_{name}": covariance[:, row, column] for name, (row, column) in places.items()}


def _csv_rows(columns: Mapping[str, NDArray[np.generic]]) -> list[str]:
    names = [f'"{name}"' if "," in name else name for name in columns]
    # repr of a Python number is the shortest text that reads back as the same number
    cells = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
    return [",".join(names), *(",".join(repr(cell) for cell in row) for row in cells)]


def write_json(result: Result, header: Header, path: Path) -> None:
    """Write everything; a complex number is [re, im], and an unknown value is null."""
    text = json.dumps(json_value(result_document(result, header)), indent=1, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


WRITERS: dict[str, Callable[[Result, Header, Path], None]] = {
    ".csv": write_csv,
    ".json": write_json,
    ".mat": write_mat,
    ".h5": write_hdf5,
}
"""Formats by suffix."""


def export(result: Result, header: Header, path: Path, *, force: bool = False) -> None:
    """Write a result to a file in the format of its suffix, with `header` (plain data) as its description.

    The file appears complete or not at all. FraexpError if the suffix is unknown, the file exists and `force` is not
    set, there is nothing to write, or it cannot be written.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FraexpError(f"{path.name}: '{path.suffix}' is not an export format; known: {', '.join(WRITERS)}")
    if result.response is None and not result.curves and not result.metrics:
        why = f"{outcome_name(result)}: {result.message}"
        raise FraexpError(f"{path.name}: the result is empty ({why}); expected a response, metrics or curves")
    write_file(path, lambda draft: writer(result, header, draft), force=force)


def write_file(path: Path, write: Callable[[Path], object], *, force: bool = False) -> None:
    """Write a file, complete or not at all; FraexpError if it exists without `force`, or cannot be written."""
    if os.path.lexists(path) and not force:
        raise FraexpError(f"{path}: the file exists; give --force to replace it, or another name")
    with atomic_file(path) as draft:
        write(draft)
