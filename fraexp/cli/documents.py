"""Runs, sweeps and results as JSON documents."""

from dataclasses import asdict
from typing import Any

import numpy as np

from fraexp.data.results import FrequencyResponse, Result
from fraexp.figures.result_files import json_value
from fraexp.store import RunSummary, StoredSweep
from fraexp.views.fields import remedy_text


def run_document(run: RunSummary) -> dict[str, Any]:
    """Return a run without its sweeps."""
    document: dict[str, Any] = json_value(asdict(run))
    return document


def listed_document(sweep: StoredSweep) -> dict[str, Any]:
    """Return what a listing shows of a sweep, with the names of its components instead of their parameters."""
    document = _document(sweep)
    names = {kind: sweep.component(kind) for kind in ("estimator", "friction", "plant", "controller", "excitation")}
    del document["experiment"], document["sources"]
    return {**document, **names, "source": sweep.experiment.get("source")}


def _document(sweep: StoredSweep) -> dict[str, Any]:
    document: dict[str, Any] = json_value(asdict(sweep))
    del document["failure"]
    return {**document, "message": sweep.message}


def sweep_document(sweep: StoredSweep, result: Result | None, points: bool = True) -> dict[str, Any]:
    """Return a sweep with its metrics and, with `points`, its response."""
    document = _document(sweep)
    document["remedy"] = remedy_text(sweep)
    if result is not None:
        document["metrics"] = json_value([asdict(metric) for metric in result.metrics])
    if result is not None and points:
        document["response"] = response_document(result.response) if result.response else None
        document["curves"] = json_value([asdict(curve) for curve in result.curves])
        document["fits"] = json_value([asdict(fit) for fit in result.fits])
    return document


def response_document(response: FrequencyResponse) -> dict[str, Any]:
    """Return a response as columns of numbers, complex ones as real and imaginary part."""
    columns: dict[str, Any] = {}
    for name, values in vars(response).items():
        if np.iscomplexobj(values):
            prefix = "" if name == "response" else f"{name}_"
            columns |= {f"{prefix}real": values.real, f"{prefix}imaginary": values.imag}
        elif values is not None:
            columns[name] = values
    return {name: json_value(values) for name, values in columns.items()}
