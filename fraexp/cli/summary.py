"""Many sweeps in few lines: quantiles over the sweeps instead of a row for each."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fraexp.cli.output import print_fields, print_table, say
from fraexp.components.registry import Registry
from fraexp.data.results import Metric, Outcome, Result
from fraexp.data.sweep import DRAW
from fraexp.figures.elements.label_units import label_units
from fraexp.figures.elements.labels import GROUPS, group_names, label_columns, label_texts
from fraexp.store import StoredSweep
from fraexp.views.fields import outcome_text
from fraexp.views.text_tables import level_near, spots_of, sweep_table
from fraexp.views.words import fixed, number, plural, short, value_text

MOST = 40
"""More sweeps than this are summarised on a terminal."""
EXAMPLES = 5
"""Sweeps without a good outcome that are shown below a summary."""
LEVELS = (0.0, 0.05, 0.5, 0.95, 1.0)
WORST = ["worst draw", "group", "value", "draw", "sweep"]
TITLES = ["over the sweeps", "group", "least", "5 %", "median", "95 %", "greatest", "sweeps"]


@dataclass(frozen=True)
class Quantity:
    """A number that each sweep has, or lacks."""

    title: str
    values: np.ndarray
    """One for each sweep, NaN where there is none, shape (n,)."""
    decimals: int | None = None
    """How many are shown; None for four significant digits."""

    def text(self, value: float) -> str:
        """Return one of its values as people read it."""
        return number(value, 4) if self.decimals is None else fixed(value, self.decimals)


def to_summarise(count: int) -> bool:
    """Say whether so many sweeps are too many rows: on a terminal they are, elsewhere a program may read them."""
    return count > MOST and sys.stdout.isatty()


def print_summary(sweeps: Sequence[StoredSweep], results: Mapping[str, Result], registry: Registry) -> None:
    """Print what many sweeps gave: their outcomes, and quantiles of labels, magnitudes and metrics over the sweeps."""
    sections = ((sweep.labels, sweep.experiment | {"estimator": sweep.estimator}) for sweep in sweeps)
    units = label_units(sections, registry)
    outcomes = [outcome_text(sweep) or sweep.state for sweep in sweeps]
    columns = label_columns([sweep.labels for sweep in sweeps])
    titles = {path: _with_unit(title, units.get(path, "")) for path, title in columns.items()}
    values = {path: [sweep.labels.get(path) for sweep in sweeps] for path in titles}
    varied = [path for path, column in values.items() if measured(column) and path != DRAW]
    counted = [(titles[path], counts(label_texts(column))) for path, column in values.items() if path not in varied]
    print_fields([("sweeps", str(len(sweeps))), ("outcomes", counts(outcomes)), *counted])
    print()
    groups = group_names([sweep.labels for sweep in sweeps], units)
    labels = [Quantity(titles[path], np.array(values[path], dtype=float)) for path in varied]
    found = [results.get(sweep.key) for sweep in sweeps]
    metrics = _metrics(found)
    rows = quantile_rows(labels, [""] * len(sweeps)) + quantile_rows([*_levels(found), *metrics], groups)
    print_table(TITLES, rows)
    worst = worst_rows(metrics, groups, sweeps)
    if worst:
        print()
        print_table(WORST, worst)
        say("fraexp show KEY tells what was drawn of a sweep")
    odd = [sweep for sweep in sweeps if sweep.outcome != Outcome.OK]
    if odd:
        print(f"\n{plural(len(odd), 'sweep')} not ok" + (f", the first {EXAMPLES}:" if len(odd) > EXAMPLES else ":"))
        print_table(*sweep_table(odd[:EXAMPLES], results, registry))


def measured(values: Sequence[Any]) -> bool:
    """Say whether quantiles tell more of these values than counts: they are numbers, and many different ones."""
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return numbers and len(set(values)) > GROUPS


def counts(texts: Sequence[str]) -> str:
    """Return how often each text occurs, or how many there are if they are many."""
    found = Counter(text or "(none)" for text in texts)
    if len(found) > GROUPS:
        return f"{len(found)} values"
    return ", ".join(f"{count} {text}" if len(found) > 1 else text for text, count in found.items())


def quantile_rows(quantities: Sequence[Quantity], groups: Sequence[str]) -> list[list[str]]:
    """Return a row under `TITLES` for each quantity and group that has values; sweeps are counted if some have none."""
    members = {name: np.array([group == name for group in groups]) for name in dict.fromkeys(groups)}
    rows = []
    for quantity in quantities:
        for name, chosen in members.items():
            known = quantity.values[chosen & np.isfinite(quantity.values)]
            if len(known):
                texts = [quantity.text(float(level)) for level in np.quantile(known, LEVELS)]
                rows.append([quantity.title, name, *texts, "" if len(known) == chosen.sum() else str(len(known))])
    return rows


def worst_rows(metrics: Sequence[Quantity], groups: Sequence[str], sweeps: Sequence[StoredSweep]) -> list[list[str]]:
    """Return a row under `WORST` for each metric and group that was drawn at random: its greatest magnitude."""
    rows = []
    for metric in metrics:
        for name in dict.fromkeys(groups):
            chosen = [
                index
                for index, group in enumerate(groups)
                if group == name and DRAW in sweeps[index].labels and np.isfinite(metric.values[index])
            ]
            if len({float(metric.values[index]) for index in chosen}) > 1:
                at = max(chosen, key=lambda index: abs(metric.values[index]))
                value, number_ = metric.text(float(metric.values[at])), label_texts([sweeps[at].labels[DRAW]])
                rows.append([metric.title, name, value, *number_, short(sweeps[at].key)])
    return rows


def parameter_rows(parameters: Mapping[str, Sequence[Any]]) -> tuple[list[tuple[str, str]], list[list[str]]]:
    """Return counts of those parameters, by path, that have few values or no numbers, and quantiles of the others."""
    varied = [Quantity(path, np.array(row, dtype=float)) for path, row in parameters.items() if measured(row)]
    counted = [
        (path, counts([value_text(value) for value in row]))
        for path, row in parameters.items()
        if not measured(row)
    ]  # fmt: skip
    return counted, quantile_rows(varied, [""] * max((len(row) for row in parameters.values()), default=0))


def _levels(results: Sequence[Result | None]) -> list[Quantity]:
    responses = [result.response if result and result.response else None for result in results]
    known = [response for response in responses if response and len(response.frequency)]
    spots, unit = spots_of(known)
    share = [100 * of.settled.mean() if of and len(of.frequency) else np.nan for of in responses]
    found = [Quantity("settled [%]", np.array(share, dtype=float))]
    for title, spot in spots.items():
        levels = [level_near(of, spot) if of and len(of.frequency) else np.nan for of in responses]
        found.append(Quantity(f"{title} [dB re 1 {unit}]", np.array(levels), decimals=2))
    return found


def _metrics(results: Sequence[Result | None]) -> list[Quantity]:
    metrics = [{(of.name, of.unit): of for of in result.metrics} if result else {} for result in results]
    found = []
    for name, metric_unit in dict.fromkeys(key for of in metrics for key in of):
        values = [_value(of.get((name, metric_unit))) for of in metrics]
        found.append(Quantity(_with_unit(name, metric_unit), np.array(values)))
    return found


def _value(metric: Metric | None) -> float:
    return np.nan if metric is None else float(metric.value)


def _with_unit(title: str, unit: str) -> str:
    return f"{title} [{unit}]" if unit not in ("", "1") else title
