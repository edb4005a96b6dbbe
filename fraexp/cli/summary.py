"""A summary of many sweeps: quantiles over the sweeps instead of a row for each."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fraexp.cli.output import print_fields, print_line, print_table
from fraexp.components.registry import Registry
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import DRAW, Plain
from fraexp.figures.elements.grouping import group_sweeps, point_indices
from fraexp.figures.elements.labels import MAX_GROUPS, label_columns, label_texts
from fraexp.store import StoredSweep
from fraexp.study.paths import label_units
from fraexp.views.fields import outcome_text
from fraexp.views.text_tables import SweepNumbers, label_values, magnitudes, metric_quantities, sweep_table
from fraexp.views.words import plural

MAX_LISTED_SWEEPS = 40
"""Maximum number of sweeps that a terminal lists; more are summarised."""
ALL_REMEDY = "output that is not a terminal, such as | less, shows all"
MAX_EXAMPLES = 5
"""Maximum number of sweeps that are not ok shown below a summary."""
QUANTILE_LEVELS = (0.0, 0.05, 0.5, 0.95, 1.0)
QUANTILE_COLUMNS = ["over the sweeps", "group", "minimum", "5 %", "median", "95 %", "maximum", "sweeps"]


def needs_summary(count: int) -> bool:
    """Return whether a summary replaces the table: on a terminal only, as elsewhere a program may read the rows."""
    return count > MAX_LISTED_SWEEPS and sys.stdout.isatty()


def print_summary(sweeps: Sequence[StoredSweep], results: Mapping[str, Result], registry: Registry) -> None:
    """Print the outcomes of many sweeps, and quantiles of their labels, magnitudes and metrics."""
    outcomes = [outcome_text(sweep) or sweep.state for sweep in sweeps]
    labels = label_values(sweeps, registry)
    varied = [of for path, of in labels.items() if is_continuous(of[1]) and path != DRAW]
    counted = [(title, counts_of_texts(label_texts(of))) for title, of in labels.values() if (title, of) not in varied]
    print_fields([("sweeps", str(len(sweeps))), ("outcomes", counts_of_texts(outcomes)), *counted])
    print()
    units = label_units(((sweep.labels, sweep.sections) for sweep in sweeps), registry)
    groups, sampled = _row_groups([sweep.labels for sweep in sweeps], units)
    found = [results.get(sweep.key) for sweep in sweeps]
    metrics = metric_quantities(found, is_whole=True)
    drawn = [SweepNumbers(title, np.array(values, dtype=float)) for title, values in varied]
    rows = quantile_rows(drawn, [""] * len(sweeps), False)
    rows += quantile_rows([_settled_shares(found), *_magnitudes(found), *metrics], groups, sampled)
    print_table(QUANTILE_COLUMNS, rows)  # without columns that are empty
    odd = [sweep for sweep in sweeps if sweep.outcome != Outcome.OK]
    if odd:
        print()
        first = f", the first {MAX_EXAMPLES}" if len(odd) > MAX_EXAMPLES else ""
        print_line(f"{plural(len(odd), 'sweep')} not ok{first}:")
        print_table(*sweep_table(odd[:MAX_EXAMPLES], results, registry))


def _row_groups(labels: Sequence[Plain], units: Mapping[str, str]) -> tuple[list[str], bool]:
    """Return the group of each sweep, and whether the sweeps of a group are random draws, which have quantiles.

    Without draws a group is a value of the label with the fewest values, 2 to `MAX_GROUPS`.
    """
    places = group_sweeps(labels, units)
    if len(point_indices(places)) < len(places):
        return [place.point for place in places], True
    texts = {path: label_texts([of.get(path) for of in labels]) for path in label_columns(labels)}
    counts = {path: len(set(column)) for path, column in texts.items() if 1 < len(set(column)) <= MAX_GROUPS}
    if not counts:
        return [""] * len(labels), False
    return [
        place.group for place in group_sweeps(labels, units, by=[min(counts, key=lambda path: counts[path])])
    ], False


def is_continuous(values: Sequence[object]) -> bool:
    """Return whether quantiles suit these values better than counts: many different numbers."""
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return numbers and len(set(values)) > MAX_GROUPS


def counts_of_texts(texts: Sequence[str]) -> str:
    """Return how often each text occurs, or only the number of distinct texts if they are many."""
    found = Counter(text or "(none)" for text in texts)
    if len(found) > MAX_GROUPS:
        return f"{len(found)} values"
    return ", ".join(f"{count} {text}" if len(found) > 1 else text for text, count in found.items())


def quantile_rows(quantities: Sequence[SweepNumbers], groups: Sequence[str], sampled: bool) -> list[list[str]]:
    """Return a row under `QUANTILE_COLUMNS` for each quantity and group that has values, counted if some have none.

    Only a group that is `sampled` at random has quantiles: those of a grid are those of whoever chose it.
    """
    members = {name: np.array([group == name for group in groups]) for name in dict.fromkeys(groups)}
    rows = []
    for quantity in quantities:
        for name, chosen in members.items():
            known = quantity.values[chosen & np.isfinite(quantity.values)]
            if len(known):
                levels = zip(QUANTILE_LEVELS, np.quantile(known, QUANTILE_LEVELS), strict=True)
                texts = [quantity.text(float(of), 4) if sampled or share in (0, 1) else "" for share, of in levels]
                rows.append([quantity.title, name, *texts, "" if len(known) == chosen.sum() else str(len(known))])
    return rows


def _settled_shares(results: Sequence[Result | None]) -> SweepNumbers:
    responses = [result.response if result else None for result in results]
    share = [100 * of.settled.mean() if of and len(of.frequency) else np.nan for of in responses]
    return SweepNumbers("settled [%]", np.array(share, dtype=float))


def _magnitudes(results: Sequence[Result | None]) -> list[SweepNumbers]:
    found, unit = magnitudes(results)
    return [replace(of, title=f"{of.title} [dB re 1 {unit}]") for of in found]
