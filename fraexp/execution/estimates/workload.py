"""The work of a sweep, counted without computing it: its experiment, and its estimator."""

from collections.abc import Iterator, Mapping

from fraexp.components.first_trial import first_trial, friction_specs
from fraexp.components.kinds import Estimator, Excitation, FrictionModel, nested_kind
from fraexp.components.registry import Registry, create
from fraexp.data import fit_references
from fraexp.data.sweep import Plain, component_names
from fraexp.execution.estimates.loop_work import looks_vectorised, loop_work, step_cost, timed_periods
from fraexp.execution.estimates.reference_costs import cost, estimator_cost, law_cost, run_cost
from fraexp.execution.estimates.work import LANES, SCALAR, VECTOR, CountedExperiment, RecordShape, Work
from fraexp.kernels.watchdog import OverdueError, time_limit

CHOSEN_OVERSAMPLING = 5.0
"""Points per sample that an observer takes which chooses them itself, its trials included."""
DRIVE_PASSES = 2.0
"""Number of times that a friction model is driven through a periodic record until its force is periodic."""
COUNTING_LIMIT_S = 5.0
"""Limit of the processor time for counting the work of an experiment [s]."""
UNKNOWN_WORK = CountedExperiment((Work("unknown", run_cost("unknown")),), RecordShape())
"""Work of an experiment that cannot be counted, because a plugin fails."""


def experiment_work(experiment: Plain, registry: Registry) -> CountedExperiment:
    """Return the work of an experiment; a guess if a plugin fails."""
    try:
        settled = fit_references.replace_references(
            experiment, lambda reference: experiment[str(reference[fit_references.FIT])]
        )
        for spec in friction_specs(settled):
            first_trial(spec, registry)  # counting calls the law: one that never returns must not hang the plan
        with time_limit(COUNTING_LIMIT_S, is_processor_time=True):  # it may do so on steps that the trial does not take
            return _COUNTERS[experiment["source"]](settled, registry)
    except (Exception, OverdueError):  # a plugin may raise anything; the run reports it, the plan goes on
        return UNKNOWN_WORK


def estimator_work(spec: Plain, experiment: Plain, shape: RecordShape, registry: Registry) -> tuple[Work, ...]:
    """Return the work of an estimator on an experiment's record; a guess if a plugin fails."""
    try:
        settled = fit_references.replace_references(
            spec, lambda reference: experiment[str(reference[fit_references.FIT])]
        )
        return tuple(_estimator_parts(settled, experiment, shape, registry))
    except Exception:  # as above
        return (Work("unknown", run_cost("unknown")),)


def _drive_work(experiment: Plain, registry: Registry) -> CountedExperiment:
    friction = create(registry, FrictionModel, experiment[FrictionModel.kind])
    excitation = create(registry, Excitation, experiment[Excitation.kind])
    periods, made = timed_periods(excitation, experiment["loop"]["sample_time"])
    recorded = sum(period.waveform.size for period in periods)
    law = "+".join(component_names(experiment[FrictionModel.kind]))
    seconds = cost("drive", "setup") * len(periods) + DRIVE_PASSES * recorded * _driven_cost(friction)
    shape = RecordShape(len(periods), sum(period.lines.size for period in periods), recorded)
    return CountedExperiment((Work(f"drive/{law}/{SCALAR}", seconds), Work("", made)), shape)


def _driven_cost(friction: FrictionModel) -> float:
    """Return the time to drive a friction model by one sample [s]."""
    return law_cost(friction.name).driven * step_cost(friction)


def _record_work(experiment: Plain, registry: Registry) -> CountedExperiment:
    record = experiment["record"]
    segments = record["segments"]
    recorded = sum(segment["periods"] * segment["samples"] for segment in segments)
    lines = sum(len(segment["lines"]) for segment in segments)
    repeated = any(segment["periods"] > 1 for segment in segments)
    reader = "+".join(component_names(record["reader"]))
    work = Work(f"record/{reader}", cost("record", "setup") + recorded * cost("record", "sample"))
    return CountedExperiment((work,), RecordShape(len(segments), lines, recorded, 0, repeated))


_COUNTERS = {"loop": loop_work, "drive": _drive_work, "record": _record_work}


def _estimator_parts(spec: Plain, experiment: Plain, shape: RecordShape, registry: Registry) -> Iterator[Work]:
    """Yield the work of an estimator together with its nested estimators, and that of its friction models."""
    names = []
    for part in _nested_specs(Estimator.kind, spec, registry):
        component = registry.provider(Estimator.kind, part["name"]).component
        found = estimator_cost(part["name"], bool(getattr(component, "fits", "")))
        parts = found.segment * shape.segments + found.line * shape.lines + found.sample * shape.recorded
        if _has_scatter(experiment, shape):
            parts += found.noisy_segment * shape.segments + found.noisy_sample * shape.recorded
        names.append((f"{part['name']}{_list_counts(part)}", found.sweep + parts))
    yield Work(f"estimate/{'+'.join(name for name, _ in names)}", sum(seconds for _, seconds in names))
    for part in _nested_specs(Estimator.kind, spec, registry):
        if isinstance(part.get(FrictionModel.kind), Mapping):
            yield _observer_work(part, experiment, shape, registry)


def _list_counts(spec: Plain) -> str:
    """Return the lengths of an estimator's lists of tables, such as deviations, as text: each entry is extra work."""
    counts = (len(value) for value in spec.values() if isinstance(value, list) and value and _is_table(value[0]))
    return "".join(f"[{count}]" for count in counts)


def _is_table(value: object) -> bool:
    return isinstance(value, Mapping)


def _observer_work(spec: Plain, experiment: Plain, shape: RecordShape, registry: Registry) -> Work:
    """Return the work to drive an estimator's friction model by the recorded motion."""
    friction = create(registry, FrictionModel, spec[FrictionModel.kind])
    repeats = 2 if _has_scatter(experiment, shape) else 1  # each period is also evaluated separately
    points = DRIVE_PASSES * repeats * shape.recorded * float(spec.get("oversampling", 1) or CHOSEN_OVERSAMPLING)
    points += 0 if friction.has_unique_periodic_force else shape.lead_in
    motions = shape.segments * (2 if repeats > 1 else 1)
    is_wide = motions > 1 and looks_vectorised(friction.law)
    law = "+".join(component_names(spec[FrictionModel.kind]))
    rows = points / min(LANES, motions) if is_wide else points
    return Work(f"drive/{law}/{VECTOR if is_wide else SCALAR}", cost("drive", "setup") + rows * _driven_cost(friction))


def _has_scatter(experiment: Plain, shape: RecordShape) -> bool:
    """Whether the periods of a simulated record differ."""
    return shape.repeated and any(experiment.get("loop", {}).get(key) for key in ("noise", "resolution"))


def _nested_specs(kind: str, spec: Plain, registry: Registry) -> Iterator[Plain]:
    """Yield a component's plain data, and those of the nested components of its kind."""
    yield spec
    component = registry.provider(kind, spec["name"]).component
    for key, info in component.model_fields.items():
        nested, value = nested_kind(info), spec.get(key)
        if nested is not None and nested.kind == kind and isinstance(value, Mapping):
            yield from _nested_specs(kind, value, registry)
