"""Levels of a response and of its disturbances: noise, and stochastic nonlinear distortions."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import PARITIES, FrequencyResponse, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.frequency_lines import GroupedLine
from fraexp.figures.elements.grouping import CurvePlace, ShownResult
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
