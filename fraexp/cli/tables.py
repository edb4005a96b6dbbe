"""Tables of sweeps and of responses."""

from collections.abc import Mapping, Sequence

import numpy as np

from fraexp.cli.words import fixed, number, short
from fraexp.figures.bode import COVERAGE, relative_deviations
from fraexp.figures.label_units import label_units
from fraexp.figures.labels import label_columns, label_text
from fraexp.figures.scales import continuous_phase, decibel, degrees, readable_unit
from fraexp.plugins import Registry
from fraexp.results import FrequencyResponse, Result
from fraexp.store import StoredSweep

SPOTS = (1.0, 10.0, 40.0, 80.0)
"""Frequencies [Hz] at which a table of sweeps shows magnitudes."""
Table = tuple[list[str], list[list[str]], str]
"""Titles of the columns, rows of cells, and title of the table."""


def sweep_table(sweeps: Sequence[StoredSweep], results: Mapping[str, Result], registry: Registry) -> Table:
    """Return a row for each sweep: labels, outcome, settled points, some magnitudes, metrics, message."""
    labels = label_columns([sweep.labels for sweep in sweeps])
    units = label_units(
        ((sweep.labels, sweep.experiment | {"estimator": sweep.estimator}) for sweep in sweeps), registry
    )
    titles = [f"{title} [{units[path]}]" if path in units else title for path, title in labels.items()]
    responses = [result.response for result in results.values() if result.response is not None]
    spots, unit = _spots(responses)
    metrics = list(
        dict.fromkeys((metric.name, metric.unit) for result in results.values() for metric in result.metrics)
    )
    mixed = len({sweep.state for sweep in sweeps}) > 1
    columns = [
        "sweep", *titles, *(["state"] if mixed else []), "outcome", "settled", *(f"{spot:g} Hz" for spot in spots),
        *(f"{name} [{unit}]" if unit not in ("", "1") else name for name, unit in metrics), "message",
    ]  # fmt: skip
    rows = []
    for sweep in sweeps:
        result = results.get(sweep.key)
        values = {(metric.name, metric.unit): metric.value for metric in result.metrics} if result else {}
        rows.append([
            short(sweep.key), *(label_text(sweep.labels.get(path)) for path in labels),
            *([sweep.state] if mixed else []), outcome_text(sweep),
            *_response_cells(result.response if result else None, spots),
            *(number(values[metric]) if metric in values else "" for metric in metrics), sweep.message,
        ])  # fmt: skip
    return columns, rows, f"magnitudes in dB re 1 {unit}" if spots else ""


def outcome_text(sweep: StoredSweep) -> str:
    """Return a sweep's outcome in words; empty while there is none."""
    return sweep.outcome.name.lower().replace("_", " ") if sweep.outcome else ""


def _spots(responses: Sequence[FrequencyResponse]) -> tuple[list[float], str]:
    if len({response.unit for response in responses}) != 1:
        return [], ""
    unit = readable_unit(responses[0].unit)[1]
    low = min(float(response.frequency.min()) for response in responses)
    high = max(float(response.frequency.max()) for response in responses)
    inside = [spot for spot in SPOTS if low * (1 - 1e-9) <= spot <= high * (1 + 1e-9)]
    spread = [float(f"{spot:.1g}") for spot in np.geomspace(low, high, 4)]
    return inside if len(inside) > 2 else sorted({spot for spot in spread if low <= spot <= high}), unit


def _response_cells(response: FrequencyResponse | None, spots: Sequence[float]) -> list[str]:
    if response is None:
        return ["", *("" for _ in spots)]
    settled = response.settled
    cells = [f"{int(settled.sum())}/{len(settled)}"]
    order = np.argsort(response.frequency[settled])
    frequency = response.frequency[settled][order]
    level = decibel(readable_unit(response.unit)[0] * response.response[settled][order])
    for spot in spots:
        inside = len(frequency) > 0 and frequency[0] * (1 - 1e-9) <= spot <= frequency[-1] * (1 + 1e-9)
        cells.append(fixed(float(np.interp(np.log(spot), np.log(frequency), level)), 2) if inside else "")
    return cells


def response_table(response: FrequencyResponse, rows: int | None) -> Table:
    """Return the points of a response, about `rows` of them spread evenly, or all."""
    factor, shown = readable_unit(response.unit)
    output_unit, _, input_unit = response.unit.partition("/")
    level, phase = decibel(factor * response.response), continuous_phase(degrees(response.response), response.settled)
    along, across = relative_deviations(response.response, response.covariance)
    columns = [
        "frequency [Hz]", f"magnitude [dB re 1 {shown}]", "phase [deg]", "± 95 % [dB]", "± 95 % [deg]",
        f"input [{input_unit}]", f"output [{output_unit}]", "distortion [%]", "settled", "after [s]",
    ]  # fmt: skip
    count = len(response.frequency)
    indices = range(count) if rows is None or count <= rows else np.linspace(0, count - 1, rows).round().astype(int)
    cells = [
        [
            number(response.frequency[index]), fixed(level[index], 3), fixed(phase[index], 2),
            _known(20 / np.log(10) * COVERAGE * along[index]), _known(np.degrees(COVERAGE * across[index])),
            number(response.input_amplitude[index], 4), number(response.output_amplitude[index], 4),
            number(100 * response.distortion[index], 3), "yes" if response.settled[index] else "no",
            _known(response.settling_time[index]),
        ]
        for index in indices
    ]  # fmt: skip
    return columns, cells, ""


def _known(value: float) -> str:
    return number(value, 3) if np.isfinite(value) else ""
