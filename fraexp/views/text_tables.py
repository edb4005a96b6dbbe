"""Tables of sweeps and of responses as text."""

import itertools
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.components.registry import Registry
from fraexp.data.results import EFFORT, FrequencyResponse, Result
from fraexp.data.units import factor, with_powers
from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import label_columns, label_texts
from fraexp.figures.elements.scales import (
    column_unit,
    continuous_phase,
    decibel,
    decibel_limits,
    degrees,
    readable_unit,
)
from fraexp.figures.result_files import channel_units
from fraexp.store import StoredSweep
from fraexp.study.published_values import HALF_WIDTH_ENDING, half_widths, interval_text
from fraexp.views.fields import outcome_text, sweep_units
from fraexp.views.words import fixed_text, number_text, plural, scale_values, short_key, with_unit

REFERENCE_FREQUENCIES_HZ = (1.0, 10.0, 40.0, 80.0)
"""Preferred frequencies [Hz] of the magnitude columns in a table of sweeps."""
MAX_METRIC_COLUMNS = 6
"""Maximum number of metric columns in a table of sweeps."""
SAME_FREQUENCY_FACTOR = 1.005
"""Frequencies within this factor share a column."""


class TextTable(NamedTuple):
    """A table of texts, whatever prints it."""

    columns: list[str]
    """Titles of the columns."""
    rows: list[list[str]]
    title: str = ""


@dataclass(frozen=True)
class SweepNumbers:
    """A number of each of several sweeps, which some may lack."""

    title: str
    values: NDArray[np.float64]
    """One for each sweep, NaN where it is missing, shape (n,)."""
    decimals: int | None = None
    """Decimals to show; None for six significant digits."""
    halves: NDArray[np.float64] | None = None
    """Half widths of their 95 % intervals, NaN where unknown, shape (n,)."""

    def text(self, value: float, digits: int = 6) -> str:
        """Return a value as text."""
        return number_text(value, digits) if self.decimals is None else fixed_text(value, self.decimals)

    def texts(self) -> list[str]:
        """Return all values with the half widths that are known; a missing value is empty."""
        halves = np.full(self.values.size, np.nan) if self.halves is None else self.halves
        return [
            "" if np.isnan(value) else interval_text(value, half) if half > 0 else self.text(value)
            for value, half in zip(self.values.tolist(), halves.tolist(), strict=True)
        ]


def sweep_table(
    sweeps: Sequence[StoredSweep],
    results: Mapping[str, Result],
    registry: Registry,
    stated: Mapping[str, str] | None = None,
    most: int | None = MAX_METRIC_COLUMNS,
) -> TextTable:
    """Return a row for each sweep: labels, outcome, settled points, some magnitudes, metrics, message.

    Empty columns are left out. `stated` has the units in which a study gives metrics, by their names; `most` is the
    number of metrics, None for all, those of the effort included.
    """
    found = [results.get(sweep.key) for sweep in sweeps]
    labels = label_values(sweeps, registry)
    spots, unit = magnitudes(found)
    metrics = metric_quantities(found, stated, is_whole=most is None)
    mixed = len({sweep.state for sweep in sweeps}) > 1
    columns = [
        ("sweep", [short_key(sweep.key) for sweep in sweeps]),
        *((title, label_texts(values)) for title, values in labels.values()),
        *([("state", [sweep.state for sweep in sweeps])] if mixed else []),
        ("outcome", [outcome_text(sweep) for sweep in sweeps]),
        ("settled", [_settled_text(result) for result in found]),
        *((of.title, of.texts()) for of in (*spots, *metrics[:most])),
        ("message", [sweep.message for sweep in sweeps]),
    ]
    notes = [f"magnitudes in dB re 1 {unit}"] if spots else []
    left_out = len(metrics[most:]) if most is not None else 0
    notes += [f"{plural(left_out, 'more metric')} of each sweep: fraexp show KEY"] if left_out else []
    kept = [(title, texts) for title, texts in columns if any(texts)]
    rows = [list(row) for row in zip(*(texts for _, texts in kept), strict=True)]
    return TextTable([title for title, _ in kept], rows, "; ".join(notes))


