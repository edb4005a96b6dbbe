"""The plan of a measurement, printed: points, durations, and what they ask of the machine."""

from collections.abc import Collection

from fraexp.cli.output import print_table
from fraexp.data.rotary_axes import is_rotary
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.watched_machine import drive_note
from fraexp.simulation.motion_limits import Demand
from fraexp.views.measurement_texts import demand_names, demand_units, plan_cells, plan_heads, plan_total


def print_plan(plan: MeasurementPlan, kept: Collection[int] = ()) -> None:
    """Print the points in the order in which they are played, and the greatest demand beside each limit.

    Points that an earlier measurement has kept are given by number.
    """
    if plan.task.label:
        print(plan.task.label)
    print_table(plan_heads(plan), [plan_cells(point) for point in plan.points])
    print()
    limits = [getattr(plan.limits, name) for name in Demand._fields]
    rows = zip(demand_names(), demand_units(is_rotary(plan.task.experiment)), plan.demand, limits, strict=True)
    print_table(
        ["greatest", "predicted", "limit", "of it"],
        [
            [
                name,
                f"{value:.3g} {unit}",
                "none" if limit is None else f"{limit:.3g} {unit}",
                "" if limit is None else f"{100 * value / limit:.0f} %",
            ]
            for name, unit, value, limit in rows
        ],
    )
    print(f"\n{plan_total(plan, kept)}")
    machine = plan.task.settings.machine if plan.task.settings else None
    if machine is not None and (note := drive_note(machine.name, machine.can_disable)):
        print(note)


def plan_document(plan: MeasurementPlan) -> dict[str, object]:
    """Return a plan as plain data."""
    return {
        "experiment": plan.task.label,
        "seconds": plan.seconds,
        "limits": plan.limits.plain(),
        "demand": plan.demand._asdict(),
        "points": [
            {
                "number": point.number,
                "frequency": point.frequency,
                "settling": point.settling * point.sample_time,
                "record": point.counts.record * point.sample_time,
                **point.demand._asdict(),
            }
            for point in plan.points
        ],
    }
