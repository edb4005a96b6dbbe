"""What a report says in words: the verdict on a run, and the methods that it used."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from fraexp.components.registry import Registry
from fraexp.data.results import Outcome
from fraexp.data.terminal_text import printable
from fraexp.errors import FraexpError
from fraexp.reports.published_comparisons import verdict
from fraexp.reports.report_tables import Cell, ReportTable, outcome_text
from fraexp.store import RunSummary, StoredSweep
from fraexp.study.published_values import PublishedComparison

KINDS = ("plant", "friction", "controller", "excitation", "compensation", "loop", "record")
"""Sections of an experiment, in the order in which a report lists them."""


class Method(NamedTuple):
    """A component as a report describes it."""

    kind: str
    name: str
    paragraphs: tuple[str, ...]
    """What it does, with its reference in the literature; code is between backticks."""


def verdict_text(run: RunSummary, sweeps: Sequence[StoredSweep], compared: Sequence[PublishedComparison]) -> str:
    """Return in words what a run has shown: which sweeps can be used, and which published numbers are met."""
    outcomes = Counter(of.outcome for of in sweeps if of.outcome)
    sound = outcomes.pop(Outcome.OK, 0)
    parts = [_sound_text(sound, len(sweeps))]
    parts += [f"{count} {outcome_text(outcome)}" for outcome, count in outcomes.items()]
    without = len(sweeps) - sound - sum(outcomes.values())
    parts += [f"{without} without a result"] if without else []
    text = ", ".join(parts) + "."
    told = verdict(compared)
    missed = [one.published.what for one in compared if not one.is_met]
    text += f" {told}." if told else ""
    text += f" Not met: {'; '.join(missed)}." if missed else ""
    return text if run.state == "complete" else f"The run is {run.state}. {text}"


def _sound_text(sound: int, count: int) -> str:
    if count == 1:
        return "The sweep is sound" if sound else "The sweep is not sound"
    return f"All {count} sweeps are sound" if sound == count else f"{sound} of {count} sweeps are sound"


def describe_methods(sweeps: Sequence[StoredSweep], registry: Registry) -> list[Method]:
    """Return the estimators of sweeps, each once, with the description that its plugin gives."""
    found: dict[tuple[str, str], Method] = {}
    for sweep in sweeps:
        for provider in registry.used_providers("estimator", sweep.estimator):
            component = provider.component
            words = component.name.replace("_", " ")
            found[component.kind, component.name] = Method(
                component.kind, words, tuple(map(printable, provider.paragraphs))
            )
    return [method for key, method in found.items() if key[0] == "estimator" and method.paragraphs]


def input_table(sweeps: Sequence[StoredSweep], registry: Registry) -> ReportTable | None:
    """Return what all sweeps share of their experiment, a row for each number or text; None if there is nothing."""
    from fraexp.study.paths import unit_at

    rows = []
    for kind in KINDS:
        shared = _shared_inputs(kind, [sweep.experiment for sweep in sweeps])
        for path, value in shared.items():
            try:
                unit = unit_at(sweeps[0].experiment, path, registry)
            except FraexpError:
                unit = ""
            rows.append([Cell(path), Cell(_value_text(value)), Cell("" if unit == "1" else unit)])
    return ReportTable(["input", "value", "unit"], rows) if rows else None


def _shared_inputs(kind: str, experiments: Sequence[Mapping[str, object]]) -> dict[str, object]:
    every = [dict(_leaves(of.get(kind), kind)) for of in experiments]
    first = every[0] if every else {}
    return {
        path: value
        for path, value in first.items()
        if _is_shown(path, value) and all(of.get(path) == value for of in every)
    }


def _is_shown(path: str, value: object) -> bool:
    return value not in (None, [], "", {}) and not path.endswith(".version")


def _leaves(value: object, path: str) -> list[tuple[str, object]]:
    if isinstance(value, Mapping):
        return [leaf for key, item in value.items() for leaf in _leaves(item, f"{path}.{key}")]
    return [(path, value)]


def _value_text(value: object) -> str:
    if isinstance(value, list):
        texts = [_value_text(item) for item in value]
        return ", ".join(texts if len(texts) <= 6 else [*texts[:2], "…", texts[-1]])
    return f"{value:.6g}" if isinstance(value, float) else str(value)
