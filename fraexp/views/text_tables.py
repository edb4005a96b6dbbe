"""Tables of sweeps and of responses."""

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from fraexp.analysis.confidence import limits
from fraexp.components.registry import Registry
from fraexp.data.results import EFFORT, FrequencyResponse, Result
from fraexp.figures.elements.label_units import label_units
from fraexp.figures.elements.labels import label_columns, label_texts
from fraexp.figures.elements.scales import continuous_phase, decibel, decibel_limits, degrees, readable_unit
from fraexp.figures.export.content import channel_units
from fraexp.store import StoredSweep
from fraexp.views.fields import outcome_text
from fraexp.views.words import fixed, number, plural, short

SPOTS = (1.0, 10.0, 40.0, 80.0)
"""Frequencies [Hz] near which a table of sweeps shows measured magnitudes."""
MOST_METRICS = 6
"""Metrics for which a table of sweeps has columns."""
NEAR = 1.005
"""Frequencies within this factor share a column."""
Table = tuple[list[str], list[list[str]], str]
"""Titles of the columns, rows of cells, and title of the table."""


def sweep_table(sweeps: Sequence[StoredSweep], results: Mapping[str, Result], registry: Registry) -> Table:
    """Return a row for each sweep: labels, outcome, settled points, some magnitudes, metrics, message."""
    labels = label_columns([sweep.labels for sweep in sweeps])
    units = label_units(
        ((sweep.labels, sweep.experiment | {"estimator": sweep.estimator}) for sweep in sweeps), registry
    )
    titles = [f"{title} [{units[path]}]" if path in units else title for path, title in labels.items()]
    found = [results[sweep.key].response for sweep in sweeps if sweep.key in results]
    responses = [response for response in found if response is not None and len(response.frequency)]
    spots, unit = spots_of(responses)
    each = itertools.zip_longest(
        *(_telling(result) for result in results.values())
    )  # the first ones of each come first
    telling = list(dict.fromkeys(name for row in each for name in row if name))
    metrics = telling[:MOST_METRICS]
    mixed = len({sweep.state for sweep in sweeps}) > 1
    columns = [
        "sweep", *titles, *(["state"] if mixed else []), "outcome", "settled", *spots,
        *(f"{name} [{unit}]" if unit not in ("", "1") else name for name, unit in metrics), "message",
    ]  # fmt: skip
    texts = {path: label_texts([sweep.labels.get(path) for sweep in sweeps]) for path in labels}
    rows = []
    for index, sweep in enumerate(sweeps):
        result = results.get(sweep.key)
        values = {(metric.name, metric.unit): metric.value for metric in result.metrics} if result else {}
        rows.append([
            short(sweep.key), *(texts[path][index] for path in labels),
            *([sweep.state] if mixed else []), outcome_text(sweep),
            *_response_cells(result.response if result else None, spots.values()),
            *(number(values[metric]) if metric in values else "" for metric in metrics), sweep.message,
        ])  # fmt: skip
    notes = [f"magnitudes in dB re 1 {unit}"] if spots else []
    left_out = len(telling) - len(metrics)
    notes += [f"{plural(left_out, 'more metric')} of each sweep: fraexp show KEY"] if left_out else []
    return columns, rows, "; ".join(notes)


def _telling(result: Result) -> list[tuple[str, str]]:
    """Return names and units of the metrics that a row has room for: beside a response not what it took."""
    beside = EFFORT if result.response is not None else ()
    return [(metric.name, metric.unit) for metric in result.metrics if metric.name not in beside]


