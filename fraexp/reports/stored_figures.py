"""Figures of stored results: what command line, terminal UI and reports draw, with the plant that was simulated."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.registry import Registry
from fraexp.data.figure_kinds import AGAINST_PLANT, OF_METRICS
from fraexp.data.results import Result
from fraexp.errors import FraexpError, PluginError, StoreError
from fraexp.figures.elements.bundles import MANY
from fraexp.figures.elements.label_units import label_units
from fraexp.figures.elements.labels import curve_names, drawn_names, group_names
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.elements.stamp import digest, is_current
from fraexp.figures.elements.view import ALL, View
from fraexp.simulation.machine import reference_response
from fraexp.store import Store, StoredSweep

AMPLITUDE = "excitation.amplitude"
"""Where a study says how strongly is excited."""
REFERENCE_POINTS = 800
"""Frequencies at which P(jω) is drawn: enough for a resonance with 1 % damping."""


@dataclass(frozen=True)
class StoredFigures:
    """Draws stored results with the components that are there now."""

    registry: Registry

    def draw(
        self,
        store: Store,
        sweeps: Sequence[StoredSweep],
        path: Path,
        title: str,
        kind: str = "",
        tell: Callable[[str], object] = lambda _: None,
        view: View = ALL,
    ) -> dict[Path, bool]:
        """Draw sweeps into a file for each unit of their responses: the first is `path`, then ``<name>-2`` and so on.

        `kind` is that of the figure, by default what fits the results. `tell` is called with what had to be left
        out: the plant's own response if its plugin is no longer there. Returns for each file whether it was drawn
        now or showed them already; nothing if there is nothing to draw.
        """
        results = store.results(sweep.key for sweep in sweeps)
        groups: dict[str | None, list[StoredSweep]] = {}
        for sweep in sweeps:
            result = results.get(sweep.key)
            if result and result.response and not all(0 < f < np.inf for f in result.response.frequency):
                raise StoreError(f"sweep {sweep.key[4:12]}: a stored frequency is not above 0; compute it again")
            if result and (result.response or result.curves or kind in OF_METRICS):
                groups.setdefault(result.response.unit if result.response else None, []).append(sweep)
        drawn: dict[Path, bool] = {}
        unfit: list[FraexpError] = []
        for group in groups.values():
            target = path.with_stem(f"{path.stem}-{len(drawn) + 1}") if drawn else path
            try:
                drawn[target] = self._draw_group(group, results, target, title, kind, tell, view)
            except FraexpError as error:  # a kind need not fit what other sweeps of the study have found
                unfit.append(error)
        if unfit and not (drawn and kind):
            raise unfit[0]
        return drawn

    def _draw_group(
        self,
        sweeps: Sequence[StoredSweep],
        results: Mapping[str, Result],
        path: Path,
        title: str,
        kind: str,
        tell: Callable[[str], object],
        view: View,
    ) -> bool:
        stamp = [f"{sweep.key} {sweep.created} {sorted(sweep.labels.items())}" for sweep in sweeps] + [title]
        stamp += group_names([sweep.labels for sweep in sweeps]) if len(sweeps) > MANY else []
        stamp += [f"as {kind}"] if kind else []
        stamp += view.options()
        if is_current(path, digest(stamp)):
            return False
        try:
            reference = self.reference(sweeps, results)
        except PluginError as error:  # what is stored can be drawn without the plugins that computed it
            tell(f"the plant's own response is left out: {error}")
            reference, stamp = None, [*stamp, "without the plant"]
        from fraexp.figures.drawing import figure_for, save  # matplotlib: only when something is drawn

        shown = self.shown(sweeps, results, kind in AGAINST_PLANT)
        save(figure_for(shown, reference, title, kind, view), path, stamp)
        return True

    def shown(
        self, sweeps: Sequence[StoredSweep], results: Mapping[str, Result], fully: bool = True
    ) -> list[ShownResult]:
        """Return the results of sweeps with their names; `fully`, with P(jω) and the amplitude where they are known."""
        units = label_units(((s.labels, {**s.experiment, "estimator": s.estimator}) for s in sweeps), self.registry)
        labels, keys = [sweep.labels for sweep in sweeps], [sweep.key[4:12] for sweep in sweeps]
        names, groups = curve_names(labels, keys, units), group_names(labels, units)
        found = [
            (sweep, ShownResult(name, results[sweep.key], group, key=sweep.key, drawn=drawn))
            for sweep, name, group, drawn in zip(sweeps, names, groups, drawn_names(labels, units), strict=True)
            if sweep.key in results
        ]
        if not fully:
            return [shown for _, shown in found]
        others = [{path: value for path, value in of.labels.items() if path != AMPLITUDE} for of, _ in found]
        series = curve_names(others, [""] * len(found), units)
        return [
            replace(of, truth=self._truth(sweep, of.result), series=name, **self._amplitude(sweep))
            for (sweep, of), name in zip(found, series, strict=True)
        ]

    def _truth(self, sweep: StoredSweep, result: Result) -> np.ndarray | None:
        """Return P(jω) at a result's frequencies if its response is that of a plant that can be made."""
        response = result.response
        if response is None or response.unit != "m/N" or "plant" not in sweep.experiment:
            return None
        try:
            return reference_response(sweep.experiment, response.frequency, self.registry)
        except PluginError:  # no longer there
            return None

    def _amplitude(self, sweep: StoredSweep) -> dict[str, Any]:
        value = sweep.experiment.get("excitation", {}).get("amplitude")
        if isinstance(value, bool) or not isinstance(value, int | float):
            return {}
        unit = label_units([({AMPLITUDE: value}, sweep.experiment)], self.registry).get(AMPLITUDE, "")
        return {"amplitude": float(value), "amplitude_unit": unit}

    def reference(
        self, sweeps: Sequence[StoredSweep], results: Mapping[str, Result]
    ) -> tuple[str, np.ndarray, np.ndarray] | None:
        """Return label, frequency [Hz] and P(jω) [m/N] if all sweeps are simulations of the same plant in this unit."""
        responses = [results[sweep.key].response for sweep in sweeps]
        frequencies = [response.frequency for response in responses if response and response.unit == "m/N"]
        plants = [sweep.experiment.get("plant") for sweep in sweeps]
        if not frequencies or plants[0] is None or any(plant != plants[0] for plant in plants):
            return None
        everything = np.concatenate(frequencies)
        frequency = np.geomspace(everything.min(), everything.max(), REFERENCE_POINTS)
        return "P(s), linear plant", frequency, reference_response(sweeps[0].experiment, frequency, self.registry)
