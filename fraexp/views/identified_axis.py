"""What the records of one machine tell: questions with their answers, each with its evidence."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from fraexp.analysis.band_reach import BandReach
from fraexp.data.frequency_text import frequency_text
from fraexp.data.results import Fit, Outcome, Result
from fraexp.records.first_look import Choice, RecordLook
from fraexp.views.result_rows import fit_rows
from fraexp.views.words import number_text, plural, with_unit

LAW_METRICS = ("Coulomb force", "viscous coefficient")
"""Metrics of friction, each with the half-width of its interval behind `, 95 %`."""
UNTOLD = "one amplitude does not tell: record the same frequencies at twice the amplitude, and give both files"


def answers(
    files: Sequence[Path], look: RecordLook, choice: Choice, results: Mapping[str, Result]
) -> Iterator[tuple[str, str]]:
    """Yield what is asked of an axis, and what the records answer: the last of the results, by their labels."""
    result = list(results.values())[-1] if results else Result(Outcome.ERROR)
    yield "records", _records_text(files, look)
    yield "method", f"{choice.estimator['name']}: {choice.reason}"
    yield "friction", _friction_text(look, result)
    fits = {fit.kind: fit for fit in result.fits}
    yield "plant", _fit_text(fits["plant"]) if "plant" in fits else "none was found: see what is open"
    if delay := _metric_text(result, "input_dead_time"):
        yield "dead time", delay
    if result.response is not None:
        within = BandReach.of(result.response).is_within() & result.response.settled
        yield "band", f"within 0.5 dB and 3° at {within.sum()} of {plural(within.size, 'frequency', 'frequencies')}"
    if "friction" in fits:
        yield "friction law", _law_text(fits["friction"], result)
    if "controller" in fits:
        yield "gains", _fit_text(fits["controller"])
    for label, of in results.items():
        word = "remark" if of.outcome is Outcome.OK else "open"
        yield from ((word, f"{label}: {finding}".removeprefix(": ")) for finding in of.findings)


def _records_text(files: Sequence[Path], look: RecordLook) -> str:
    names = ", ".join(file.name for file in files)
    if not look.frequencies:
        return f"{names}: does not repeat itself"
    count = plural(len(look.frequencies), "frequency", "frequencies")
    text = f"{names}: {count} of {frequency_text(look.frequencies)}"
    sizes = " and ".join(with_unit(number_text(size, 3), look.unit) for size in look.amplitudes)
    return f"{text}, input of {sizes}" if sizes else text


def _friction_text(look: RecordLook, result: Result) -> str:
    metrics = {metric.name: metric.value for metric in result.metrics}
    if {"scatter before", "scatter after", "noise floor"} <= metrics.keys():
        before, after, noise = (metrics[name] for name in ("scatter before", "scatter after", "noise floor"))
        return (
            f"yes: the responses at {look.levels} amplitudes differ by {before:.1%}, of which noise explains "
            f"{noise:.1%}; without friction they differ by {after:.1%}; {_law_numbers(result)}"
        )
    if numbers := _law_numbers(result):
        return f"yes: {numbers}"
    if result.response is None or not np.isfinite(result.response.distortion).any():
        return UNTOLD
    worst = float(np.nanmax(result.response.distortion))
    return f"harmonics of the motion reach {worst:.1%}; {UNTOLD}"


def _law_numbers(result: Result) -> str:
    return ", ".join(f"{name} {text}" for name in LAW_METRICS if (text := _metric_text(result, name)))


def _metric_text(result: Result, name: str) -> str:
    """Return a metric with its interval; empty if there is none."""
    found = {metric.name: metric for metric in result.metrics}
    if name not in found:
        return ""
    width = found.get(f"{name}, 95 %")
    interval = f" ± {number_text(width.value, 2)}" if width else ""
    return with_unit(f"{number_text(found[name].value, 4)}{interval}", found[name].unit)


def _fit_text(fit: Fit) -> str:
    rows = [row for row in fit_rows(fit) if row[1] != "0"]
    return ", ".join(
        with_unit(f"{name} {value}" + (f" ± {band}" if band else ""), unit) for name, value, band, unit in rows
    )


def _law_text(fit: Fit, result: Result) -> str:
    metrics = {metric.name: metric.value for metric in result.metrics}
    name = str(fit.component["name"])
    return f"{name}, but no law explains the records" if metrics.get("friction law") == 0 else name
