"""The work of a sweep, counted without doing it: its experiment, and its estimator on what that records."""

from collections.abc import Iterator, Mapping
from typing import Any

from fraexp.components.kinds import Estimator, Excitation, FrictionModel, nested_kind
from fraexp.components.registry import Registry, create
from fraexp.data import fit_references
from fraexp.data.sweep import Plain, component_names
from fraexp.execution.estimates.loop_work import looks_vectorised, loop_work, step_cost, timed_periods
from fraexp.execution.estimates.reference_costs import cost, estimator_cost, law_cost, run_cost
from fraexp.execution.estimates.work import LANES, SCALAR, VECTOR, Counted, Shape, Work

PASSES = 2.0
"""Times that a friction model is driven through a periodic record until its force repeats itself."""
UNKNOWN = Counted((Work("unknown", run_cost("unknown")),), Shape())
"""An experiment whose work cannot be counted, such as one of a plugin that fails."""


def experiment_work(experiment: Plain, registry: Registry) -> Counted:
    """Return the work of an experiment; a guess if a plugin cannot tell what it will do."""
    try:
        settled = fit_references.replaced(experiment, lambda reference: experiment[str(reference[fit_references.WORD])])
        return _COUNTERS[experiment["source"]](settled, registry)
    except Exception:  # a stranger's plugin may raise anything: the run will tell, the plan goes on
        return UNKNOWN


def estimator_work(spec: Plain, experiment: Plain, shape: Shape, registry: Registry) -> tuple[Work, ...]:
    """Return the work of an estimator on what an experiment records; a guess if a plugin fails."""
    try:
        settled = fit_references.replaced(spec, lambda reference: experiment[str(reference[fit_references.WORD])])
        return tuple(_estimation(settled, experiment, shape, registry))
    except Exception:  # as above
        return (Work("unknown", run_cost("unknown")),)


def _drive(experiment: Plain, registry: Registry) -> Counted:
    friction = create(registry, FrictionModel, experiment[FrictionModel.kind])
    excitation = create(registry, Excitation, experiment[Excitation.kind])  # type: ignore[type-abstract]
    periods, made = timed_periods(excitation, experiment["loop"]["sample_time"])
    recorded = sum(period.waveform.size for period in periods)
    law = "+".join(component_names(experiment[FrictionModel.kind]))
    seconds = cost("drive", "setup") * len(periods) + PASSES * recorded * _driven_cost(friction)
    shape = Shape(len(periods), sum(period.lines.size for period in periods), recorded)
    return Counted((Work(f"drive/{law}/{SCALAR}", seconds), Work("", made)), shape)


def _driven_cost(friction: FrictionModel) -> float:
    """Return the time of a sample along which a friction model is driven [s]."""
    return law_cost(friction.name).driven * step_cost(friction)


def _record(experiment: Plain, registry: Registry) -> Counted:
    record = experiment["record"]
    segments = record["segments"]
    recorded = sum(segment["periods"] * segment["samples"] for segment in segments)
    lines = sum(len(segment["lines"]) for segment in segments)
    repeated = any(segment["periods"] > 1 for segment in segments)
    reader = "+".join(component_names(record["reader"]))
    work = Work(f"record/{reader}", cost("record", "setup") + recorded * cost("record", "sample"))
    return Counted((work,), Shape(len(segments), lines, recorded, 0, repeated))


_COUNTERS = {"loop": loop_work, "drive": _drive, "record": _record}


def _estimation(spec: Plain, experiment: Plain, shape: Shape, registry: Registry) -> Iterator[Work]:
    """Yield the work of an estimator: its own with that of the estimators that it holds, and that of its friction."""
    names = []
    for part in _nested(Estimator.kind, spec, registry):
        component = registry.supply(Estimator.kind, part["name"]).component
        found = estimator_cost(part["name"], bool(getattr(component, "fits", "")))
        parts = found.segment * shape.segments + found.line * shape.lines + found.sample * shape.recorded
        names.append((f"{part['name']}{_lists(part)}", found.sweep + parts))
    yield Work(f"estimate/{'+'.join(name for name, _ in names)}", sum(seconds for _, seconds in names))
    for part in _nested(Estimator.kind, spec, registry):
        if isinstance(part.get(FrictionModel.kind), Mapping):
            yield _observed(part, experiment, shape, registry)


def _lists(spec: Plain) -> str:
    """Return how many values an estimator's lists of tables have, such as deviations: each is work of its own."""
    counts = (len(value) for value in spec.values() if isinstance(value, list) and value and _is_table(value[0]))
    return "".join(f"[{count}]" for count in counts)


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _observed(spec: Plain, experiment: Plain, shape: Shape, registry: Registry) -> Work:
    """Return the work of driving an estimator's friction model by the recorded motion."""
    friction = create(registry, FrictionModel, spec[FrictionModel.kind])
    noisy = any(experiment.get("loop", {}).get(key) for key in ("noise", "resolution"))
    alone = 2 if noisy and shape.repeated else 1  # each period once more by itself
    points = PASSES * alone * shape.recorded * float(spec.get("interpolation", 1))
    points += 0 if friction.forgets else shape.lead_in
    motions = shape.segments * (2 if alone > 1 else 1)
    is_wide = motions > 1 and looks_vectorised(friction.law)
    law = "+".join(component_names(spec[FrictionModel.kind]))
    rows = points / min(LANES, motions) if is_wide else points
    return Work(f"drive/{law}/{VECTOR if is_wide else SCALAR}", cost("drive", "setup") + rows * _driven_cost(friction))


def _nested(kind: str, spec: Plain, registry: Registry) -> Iterator[Plain]:
    """Yield a component's plain data and those of the components of its kind that it holds."""
    yield spec
    component = registry.supply(kind, spec["name"]).component
    for key, info in component.model_fields.items():
        nested, value = nested_kind(info), spec.get(key)
        if nested is not None and nested.kind == kind and isinstance(value, Mapping):
            yield from _nested(kind, value, registry)
