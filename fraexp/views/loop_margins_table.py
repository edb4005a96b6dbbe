"""Margins of the loop that a sweep's controller closes around its measured response."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import degrees_of_freedom, interval_factor, relative_deviations
from fraexp.analysis.delays import hold_response, image_factor, path_response
from fraexp.analysis.stability_margins import LoopFigure, LoopResponse, loop_figures
from fraexp.components.kinds import Controller
from fraexp.components.registry import Registry, create
from fraexp.data.results import FrequencyResponse, Result
from fraexp.data.sweep import Plain
from fraexp.errors import FraexpError
from fraexp.figures.elements.scales import PLANT_UNITS, decibel
from fraexp.simulation.machine import ControlLoop
from fraexp.store import StoredSweep
from fraexp.views.words import number_text

CONTROL_INPUT = "u"
"""Input of a response that contains hold and delays, unless it was referred to the plant."""
PLANT_RELATIVE_DEGREE = 2
LOOP_COLUMNS = ["loop", "value", "± 95 %", "unit", "at [Hz]"]


def loop_margins(
    sweep: StoredSweep, result: Result | None, registry: Registry, around: Plain | None = None
) -> list[LoopFigure]:
    """Return crossover, bandwidth and each margin of a sweep's loop; none without a controller or a response.

    `around` are sections with the controller and the loop of a machine whose response was measured; those of the sweep
    if they are not given.

    A response without friction, such as that of an effective input, gives the loop at large motions; one with friction
    the loop at the amplitude of its experiment. A loop that was measured was stable: the margins need no other test.
    """
    response = result.response if result else None
    sections = around or sweep.experiment
    if response is None or response.unit not in PLANT_UNITS or not sections.get("controller"):
        return []
    try:
        controller = create(registry, Controller, sections["controller"])
    except FraexpError:  # its plugin is not installed here
        return []
    loop = ControlLoop.model_validate(sections["loop"])
    return loop_figures(_open_loop(response, controller, loop, sweep.estimator))


def loop_rows(figures: Sequence[LoopFigure]) -> list[list[str]]:
    """Return a row under `LOOP_COLUMNS` for each figure."""
    return [_row(figure) for figure in figures]


def _open_loop(
    response: FrequencyResponse, controller: Controller, loop: ControlLoop, estimator: Plain
) -> LoopResponse:
    """Return C G of the settled points with their 95 % half widths."""
    order = np.argsort(response.frequency, kind="stable")
    order = order[(response.settled & np.isfinite(response.response) & (response.response != 0))[order]]
    omega = 2 * np.pi * response.frequency[order]
    path = np.ones(omega.size, dtype=np.complex128) if _has_path(response, estimator) else _loop_path(loop, omega)
    factor = interval_factor(degrees_of_freedom(response))[order]
    along, across = relative_deviations(response.response[order], response.covariance[order])
    return LoopResponse(
        response.frequency[order],
        response.response[order] * path * controller.response(omega, loop.sample_time),
        factor * along,
        factor * across,
    )


def _has_path(response: FrequencyResponse, estimator: Mapping[str, Any]) -> bool:
    """Return whether a response contains hold and delays of the loop."""
    inner = estimator.get("method")
    if isinstance(inner, Mapping):
        return _has_path(response, inner)
    return response.input == CONTROL_INPUT and not estimator.get("refer_to_plant", False)


def _loop_path(loop: ControlLoop, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return hold, delays and aliasing images between control input and sample, shape (n,)."""
    dead_time = loop.input_dead_time + loop.output_dead_time
    lags = (*loop.input_time_constants, *loop.output_time_constants)
    images = image_factor(omega, loop.sample_time, dead_time, lags, PLANT_RELATIVE_DEGREE)
    return path_response(omega, dead_time, lags) * hold_response(omega, loop.sample_time) * images


def _row(figure: LoopFigure) -> list[str]:
    value, half, unit = figure.value, figure.half_width, figure.unit
    if unit == "rad":
        value, half, unit = np.degrees(value), np.degrees(half), "deg"
    elif figure.name.startswith("gain"):
        half = 20 / np.log(10) * half / value
        value, unit = float(decibel(np.array([value]))[0]), "dB"
    spread = number_text(half, 2) if np.isfinite(half) and half > 0 else ""
    at = "" if figure.name in ("crossover", "bandwidth") else number_text(figure.frequency, 4)
    return [figure.name, number_text(value, 4), spread, "" if unit == "1" else unit, at]
