"""The result of one sweep."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.figure_kinds import check_kind
from fraexp.data.findings import Finding
from fraexp.data.results import UNUSABLE_OUTCOMES, FrequencyResponse, Result
from fraexp.errors import FraexpError, ParameterError
from fraexp.figures.result_files import export, json_value
from fraexp.interface.argument_checks import frequency_view, is_there, require_path
from fraexp.interface.datasets import (
    curve_dataset,
    import_optional,
    outcome_attributes,
    response_dataset,
    response_table,
)
from fraexp.interface.html import page_part
from fraexp.store import StoredSweep
from fraexp.views import text_tables
from fraexp.views.words import number_text, short_key
from fraexp.workspace.controller_export import CONTROLLER_SUFFIXES, export_controller

if TYPE_CHECKING:
    import control
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from fraexp.workspace.workspace_service import WorkspaceService

SHOWN_POINTS = 8
"""Points of a response in a notebook's table."""


@dataclass(frozen=True, eq=False)
class SweepResult:
    """One experiment seen by one estimator: its frequency response, metrics, curves and fitted models."""

    sweep: StoredSweep
    """Experiment, estimator, labels and provenance as plain data."""
    result: Result
    """All arrays, as the estimator gave them (see `fraexp.api.Result`)."""
    service: "WorkspaceService"

    @property
    def key(self) -> str:
        """Key of the sweep: a hash of experiment and estimator, as `fraexp list` shows it."""
        return short_key(self.sweep.key)

    @property
    def labels(self) -> dict[str, Any]:
        """Values of the study's grid, cases and random draws at this sweep, by path."""
        return dict(self.sweep.labels)

    @property
    def estimator(self) -> str:
        """Name of the estimator."""
        return str(self.sweep.estimator["name"])

    @property
    def outcome(self) -> str:
        """``ok``, or the name of what went wrong, such as ``not_settled``."""
        return self.result.outcome.name.lower()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Doubts about the result, and causes of its outcome, as data."""
        return self.result.findings

    @property
    def message(self) -> str:
        """What exactly happened, in one line; empty when all is well."""
        return self.result.message

    @property
    def is_usable(self) -> bool:
        """Whether anything can be learnt from the result."""
        return self.result.outcome not in UNUSABLE_OUTCOMES

    @property
    def frequency_response(self) -> FrequencyResponse:
        """The response with all its fields; FraexpError if the result has none."""
        if self.result.response is None:
            reason = self.message or f"{self.estimator} gives metrics and curves"
            raise FraexpError(f"sweep {self.key} has no frequency response: {reason}")
        return self.result.response

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Frequency [Hz], shape (n,)."""
        return self.frequency_response.frequency

    @property
    def response(self) -> NDArray[np.complex128]:
        """Complex response [`unit`], shape (n,); a copy."""
        return self.frequency_response.response.copy()

    @property
    def unit(self) -> str:
        """Unit of the response, such as ``m/N``."""
        return self.frequency_response.unit

    @property
    def metrics(self) -> dict[str, float]:
        """Values of the metrics, by name; `result.metrics` has their units."""
        return {metric.name: metric.value for metric in self.result.metrics}

    @property
    def models(self) -> dict[str, Mapping[str, Any]]:
        """Identified components, by kind, as a study takes them: ``Study(..., friction=result.models["friction"])``."""
        return {fit.kind: fit.component for fit in self.result.fits}

    @property
    def state_space(self) -> dict[str, Any]:
        """Matrices a, b, c, d, transfer function and dead time [s] of an identified plant; FraexpError without one."""
        found = self.service.models(self.result)
        if not found:
            raise FraexpError(f"sweep {self.key} has no identified plant; fit one with the estimator modal_fit")
        return next(iter(found.values()))

    def to_xarray(self) -> "xarray.Dataset":
        """Return the response over ``frequency`` with units, covariance and provenance, or the only curve.

        Experiment, estimator, metrics and the origin of each component are JSON in the attributes, so that the dataset
        survives ``to_netcdf`` and ``xarray.open_dataset`` with ``engine="h5netcdf"``. FraexpError if there is neither,
        or several curves.
        """
        if self.result.response is not None:
            return response_dataset(self.result.response, self._attributes())
        datasets = self.curves_to_xarray()
        if len(datasets) != 1:
            raise FraexpError(
                f"sweep {self.key} has no frequency response and {len(datasets)} curves; see curves_to_xarray()"
            )
        return datasets[0]

    def curves_to_xarray(self) -> "list[xarray.Dataset]":
        """Return each curve, such as a hysteresis loop, over ``point``."""
        return [curve_dataset(curve, self._attributes()) for curve in self.result.curves]

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the response as a table with the columns of the CSV export, indexed by ``frequency_Hz``."""
        return response_table(self.frequency_response, self._attributes())

    def to_frd(self) -> "control.FrequencyResponseData":
        """Return the response for python-control, bit by bit: from `input` to `output`, at 2π times the frequency.

        FraexpError if python-control is not installed.
        """
        control = import_optional("control", "to_frd()")
        found = self.frequency_response
        order = np.argsort(found.frequency)
        return control.FrequencyResponseData(
            found.response[order],
            2 * np.pi * found.frequency[order],
            inputs=[found.input],
            outputs=[found.output],
            name=f"{self.estimator}_{self.key}",
        )

    def plot(
        self, kind: str = "", frequency_range: tuple[float, float] | None = None, beside: Sequence["SweepResult"] = ()
    ) -> "Figure":
        """Return a matplotlib figure: the response with its 95 % band and the simulated plant, or the curves.

        Parameters
        ----------
        kind
            Kind of the figure, such as ``nyquist``; by default the one that fits the result.
        frequency_range
            Lowest and highest frequency [Hz].
        beside
            Other results to be drawn in the same axes, such as that of another estimator.
        """
        check_kind(kind, "plot: kind")
        if not all(isinstance(of, SweepResult) for of in beside):
            raise ParameterError(f"plot: beside is {beside!r:.60}; expected a list of results, such as run[1:]")
        shown = {of.key: of for of in (self, *beside)}
        sweeps = [replace(of.sweep, labels=of.labels or {"estimator": of.estimator}) for of in shown.values()]
        results = {of.sweep.key: of.result for of in shown.values()}
        return self.service.figures.figure(sweeps, results, self._title(), kind, frequency_view(frequency_range))

    def export(self, path: str | Path, force: bool = False) -> Path:
        """Write the result as .csv, .json, .mat or .h5 and return the path; `force` replaces a file.

        To .c, .h or .st the controller of the sweep is written as code.
        """
        target = require_path(path, "path")
        if is_there(target) and not force:
            raise FraexpError(f"{target}: the file exists; give force=True to replace it, or another name")
        if target.suffix.lower() in CONTROLLER_SUFFIXES:
            export_controller(self.service, self.sweep, self.result, target, force=force)
            return target
        header = {**self._attributes(), "models": self.service.models(self.result)}
        export(self.result, header, target, force=force)
        return target

    def _attributes(self) -> dict[str, Any]:
        sweep = self.sweep
        sources = {name: vars(origin) for name, origin in sweep.sources.items()}
        described = {
            "key": sweep.key,
            "labels": sweep.labels,
            "created": sweep.created.isoformat() if sweep.created else "",
            "experiment": sweep.experiment,
            "estimator": sweep.estimator,
            "sources": sources,
        }
        return {**{key: json_value(value) for key, value in described.items()}, **outcome_attributes(self.result)}

    def _title(self) -> str:
        return f"{self.estimator}, {self.key}"

    def __repr__(self) -> str:
        found = self.result.response
        span = ""
        if found is not None and found.frequency.size:
            low, high = found.frequency.min(), found.frequency.max()
            span = f", {found.output}/{found.input} [{found.unit}] at {found.frequency.size} frequencies"
            span += f" {low:.4g}…{high:.4g} Hz"
        return f"<SweepResult {self.key}: {self.estimator}{span}; {self.outcome}>"

    def _repr_html_(self) -> str:
        notes = [f"{self.estimator}: {self.outcome}", *([self.message] if self.message else [])]
        metrics = [f"{metric.name}: {number_text(metric.value)} {metric.unit}" for metric in self.result.metrics]
        table = text_tables.TextTable([], [])
        if self.result.response is not None and self.is_usable:
            table = text_tables.response_table(self.result.response, SHOWN_POINTS, self.result.parity_levels)
        has_figure = self.is_usable and (self.result.response is not None or bool(self.result.curves))
        figure = self.plot() if has_figure else None
        return page_part(f"Sweep {self.key}", [*notes, *metrics], figure, table.columns, table.rows)