def label_values(sweeps: Sequence[StoredSweep], registry: Registry) -> dict[str, tuple[str, list[object]]]:
    """Return title and values of each label by its path, in the unit in which people read them."""
    units = sweep_units(sweeps, registry)
    found = {}
    for path, title in label_columns([sweep.labels for sweep in sweeps]).items():
        values, unit = scale_values([sweep.labels.get(path) for sweep in sweeps], units.get(path, ""))
        found[path] = (with_unit(title, f"[{unit}]" if unit else ""), values)
    return found


def metric_quantities(
    results: Sequence[Result | None], stated: Mapping[str, str] | None = None, is_whole: bool = False
) -> list[SweepNumbers]:
    """Return the metrics of results, the first ones of each first; next to a response the effort only if `is_whole`."""
    values = [{(of.name, of.unit): of.value for of in result.metrics} if result else {} for result in results]
    halves = [half_widths(result) if result else {} for result in results]
    beside = [EFFORT if result and result.response is not None and not is_whole else () for result in results]
    each = itertools.zip_longest(
        *([of for of in row if of[0] not in omitted] for row, omitted in zip(values, beside, strict=True))
    )
    quantities = []
    for name, unit in dict.fromkeys(of for row in each for of in row if of):
        if any(name.removesuffix(HALF_WIDTH_ENDING) in known for known in halves) and name.endswith(HALF_WIDTH_ENDING):
            continue  # it stands behind its number
        column = np.array([row.get((name, unit), np.nan) for row in values], dtype=float)
        scale, shown = _metric_scale(column, unit, (stated or {}).get(name))
        widths = scale * np.array([half.get(name, np.nan) for half in halves], dtype=float)
        quantities.append(
            SweepNumbers(with_unit(name, f"[{shown}]" if shown not in ("", "1") else ""), scale * column, None, widths)
        )
    return quantities


def _metric_scale(values: NDArray[np.float64], unit: str, stated: str | None) -> tuple[float, str]:
    """Return the factor to the unit of a column, and this unit: the one in which a study gives it, if that is one."""
    with suppress(FraexpError):  # the table of published numbers reports it
        if stated:
            return factor(unit, stated), with_powers(stated)
    return column_unit(values.tolist(), unit)


def magnitudes(results: Sequence[Result | None]) -> tuple[list[SweepNumbers], str]:
    """Return the magnitudes [dB] at some frequencies of the first response, and the unit of 0 dB."""
    responses = [result.response if result and result.response else None for result in results]
    known = [response for response in responses if response and len(response.frequency)]
    spots, unit = reference_frequencies(known)
    return [
        SweepNumbers(
            title,
            np.array([magnitude_near(of, spot) if of and len(of.frequency) else np.nan for of in responses]),
            decimals=2,
        )
        for title, spot in spots.items()
    ], unit


def reference_frequencies(responses: Sequence[FrequencyResponse]) -> tuple[dict[str, float], str]:
    """Return frequencies [Hz] of the first response by column title, and the unit of 0 dB."""
    if len({response.unit for response in responses}) != 1:
        return {}, ""
    grid = np.sort(responses[0].frequency)
    inside = [
        spot
        for spot in REFERENCE_FREQUENCIES_HZ
        if grid[0] / SAME_FREQUENCY_FACTOR <= spot <= grid[-1] * SAME_FREQUENCY_FACTOR
    ]
    wanted = inside if len(inside) > 2 else np.geomspace(grid[0], grid[-1], len(REFERENCE_FREQUENCIES_HZ))
    spots = sorted({float(grid[np.argmin(np.abs(np.log(grid / spot)))]) for spot in wanted})
    digits = next((count for count in range(3, 17) if len({f"{spot:.{count}g}" for spot in spots}) == len(spots)), 17)
    return {f"{spot:.{digits}g} Hz": spot for spot in spots}, readable_unit(responses[0].unit)[1]


