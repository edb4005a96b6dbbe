"""What the records of one machine tell: questions with their answers, each with its evidence."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from fraexp.analysis.confidence import NORMAL_QUANTILE, BandReach
from fraexp.data.results import EXTREMUM_CURVES, Curve, Fit, Outcome, Result
from fraexp.data.texts import frequency_text
from fraexp.records.first_look import ALL_RECORDS, PLANT, RESPONSE, Choice, RecordLook
from fraexp.views.result_rows import fit_rows
from fraexp.views.words import number_text, plural, with_unit

LAW_METRICS = ("Coulomb force", "viscous coefficient")
"""Metrics of friction, each with the half-width of its interval behind `, 95 %`."""
MASSES = {"m/N": ("mass", "kg"), "rad/(N m)": ("inertia", "kg m²")}
"""What 1/k0 is, by the unit of the response."""
MARGINS = ("modulus margin", "gain margin", "phase margin")
"""Metrics of a tuned loop."""
UNTOLD = "one amplitude does not tell: record the same frequencies at twice the amplitude, and give both files"


def answers(
    files: Sequence[Path], look: RecordLook, choice: Choice, results: Mapping[str, Result]
) -> Iterator[tuple[str, str]]:
    """Yield what is asked of an axis, and what the records answer: the last of the results, by their labels."""
    result = list(results.values())[-1] if results else Result(Outcome.ERROR)
    yield "records", _records_text(files, look)
    yield "method", f"{choice.estimator['name']}: {choice.reason}"
    fits = {fit.kind: fit for fit in result.fits}
    contradiction, is_certain = _contradiction(results) if result.outcome is not Outcome.OK else ("", False)
    if is_certain and "plant" not in fits:  # nothing else that such files say is of one machine
        yield "plant", f"none was found: {contradiction}"
        return
    yield "friction", _friction_text(look, result)
    found = _plant_text(fits["plant"], result.response.unit if result.response else "") if "plant" in fits else ""
    yield "plant", found or f"none was found: {contradiction or 'see what is open'}"
    if found and contradiction:
        yield "open", contradiction
    for curve in result.curves:
        if curve.name in EXTREMUM_CURVES and curve.columns["frequency"].size:
            yield curve.name, _extrema_text(curve)
    for metric, label in (("input_dead_time", "dead time"), ("input_time_constant", "lag")):
        if delay := _metric_text(result, metric):
            yield label, delay
    if result.response is not None:
        within = BandReach.of(result.response).is_within() & result.response.settled
        what = "" if "friction" in fits else ", of the response with its friction at this amplitude"
        count = f"{within.sum()} of {plural(within.size, 'frequency', 'frequencies')}"
        yield "band", f"within 0.5 dB and 3° at {count}{what}"
    if "friction" in fits:
        is_unexplained = any(metric.name == "friction law" and metric.value == 0 for metric in result.metrics)
        law = str(fits["friction"].component["name"])
        yield "friction law", f"{law}, but no law explains the records" if is_unexplained else law
    for label, of in results.items():
        word = "remark" if of.outcome is Outcome.OK else "open"
        yield from ((word, f"{label}: {finding}".removeprefix(": ")) for finding in of.findings)


def gains(tuned: Result) -> Iterator[tuple[str, str]]:
    """Yield the gains that were found, with their margins; nothing if there are none."""
    for fit in tuned.fits:
        if fit.kind == "controller":
            values = (f"{name} {value} {unit}".rstrip() for name, value, _, unit in fit_rows(fit))
            yield "gains", ", ".join(values)
            yield "margins", ", ".join(f"{name} {_metric_text(tuned, name)}" for name in MARGINS)


def _contradiction(results: Mapping[str, Result]) -> tuple[str, bool]:
    """Return how two files differ beyond their bands where friction matters least, and whether friction cannot do it.

    The text is empty if none do.
    """
    own = (RESPONSE, PLANT, ALL_RECORDS)
    shown = [(label, of.response) for label, of in results.items() if label not in own and of.response is not None]
    worst, text, is_turned = 0.0, "", False
    for (one, first), (other, second) in combinations(shown, 2):
        frequency, *places = np.intersect1d(first.frequency, second.frequency, return_indices=True)
        for highest, *at in list(zip(frequency, *places, strict=True))[-1:]:
            pair = [(of.response[k], of.covariance[k]) for of, k in zip((first, second), at, strict=True)]
            change = np.log(pair[1][0] / pair[0][0])
            allowed = NORMAL_QUANTILE * sum(np.sqrt(np.trace(covariance)) / abs(value) for value, covariance in pair)
            if abs(change) > max(allowed, worst):
                worst, is_turned = abs(change), abs(change.imag) > np.pi / 2  # which friction does not do
                found, remedy = (
                    "differ beyond their bands",
                    "by friction, or check unit, gain and whether it is one machine",
                )
                if is_turned:
                    found, remedy = (
                        "contradict each other",
                        "correct unit or sign of a column, or give one machine's files",
                    )
                size = f"{20 / np.log(10) * change.real:.3g} dB and {np.degrees(change.imag):.3g}°"
                text = f"{one} and {other} {found}, at {highest:.4g} Hz by {size}; {remedy}"
    return text, bool(is_turned)


def _records_text(files: Sequence[Path], look: RecordLook) -> str:
    names = ", ".join(file.name for file in files)
    if not look.frequencies:
        return f"{names}: does not repeat itself"
    count = plural(len(look.frequencies), "frequency", "frequencies")
    text = f"{names}: {count} of {frequency_text(look.frequencies)}"
    sizes = " and ".join(with_unit(number_text(size, 3), look.unit) for size in look.amplitudes)
    left_out = f", without the first {plural(look.skipped, 'period')}" if look.skipped else ""
    return f"{text}, input of {sizes}{left_out}" if sizes else text


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
    if not look.frequencies or (look.levels > 1 and result.response is None):
        return "none was found: see what is open"
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


def _plant_text(fit: Fit, unit: str) -> str:
    """Return the parameters of a plant, and first the mass or inertia that its gain stands for."""
    rows = [row for row in fit_rows(fit) if row[1] != "0"]
    texts = [with_unit(f"{name} {value}" + (f" ± {band}" if band else ""), of) for name, value, band, of in rows]
    if unit in MASSES:
        gain, deviation = float(fit.values[0]), float(fit.standard_deviation[0])
        what, kilograms = MASSES[unit]
        texts.insert(0, f"{what} {1 / gain:.5g} ± {NORMAL_QUANTILE * deviation / gain**2:.2g} {kilograms}")
    return ", ".join(texts)


def _extrema_text(curve: Curve) -> str:
    rows = zip(curve.columns["frequency"], curve.columns["frequency, ± 95 %"], strict=True)
    return ", ".join(f"{frequency:.5g} ± {band:.2g} Hz" for frequency, band in rows)
