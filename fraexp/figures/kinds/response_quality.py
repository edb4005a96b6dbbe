"""Quality of measured responses: coherence and harmonic distortion; levels of noise and of nonlinear distortions."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import PARITIES, FrequencyResponse, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import GroupedLine
from fraexp.figures.elements.grouping import CurvePlace, ShownResult, curve_places
from fraexp.figures.elements.panel_figure import Panel, PanelFigure, over_frequency
from fraexp.figures.elements.scales import decibel, readable_unit

MAX_PANELS = 12
"""Maximum number of panels in a figure."""
QUANTITIES = (
    "response",
    "total, of the mean",
    "noise, of the mean",
    "nonlinear, of one realisation",
    *(f"{parity} distortions, of one realisation" for parity in PARITIES),
)
"""Quantities that are drawn: |Ĝ|, and standard deviations √E|dG|²; those of odd and even distortions have its noise."""


def levels_info(shown: Sequence[ShownResult], title: str = "") -> PanelFigure:
    """Return the known ones of `QUANTITIES` [dB], each response as a facet; FraexpError if no response has one."""
    known = [of for of in shown if of.response is not None and _has_levels(of.response)]
    if not known:
        raise FraexpError(
            "levels: no response has noise or nonlinear distortions; record several periods, or several "
            "realisations of a multisine"
        )
    if len(known) > MAX_PANELS:
        raise FraexpError(
            f"levels: found {len(known)} responses; no more than {MAX_PANELS} panels fit; choose fewer sweeps"
        )
    units = {of.response.unit for of in known if of.response}
    if len(units) > 1:
        raise FraexpError(f"levels: found responses in {' and '.join(sorted(units))}; choose sweeps that share a unit")
    factor, unit = readable_unit(units.pop())
    labels = [of.label for of in known]
    names = [of if labels.count(of) == 1 else f"{of} ({number})" for number, of in enumerate(labels, start=1)]
    lines = [line for name, of in zip(names, known, strict=True) for line in _level_lines(name, of.result, factor)]
    panel = Panel(f"Level [dB re 1 {unit}]", "dB", tuple(lines), height=3.4)
    return over_frequency(title or "Levels of noise and distortion", panel)


def _has_levels(response: FrequencyResponse) -> bool:
    apart = (response.noise_variance, response.nonlinear_variance)
    return any(part is not None for part in apart) or bool(np.isfinite(response.standard_deviation).any())


def _level_lines(facet: str, result: Result, factor: float) -> list[GroupedLine]:
    response = result.response
    assert response is not None
    order = np.argsort(response.frequency, kind="stable")
    sizes: dict[str, NDArray[np.float64] | None] = {
        QUANTITIES[0]: np.abs(response.response),
        QUANTITIES[1]: response.standard_deviation,
        QUANTITIES[2]: _standard_deviation(response.noise_variance),
        QUANTITIES[3]: _standard_deviation(response.nonlinear_variance),
    }
    for of, name in zip(QUANTITIES[4:], PARITIES, strict=True):
        if name in result.parity_levels:  # they say more than their sum, which would hide the greater one
            sizes[of], sizes[QUANTITIES[3]] = result.parity_levels[name] * np.abs(response.response), None
    frequency, settled = response.frequency[order], response.settled[order]
    levels = {name: decibel(factor * size[order]) for name, size in sizes.items() if size is not None}
    return [
        GroupedLine(name, CurvePlace(facet, name, name), frequency, level, settled & np.isfinite(level))
        for name, level in levels.items()
        if np.isfinite(level).any()
    ]


def _standard_deviation(variance: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    return None if variance is None else np.sqrt(np.maximum(variance, 0))


LOG_AXIS_RATIO = 10.0
"""Ratio of largest to smallest distortion above which its axis is logarithmic."""


def coherence_info(shown: Sequence[ShownResult], title: str = "") -> PanelFigure:
    """Return coherence and distortion of the responses for which one is known; FraexpError if there is none."""
    rows: dict[str, list[GroupedLine]] = {"coherence": [], "distortion": []}
    for of, place in zip(shown, curve_places(shown), strict=True):
        if (response := of.response) is not None:
            known: dict[str, NDArray[np.float64] | None] = {
                "coherence": response.coherence, "distortion": 100 * response.distortion,
            }  # fmt: skip
            for part, values in known.items():
                if values is not None and np.isfinite(values).any():
                    line = GroupedLine(of.label, place, response.frequency, values, response.settled, key=of.key)
                    rows[part].append(line)
    if not any(rows.values()):
        raise FraexpError(
            "coherence: no response has coherence or distortion; a stepped sine gives distortion, and a spectral "
            "estimator gives coherence"
        )
    sizes = np.concatenate([np.zeros(0), *(line.y for line in rows["distortion"])])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    is_log = bool(sizes.size) and bool(sizes.max() > LOG_AXIS_RATIO * sizes.min())
    panels = (
        Panel("Squared coherence [1]", "", tuple(rows["coherence"]), span=(0.0, 1.05)),
        Panel("Harmonic distortion [%]", "%", tuple(rows["distortion"]), is_log),
    )
    return over_frequency(title or "Coherence and distortion", *(panel for panel in panels if panel.lines))
