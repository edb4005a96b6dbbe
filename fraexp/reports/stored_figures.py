"""Figures of stored results, with the simulated plant, for the command line, the terminal UI and reports."""

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.components.registry import Registry
from fraexp.data.figure_kinds import AGAINST_PLANT, OF_METRICS
from fraexp.data.identity import content_hash
from fraexp.data.results import FrequencyResponse, Result
from fraexp.errors import FraexpError, PluginError, StoreError
from fraexp.figures.elements.grouping import ShownResult, group_sweeps
from fraexp.figures.elements.labels import curve_names, describe_draws
from fraexp.figures.elements.scales import PLANT_UNITS
from fraexp.figures.elements.stamp import is_current, stamp_digest
from fraexp.figures.elements.view import FULL_VIEW, View
from fraexp.simulation.machine import reference_response
from fraexp.store import Store, StoredSweep, leave_out_damaged
from fraexp.study.paths import label_units

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fraexp.figures.kinds.bode import Reference

AMPLITUDE_PATH = "excitation.amplitude"
"""Path of the excitation's amplitude in a study."""
REFERENCE_POINTS = 800
"""Frequencies at which P(jω) is drawn: enough for a resonance with 1 % damping."""


@dataclass(frozen=True)
class StoredFigures:
    """Draws stored results with the present components."""

    registry: Registry

    def draw(
        self,
        store: Store,
        sweeps: Sequence[StoredSweep],
        path: Path,
        title: str,
        kind: str = "",
        warn: Callable[[str], object] = lambda _: None,
        view: View = FULL_VIEW,
        by: Sequence[str] | None = None,
    ) -> dict[Path, bool]:
        """Draw sweeps into a file for each unit of their responses: the first is `path`, then ``<name>-2`` and so on.

        `kind` is the kind of the figure, by default the one that fits the results; `by` are the labels that separate
        groups, see `group_sweeps`. `warn` is called with a warning if the response of the plant is left out because
        its plugin is missing. Returns for each file whether it was drawn now; otherwise it was up to date. No file is
        drawn if the sweeps have nothing to draw.
        """
        results = store.results(sweep.key for sweep in sweeps)
        sweeps = leave_out_damaged(sweeps, results, warn)
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
                drawn[target] = self._draw_group(group, results, target, title, kind, warn, view, by)
            except FraexpError as error:  # a kind may not fit the results of other sweeps of the study
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
        warn: Callable[[str], object],
        view: View,
        by: Sequence[str] | None,
    ) -> bool:
        stamp = [f"{sweep.key} {_content(results[sweep.key])} {sorted(sweep.labels.items())}" for sweep in sweeps]
        stamp += [title]
        stamp += [f"by {path}" for path in by] if by is not None else []
        stamp += [f"as {kind}"] if kind else []
        stamp += view.options()
        if is_current(path, stamp_digest(stamp)):
            return False
        try:
            reference = self.reference(sweeps, results)
        except PluginError as error:  # results can be drawn without the plugins that computed them
            warn(f"the plant's own response is left out: {error}")
            reference, stamp = None, [*stamp, "without the plant"]
        from fraexp.figures.drawing import draw_figure, save_figure  # matplotlib: only when something is drawn

        shown = self.shown_results(sweeps, results, kind in AGAINST_PLANT, by)
        save_figure(draw_figure(shown, reference, title, kind, view), path, stamp)
        return True

    def figure(
        self,
        sweeps: Sequence[StoredSweep],
        results: Mapping[str, Result],
        title: str = "",
        kind: str = "",
        view: View = FULL_VIEW,
        by: Sequence[str] | None = None,
    ) -> "Figure":
        """Return a figure of results, by sweep key, without a file; see `draw` for `kind` and `by`."""
        from fraexp.figures.drawing import draw_figure

        try:
            reference = self.reference(sweeps, results)
        except PluginError:  # of a plant whose plugin is missing
            reference = None
        shown = self.shown_results(sweeps, results, kind in AGAINST_PLANT, by)
        return draw_figure(shown, reference, title, kind, view)

    def shown_results(
        self,
        sweeps: Sequence[StoredSweep],
        results: Mapping[str, Result],
        fully: bool = True,
        by: Sequence[str] | None = None,
    ) -> list[ShownResult]:
        """Return the results of sweeps with names and places; if `fully`, also with P(jω) and the amplitude if known.

        `by` are the labels that separate groups, see `group_sweeps`.
        """
        units = label_units(((s.labels, s.sections) for s in sweeps), self.registry)
        labels, keys = [sweep.labels for sweep in sweeps], [sweep.key[4:12] for sweep in sweeps]
        spare = (
            keys
            if len(sweeps) > 1
            else [str(sweep.estimator.get("name", key)) for sweep, key in zip(sweeps, keys, strict=True)]
        )
        names, places = curve_names(labels, spare, units), group_sweeps(labels, units, by, keys)
        found = [
            (sweep, ShownResult(name, results[sweep.key], place, key=sweep.key, drawn=drawn))
            for sweep, name, place, drawn in zip(sweeps, names, places, describe_draws(labels, units), strict=True)
            if sweep.key in results
        ]
        if not fully:
            return [shown for _, shown in found]
        others = [{path: value for path, value in of.labels.items() if path != AMPLITUDE_PATH} for of, _ in found]
        series = curve_names(others, [""] * len(found), units)
        return [
            self._with_amplitude(replace(of, truth=self._truth(sweep, of.response), series=name), sweep)
            for (sweep, of), name in zip(found, series, strict=True)
        ]

    def _truth(self, sweep: StoredSweep, response: FrequencyResponse | None) -> NDArray[np.complex128] | None:
        """Return P(jω) at the frequencies of a response if its plant is known and its plugin exists."""
        if response is None or response.unit not in PLANT_UNITS or "plant" not in sweep.experiment:
            return None
        try:
            return reference_response(sweep.experiment, response.frequency, self.registry, response.output)
        except PluginError:  # its plugin is missing
            return None

    def _with_amplitude(self, shown: ShownResult, sweep: StoredSweep) -> ShownResult:
        value = sweep.experiment.get("excitation", {}).get("amplitude")
        if isinstance(value, bool) or not isinstance(value, int | float):
            return shown
        unit = label_units([({AMPLITUDE_PATH: value}, sweep.experiment)], self.registry).get(AMPLITUDE_PATH, "")
        return replace(shown, amplitude=float(value), amplitude_unit=unit)

    def reference(self, sweeps: Sequence[StoredSweep], results: Mapping[str, Result]) -> "Reference | None":
        """Return label, frequency [Hz] and P(jω) [m/N] if all sweeps show the same response of the same plant."""
        responses = [results[sweep.key].response for sweep in sweeps]
        shown = [response for response in responses if response and response.unit in PLANT_UNITS]
        frequencies, outputs = [response.frequency for response in shown], {response.output for response in shown}
        plants = [(sweep.experiment.get("plant"), *_ports_of_loop(sweep)) for sweep in sweeps]
        if len(outputs) != 1 or plants[0][0] is None or any(plant != plants[0] for plant in plants):
            return None
        everything = np.concatenate(frequencies)
        frequency = np.geomspace(everything.min(), everything.max(), REFERENCE_POINTS)
        plant = reference_response(sweeps[0].experiment, frequency, self.registry, outputs.pop())
        return "P(s), linear plant", frequency, plant


def _content(result: Result) -> str:
    """Return a hash of what a result says: whoever computes the same again keeps the figure."""
    return content_hash(pickle.dumps(replace(result, elapsed=0.0), pickle.HIGHEST_PROTOCOL))


def _ports_of_loop(sweep: StoredSweep) -> tuple[object, object]:
    """Return the names of thrust and position that the loop uses; None for the plant's first."""
    loop = sweep.experiment.get("loop", {})
    return loop.get("thrust"), loop.get("position")
