"""Tables of sweeps and of responses as text."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.components.registry import Registry
from fraexp.data.results import EFFORT, FrequencyResponse, Result
from fraexp.figures.elements.label_units import label_units
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
from fraexp.views.fields import outcome_text
from fraexp.views.words import fixed_text, number_text, plural, short_key

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


def sweep_table(sweeps: Sequence[StoredSweep], results: Mapping[str, Result], registry: Registry) -> TextTable:
    """Return a row for each sweep: labels, outcome, settled points, some magnitudes, metrics, message."""
    labels = label_columns([sweep.labels for sweep in sweeps])
    units = label_units(((sweep.labels, sweep.sections) for sweep in sweeps), registry)
    scales = {path: column_unit([of.labels.get(path) for of in sweeps], units.get(path, "")) for path in labels}
    titles = [f"{title} [{scales[path][1]}]" if path in units else title for path, title in labels.items()]
    found = [results[sweep.key].response for sweep in sweeps if sweep.key in results]
    responses = [response for response in found if response is not None and len(response.frequency)]
    spots, unit = reference_frequencies(responses)
    each = itertools.zip_longest(
        *(_main_metrics(result) for result in results.values())
    )  # the first ones of each come first
    telling = list(dict.fromkeys(name for row in each for name in row if name))
    metrics = telling[:MAX_METRIC_COLUMNS]
    known = [of for result in results.values() for of in result.metrics]
    sizes = {pair: column_unit([of.value for of in known if (of.name, of.unit) == pair], pair[1]) for pair in metrics}
    mixed = len({sweep.state for sweep in sweeps}) > 1
    columns = [
        "sweep", *titles, *(["state"] if mixed else []), "outcome", "settled", *spots,
        *(f"{name} [{sizes[name, unit][1]}]" if unit not in ("", "1") else name for name, unit in metrics), "message",
    ]  # fmt: skip
    texts = {
        path: label_texts([_scaled(sweep.labels.get(path), scales[path][0]) for sweep in sweeps]) for path in labels
    }
    rows = []
    for index, sweep in enumerate(sweeps):
        result = results.get(sweep.key)
        values = {(metric.name, metric.unit): metric.value for metric in result.metrics} if result else {}
        rows.append([
            short_key(sweep.key), *(texts[path][index] for path in labels),
            *([sweep.state] if mixed else []), outcome_text(sweep),
            *_response_cells(result.response if result else None, spots.values()),
            *(number_text(sizes[of][0] * values[of]) if of in values else "" for of in metrics), sweep.message,
        ])  # fmt: skip
    notes = [f"magnitudes in dB re 1 {unit}"] if spots else []
    left_out = len(telling) - len(metrics)
    notes += [f"{plural(left_out, 'more metric')} of each sweep: fraexp show KEY"] if left_out else []
    return TextTable(columns, rows, "; ".join(notes))


def _scaled(value: object, factor: float) -> object:
    """Return a number in another unit; a number that needs none, and anything else, stays as it is."""
    if factor == 1 or isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(f"{value * factor:.12g}")


def _main_metrics(result: Result) -> list[tuple[str, str]]:
    """Return names and units of the metrics that a row shows: next to a response, not the effort."""
    beside = EFFORT if result.response is not None else ()
    return [(metric.name, metric.unit) for metric in result.metrics if metric.name not in beside]


def reference_frequencies(responses: Sequence[FrequencyResponse]) -> tuple[dict[str, float], str]:
    """Return frequencies [Hz] of the first response by column title, and the unit of 0 dB."""
    if len({response.unit for response in responses}) != 1:
        return {}, ""
    grid = np.unique(responses[0].frequency)
    inside = [
        spot
        for spot in REFERENCE_FREQUENCIES_HZ
        if grid[0] / SAME_FREQUENCY_FACTOR <= spot <= grid[-1] * SAME_FREQUENCY_FACTOR
    ]
    wanted = inside if len(inside) > 2 else np.geomspace(grid[0], grid[-1], len(REFERENCE_FREQUENCIES_HZ))
    spots = sorted({float(grid[np.argmin(np.abs(np.log(grid / spot)))]) for spot in wanted})
    digits = next((count for count in range(3, 17) if len({f"{spot:.{count}g}" for spot in spots}) == len(spots)), 17)
    return {f"{spot:.{digits}g} Hz": spot for spot in spots}, readable_unit(responses[0].unit)[1]


def _response_cells(response: FrequencyResponse | None, spots: Iterable[float]) -> list[str]:
    if response is None or not len(response.frequency):
        return ["", *("" for _ in spots)]
    return [
        f"{int(response.settled.sum())}/{len(response.settled)}",
        *(_optional_fixed(magnitude_near(response, spot), 2) for spot in spots),
    ]


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
    factor, shown = readable_unit(response.unit)
    output_unit, input_unit = (f" [{unit}]" if unit else "" for unit in channel_units(response))
    level, phase = decibel(factor * response.response), continuous_phase(degrees(response.response), response.settled)
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