def spots_of(responses: Sequence[FrequencyResponse]) -> tuple[dict[str, float], str]:
    """Return frequencies [Hz] of the first response by the titles of their columns, and the unit of 0 dB."""
    if len({response.unit for response in responses}) != 1:
        return {}, ""
    grid = np.unique(responses[0].frequency)
    inside = [spot for spot in SPOTS if grid[0] / NEAR <= spot <= grid[-1] * NEAR]
    wanted = inside if len(inside) > 2 else np.geomspace(grid[0], grid[-1], len(SPOTS))
    spots = sorted({float(grid[np.argmin(np.abs(np.log(grid / spot)))]) for spot in wanted})
    digits = next((count for count in range(3, 17) if len({f"{spot:.{count}g}" for spot in spots}) == len(spots)), 17)
    return {f"{spot:.{digits}g} Hz": spot for spot in spots}, readable_unit(responses[0].unit)[1]


def _response_cells(response: FrequencyResponse | None, spots: Iterable[float]) -> list[str]:
    if response is None or not len(response.frequency):
        return ["", *("" for _ in spots)]
    return [
        f"{int(response.settled.sum())}/{len(response.settled)}",
        *(_fixed(level_near(response, spot), 2) for spot in spots),
    ]


def level_near(response: FrequencyResponse, spot: float) -> float:
    """Return the magnitude [dB] at the response's point nearest to `spot` [Hz]; NaN if there is none to trust."""
    index = int(np.argmin(np.abs(np.log(response.frequency / spot))))
    near = spot / NEAR <= response.frequency[index] <= spot * NEAR
    level = decibel(readable_unit(response.unit)[0] * response.response[[index]])[0]
    return float(level) if near and response.settled[index] else np.nan


def response_table(response: FrequencyResponse, rows: int | None) -> Table:
    """Return the points of a response, about `rows` of them spread evenly, or all.

    Noise is the standard deviation of the response by noise alone, nonlinear that of one realisation by stochastic
    nonlinear distortions, both relative to the response.
    """
    factor, shown = readable_unit(response.unit)
    output_unit, input_unit = (f" [{unit}]" if unit else "" for unit in channel_units(response))
    level, phase = decibel(factor * response.response), continuous_phase(degrees(response.response), response.settled)
    magnitude, turn = limits(response)
    spread = decibel_limits(magnitude)
    noise, nonlinear = (_relative(part, response) for part in (response.noise_variance, response.nonlinear_variance))
    coherence = np.full(len(level), np.nan) if response.coherence is None else response.coherence
    columns = [
        "frequency [Hz]", f"magnitude [dB re 1 {shown}]", "phase [deg]", "± 95 % [dB]", "± 95 % [deg]",
"noise [dB]", "nonlinear [dB]", "coherence",
        f"input{input_unit}", f"output{output_unit}", "distortion [%]", "settled", "after [s]",
    ]  # fmt: skip
    count = len(response.frequency)
    indices = range(count) if rows is None or count <= rows else np.linspace(0, count - 1, rows).round().astype(int)
    cells = [
        [
            number(response.frequency[index]), fixed(level[index], 3), fixed(phase[index], 2),
            _known(np.max(np.abs(spread[:, index]))), _known(np.degrees(np.max(np.abs(turn[:, index])))),
            *(_fixed(part[index], 1) for part in (noise, nonlinear)), _fixed(coherence[index], 4),
            number(response.input_amplitude[index], 4), number(response.output_amplitude[index], 4),
            number(100 * response.distortion[index], 3), "yes" if response.settled[index] else "no",
            _known(response.settling_time[index]),
        ]
        for index in indices
    ]  # fmt: skip
    return columns, cells, ""


def _relative(variance: np.ndarray | None, response: FrequencyResponse) -> np.ndarray:
    """Return a standard deviation relative to the response [dB], shape (n,); NaN where it is not known."""
    if variance is None:
        return np.full(len(response.frequency), np.nan)
    return decibel(np.sqrt(np.maximum(variance, 0))) - decibel(response.response)


def _fixed(value: float, decimals: int) -> str:
    return fixed(value, decimals) if np.isfinite(value) else ""


def _known(value: float) -> str:
    return "" if np.isnan(value) else "∞" if np.isinf(value) else number(value, 3)
