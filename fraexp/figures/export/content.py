"""A result as names and values, which all formats share."""

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import Fit, FrequencyResponse, Result
from fraexp.data.sweep import Plain

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


def response_arrays(response: FrequencyResponse) -> dict[str, Any]:
    """Return the fields of a response by name, with derived ones."""
    return {
        "frequency": response.frequency,
        "response": response.response,
        "covariance": response.covariance,
        "standard_deviation": response.standard_deviation,
        "input": response.input,
        "output": response.output,
        "unit": response.unit,
        "input_amplitude": response.input_amplitude,
        "output_amplitude": response.output_amplitude,
        "settled": response.settled,
        "settling_time": response.settling_time,
        "residual": response.residual,
        "harmonics": response.harmonics,
        "distortion": response.distortion,
        **optional_arrays(response),
    }


def optional_arrays(response: FrequencyResponse) -> dict[str, NDArray[np.float64]]:
    """Return the arrays that only some estimators give."""
    names = ("freedom", "noise_variance", "nonlinear_variance", "coherence", "model_covariance", "numerical_error")
    found = {name: getattr(response, name) for name in names}
    return {name: values for name, values in found.items() if values is not None}


def channel_units(response: FrequencyResponse) -> tuple[str, str]:
    """Return the units of output and input; empty if the unit of the response is ambiguous."""
    output, *rest = response.unit.split("/")  # m/s/N may be (m/s)/N or m/(s/N)
    return (output, rest[0].strip("()")) if len(rest) == 1 else ("", "")


def response_units(response: FrequencyResponse) -> dict[str, str]:
    """Return the units of the fields of a response; those of the amplitudes are empty if unknown."""
    output, entry = channel_units(response)
    return {
        "frequency": "Hz",
        "response": response.unit,
        "covariance": f"({response.unit})^2",
        "standard_deviation": response.unit,
        "input_amplitude": entry,
        "output_amplitude": output,
        "settling_time": "s",
        "residual": "1",
        "harmonics": "1",
        "distortion": "1",
        "freedom": "1",
        "noise_variance": f"({response.unit})^2",
        "nonlinear_variance": f"({response.unit})^2",
        "coherence": "1",
        "model_covariance": f"1/({response.unit})^2",
        "numerical_error": "1",
    }


def json_value(value: object) -> object:
    """Return JSON data: a complex number is [re, im], a number that is not finite is null."""
    if isinstance(value, np.ndarray | np.generic):
        return json_value(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [json_value(item) for item in value]
    if isinstance(value, complex):
        return [json_value(value.real), json_value(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


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
