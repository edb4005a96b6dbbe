"""Export to text: CSV and JSON."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.data.results import EXTREMUM_CURVES, Curve, FrequencyResponse, Result
from fraexp.figures.export.content import (
    Header,
    channel_units,
    json_value,
    one_line,
    optional_arrays,
    outcome_name,
    result_document,
)


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
