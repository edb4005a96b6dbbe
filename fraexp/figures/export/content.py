"""A result as plain names and values, shared by the formats."""

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fraexp.data.results import Fit, FrequencyResponse, Result

Header = Mapping[str, Any]
"""What describes a result: plain data, such as study, experiment and provenance; `models` are matrices by name."""


def outcome_name(result: Result) -> str:
    """Return the outcome as it is written: ``ok``, ``not_settled``."""
    return result.outcome.name.lower()


def document(result: Result, header: Header) -> dict[str, Any]:
    """Return the whole result by name."""
    description = dict(header)
    models = description.pop("models", None)
    content: dict[str, Any] = {"header": description, "outcome": outcome_name(result), "message": result.message}
    if result.response is not None:
        content["response"] = arrays(result.response)
        content["units"] = units_of(result.response)
    content["metrics"] = {metric.name: {"value": metric.value, "unit": metric.unit} for metric in result.metrics}
    content["curves"] = {curve.name: {"columns": curve.columns, "units": curve.units} for curve in result.curves}
    content["fits"] = {fit.kind: fit_content(fit) for fit in result.fits}
    if models:
        content["models"] = models
    return content


def fit_content(fit: Fit) -> dict[str, Any]:
    """Return a fit by name; its component is JSON, as a study has it."""
    return {
        "component": json.dumps(plain(fit.component)),
        "parameters": list(fit.parameters),
        "units": list(fit.units),
        "values": fit.values,
        "covariance": fit.covariance,
    }


def arrays(response: FrequencyResponse) -> dict[str, Any]:
    """Return the fields of a response by name, and what follows from them."""
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
        **optional(response),
    }


def optional(response: FrequencyResponse) -> dict[str, np.ndarray]:
    """Return what only some estimators tell of a response."""
    names = ("freedom", "noise_variance", "nonlinear_variance", "coherence", "model_covariance")
    found = {name: getattr(response, name) for name in names}
    return {name: values for name, values in found.items() if values is not None}


def channel_units(response: FrequencyResponse) -> tuple[str, str]:
    """Return the units of output and input; empty where the response's unit does not tell them apart."""
    output, *rest = response.unit.split("/")  # m/s/N may be (m/s)/N or m/(s/N)
    return (output, rest[0]) if len(rest) == 1 else ("", "")


def units_of(response: FrequencyResponse) -> dict[str, str]:
    """Return the units of these fields; those of the amplitudes are empty where they are not known."""
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
    }


def plain(value: Any) -> Any:
    """Return JSON data: a complex number as [re, im], what is no finite number as null."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


def one_line(value: Any) -> str:
    """Return plain data as one line of text."""
    return " ".join(value.split()) if isinstance(value, str) else json.dumps(plain(value), ensure_ascii=False)


def distinct(name: str, taken: Iterable[str]) -> str:
    """Return the name, numbered if it is taken."""
    number = 2
    found = name
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found