def _settled_text(result: Result | None) -> str:
    response = result.response if result else None
    known = response is not None and len(response.frequency)
    return f"{int(response.settled.sum())}/{len(response.settled)}" if response is not None and known else ""


def magnitude_near(response: FrequencyResponse, spot: float) -> float:
    """Return the magnitude [dB] at the point nearest to `spot` [Hz]; NaN without a settled point nearby."""
    index = int(np.argmin(np.abs(np.log(response.frequency / spot))))
    near = spot / SAME_FREQUENCY_FACTOR <= response.frequency[index] <= spot * SAME_FREQUENCY_FACTOR
    level = decibel(readable_unit(response.unit)[0] * response.response[[index]])[0]
    return float(level) if near and response.settled[index] else np.nan


def response_table(
    response: FrequencyResponse, rows: int | None, parities: Mapping[str, NDArray[np.float64]] | None = None
) -> TextTable:
    """Return the points of a response: about `rows` of them, spread evenly, or all.

    Numerical is the error by the computation itself, as estimated; it is part of the 95 %. Noise is the standard
    deviation of the response by noise alone, nonlinear that of one realisation by stochastic
    nonlinear distortions, both relative to the response. `parities` are the levels of odd and even distortions, if
    they are told apart (see `Result.parity_levels`), which then have a column each.
    """
    parities = parities or {}
    scale, shown = readable_unit(response.unit)
    output_unit, input_unit = (f" [{unit}]" if unit else "" for unit in channel_units(response))
    level, phase = decibel(scale * response.response), continuous_phase(degrees(response.response), response.settled)
    magnitude, turn = confidence_limits(response)
    spread = decibel_limits(magnitude)
    noise, nonlinear = (_relative_db(part, response) for part in (response.noise_variance, response.nonlinear_variance))
    unknown = np.full(len(level), np.nan)
    coherence = unknown if response.coherence is None else response.coherence
    numerical = unknown if response.numerical_error is None else decibel(1 + response.numerical_error)
    columns = [
        "frequency [Hz]", f"magnitude [dB re 1 {shown}]", "phase [deg]", "± 95 % [dB]", "± 95 % [deg]",
        "numerical [dB]", "noise [dB]", "nonlinear [dB]", *(f"{name} [dB]" for name in parities), "coherence",
        f"input{input_unit}", f"output{output_unit}", "distortion [%]", "settled", "after [s]",
    ]  # fmt: skip
    apart = [decibel(level) for level in parities.values()]
    count = len(response.frequency)
    indices = range(count) if rows is None or count <= rows else np.linspace(0, count - 1, rows).round().astype(int)
    cells = [
        [
            number_text(response.frequency[index]),
            fixed_text(level[index], 3),
            fixed_text(phase[index], 2),
            _optional_number(np.max(np.abs(spread[:, index]))),
            _optional_number(np.degrees(np.max(np.abs(turn[:, index])))),
            _optional_number(numerical[index]),
            _optional_fixed(noise[index], 1),
            _optional_fixed(nonlinear[index], 1),
            *(_optional_fixed(level[index], 1) for level in apart),
            _optional_fixed(coherence[index], 4),
            number_text(response.input_amplitude[index], 4),
            number_text(response.output_amplitude[index], 4),
            number_text(100 * response.distortion[index], 3),
            "yes" if response.settled[index] else "no",
            _optional_number(response.settling_time[index]),
        ]
        for index in indices
    ]
    return TextTable(columns, cells)


def _relative_db(variance: NDArray[np.float64] | None, response: FrequencyResponse) -> NDArray[np.float64]:
    """Return a standard deviation relative to the response [dB], shape (n,); NaN where it is not known."""
    if variance is None:
        return np.full(len(response.frequency), np.nan)
    return decibel(np.sqrt(np.maximum(variance, 0))) - decibel(response.response)


def _optional_fixed(value: float, decimals: int) -> str:
    return fixed_text(value, decimals) if np.isfinite(value) else ""


def _optional_number(value: float) -> str:
    return "" if np.isnan(value) else "∞" if np.isinf(value) else number_text(value, 3)
