"""Texts of a measurement that command line and terminal UI share: its plan, and what was found at its points."""

import math
from collections.abc import Collection

from fraexp.data.results import Result
from fraexp.data.rotary_axes import is_rotary, rotary_unit
from fraexp.figures.elements.scales import decibel, degrees, readable_unit
from fraexp.measurement.measured_points import MeasuredPoint
from fraexp.measurement.measurement import MeasurementBegun
from fraexp.measurement.measurement_plan import MeasurementPlan, PlannedPoint
from fraexp.simulation.motion_limits import DEMAND_UNITS, Demand
from fraexp.views.words import duration_text, fixed_text, number_text, plural
from fraexp.workspace.measurement_service import PointEstimated

AUTONOMOUS_TOTAL = "an autonomous measurement, each stage planned by the one before,"
AUTONOMOUS_STAGES = (
    ("friction loop", "a slow sine that rises until friction is overcome"),
    ("coarse frequencies", "sines over the whole range, at amplitudes that rise from below friction to above"),
    ("fine frequencies", "sines around the modes that were found, at the same amplitudes"),
    ("validation", "a multisine with random phases, which the model found must predict"),
)
"""Stages of an autonomous measurement, and what each plays."""
FORCE_PLACE = Demand._fields.index("force")
"""Place of the force in a demand."""


def demand_names() -> list[str]:
    """Return the names of what a motion asks for, as users read them."""
    return [name.replace("_", " ") for name in Demand._fields]


def demand_units(rotary: bool) -> list[str]:
    """Return the units of a demand, in which a rotary axis has angles and torques."""
    return [rotary_unit(unit) if rotary else unit for unit in DEMAND_UNITS]


def plan_heads(plan: MeasurementPlan) -> list[str]:
    """Return the titles of a plan's columns."""
    units = demand_units(is_rotary(plan.task.experiment))
    heads = [f"{name} [{unit}]" for name, unit in zip(demand_names(), units, strict=True)]
    return ["frequency", f"peak [{units[FORCE_PLACE]}]", "time [s]", *heads]


def plan_cells(point: PlannedPoint) -> list[str]:
    """Return the row of a point in a plan."""
    return [point.frequency, *(number_text(value, 3) for value in (peak_of(point), point.seconds, *point.demand))]


def peak_of(point: PlannedPoint) -> float:
    """Return the peak [N] of the excitation at a point."""
    return point.amplitude * float(abs(point.period.waveform).max())


def plan_total(plan: MeasurementPlan, kept: Collection[int] = ()) -> str:
    """Return how many points a plan has, and how long those take that are not kept, which are given by number."""
    total, count = plural(len(plan.points), "point"), sum(point.number in kept for point in plan.points)
    if count == len(plan.points):
        return f"{total}, all kept: nothing is left to play"
    before = f", {count} kept" if count else ""
    return f"{total}{before}, about {duration_text(plan.seconds_without(kept))} of machine time"


def begin_text(event: MeasurementBegun) -> str:
    """Return which study is measured, and how much of it."""
    task = event.plan.task
    name = f"{task.study} ({task.label})" if task.label else task.study
    return f"{name}: {plan_total(event.plan, event.kept_numbers)}"


def point_text(event: PointEstimated, plan: MeasurementPlan) -> str:
    """Return how much has been measured, what was found at the last point, and how long it took."""
    measured = event.measured
    left = f", about {duration_text(measured.seconds_left)} left" if measured.seconds_left else ""
    time = duration_text(measured.point.machine_time)
    return f"{measured.done}/{measured.total}  {found_text(event, plan)}; {time}{left}"


def found_text(event: PointEstimated, plan: MeasurementPlan) -> str:
    """Return what was found at a point of a plan, in a line."""
    point = event.measured.point
    settled = "settled" if point.settled else "not settled"
    band, factor = _band_text(point, plan), _amplitude_text(point, plan)
    found = "".join(f", {response_text(result)}" for result in event.results if isinstance(result, Result))
    return f"{point.frequency}: {settled}, {plural(point.periods, 'period')}{band}{factor}{found}"


def _band_text(point: MeasuredPoint, plan: MeasurementPlan) -> str:
    """Return the band of a point, and the one that is asked for if it is missed."""
    target = plan.task.settings.band if plan.task.settings else None
    missed = f", missed ±{target:g} dB" if misses_band(point, target) else ""
    unknown = ", band not known from one period" if point.periods == 1 else ", band unknown" if missed else ""
    return (unknown if point.band is None else f", {band_text(point.band)}") + missed


def band_text(band: float) -> str:
    """Return the half-width of a band [dB] in words."""
    return f"band ±{band:.2g} dB" if math.isfinite(band) else "no band, as noise hides the motion"


def _amplitude_text(point: MeasuredPoint, plan: MeasurementPlan) -> str:
    """Return the peak of a point's excitation if it is not that of the study, and its ratio to the plan's."""
    if point.amplitude == 1:
        return ""
    planned = next(one for one in plan.points if one.number == point.number)
    ratio = point.amplitude / planned.amplitude
    unit = demand_units(is_rotary(plan.task.experiment))[FORCE_PLACE]
    peak = peak_of(planned.with_amplitude(point.amplitude))
    return f", {number_text(peak, 3)} {unit} peak{'' if ratio == 1 else f' (planned × {ratio:.2f})'}"


def response_text(result: Result) -> str:
    """Return a response at one frequency, or how many frequencies a response has."""
    response = result.response
    if response is None:
        return result.message or "no response"
    if response.frequency.size > 1:
        return f"{response.output}/{response.input} at {plural(response.frequency.size, 'frequency', 'frequencies')}"
    factor, unit = readable_unit(response.unit)
    level, phase = decibel(factor * response.response)[0], degrees(response.response)[0]
    return f"{response.output}/{response.input} {fixed_text(level, 2)} dB re 1 {unit}, {fixed_text(phase, 1)}°"


def misses_band(point: MeasuredPoint, band: float | None) -> bool:
    """Return whether a point has not reached a band [dB], or nothing is known of its own."""
    return band is not None and not (point.band is not None and point.band <= band)


class MissedBands:
    """Counts points and those that miss their band, as they come."""

    def __init__(self) -> None:
        self._band: float | None = None
        self._count = 0
        self._missed: list[MeasuredPoint] = []

    def begin(self, event: MeasurementBegun) -> None:
        """Take note of the band of an experiment, and of the points that are kept."""
        settings = event.plan.task.settings
        self._band = settings.band if settings else None
        for point in event.kept:
            self.add(point)

    def add(self, point: MeasuredPoint) -> None:
        """Take note of a point that was measured."""
        self._count += 1
        if misses_band(point, self._band):
            self._missed.append(point)

    @property
    def text(self) -> str:
        """How many points miss the band, and what to do about it; empty if none does."""
        if not self._missed:
            return ""
        known = [(point.band, point.frequency) for point in self._missed if point.band is not None]
        widest = "the widest is ±{:.2g} dB at {}".format(*max(known)) if known else "it is not known of any"
        found = f"{len(self._missed)} of {plural(self._count, 'point')} did not reach the band of ±{self._band:g} dB"
        if hidden := sum(math.isinf(band) for band, _ in known):
            return (
                f"{found}; at {hidden} noise hides the motion: see that the brake is released and the drive enabled "
                "before you raise the amplitude or measurement.max_record_time"
            )
        return f"{found}; {widest}: raise measurement.max_record_time, or the amplitude"
