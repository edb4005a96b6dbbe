"""The plan of a measurement, printed: points, durations, and what they ask of the machine."""

from fraexp.cli.output import print_table
from fraexp.data.rotary_axes import is_rotary, rotary_unit
from fraexp.measurement.measurement_plan import MeasurementPlan, PlannedPoint
from fraexp.simulation.motion_limits import DEMAND_UNITS, Demand
from fraexp.views.words import duration_text, number_text, plural

FORCE_PLACE = Demand._fields.index("force")
"""Place of the force in a demand."""


def print_plan(plan: MeasurementPlan) -> None:
    """Print the points in the order in which they are played, and the greatest demand beside each limit."""
    if plan.task.label:
        print(plan.task.label)
    units = _units(plan)
    heads = [f"{name.replace('_', ' ')} [{unit}]" for name, unit in zip(Demand._fields, units, strict=True)]
    print_table(
        ["frequency", f"peak [{units[FORCE_PLACE]}]", "time [s]", *heads], [_cells(point) for point in plan.points]
    )
    print()
    limits = [getattr(plan.limits, name) for name in Demand._fields]
    rows = zip(Demand._fields, units, plan.demand, limits, strict=True)
    print_table(
        ["greatest", "predicted", "limit", "of it"],
        [
            [
                name.replace("_", " "),
                f"{value:.3g} {unit}",
                "none" if limit is None else f"{limit:.3g} {unit}",
                "" if limit is None else f"{100 * value / limit:.0f} %",
            ]
            for name, unit, value, limit in rows
        ],
    )
    print(f"\n{plural(len(plan.points), 'point')}, about {duration_text(plan.seconds)} of machine time")


def _units(plan: MeasurementPlan) -> list[str]:
    """Return the units of a demand, in which a rotary axis has angles and torques."""
    rotary = is_rotary(plan.task.experiment)
    return [rotary_unit(unit) if rotary else unit for unit in DEMAND_UNITS]


def _cells(point: PlannedPoint) -> list[str]:
    peak = point.amplitude * float(abs(point.period.waveform).max())
    time = (point.settling + point.counts.record + point.ramp_out) * point.sample_time
    return [point.frequency, *(number_text(value, 3) for value in (peak, time, *point.demand))]


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
