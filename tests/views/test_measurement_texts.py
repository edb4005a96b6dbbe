"""What is said of a measurement: how much is left to play, and whether a point has reached its band."""

import math
from dataclasses import replace

import pytest

from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.components.registry import Registry
from fraexp.measurement.measured_points import MeasuredPoint
from fraexp.measurement.measurement import MeasurementBegun, PointMeasured
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.unknown_axis import UnknownAxis
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.views.measurement_texts import MissedBands, begin_text, found_text, plan_total
from fraexp.views.words import duration_text
from fraexp.workspace.measurement_service import PointEstimated


@pytest.fixture(scope="module")
def plan(registry: Registry) -> MeasurementPlan:
    """A plan of three sines of 20 N, each until its band is ±0.001 dB."""
    limits = MotionLimits(stroke=0.02, velocity=0.5, force=150.0)
    settings = MeasurementSettings.model_construct(band=1e-3, margin=0.1, ramp_out=0.05)
    axis = UnknownAxis("axis", "An axis", 5e-4, False, limits, settings)
    periods = axis.sines((10.0, 20.0, 40.0), registry)
    task = replace(axis.task([]), key="")
    return axis.plan(task, [axis.point(number, period, 20.0) for number, period in enumerate(periods)])


def measured(number: int, band: float | None = None, amplitude: float = 1.0) -> MeasuredPoint:
    return MeasuredPoint(number, f"{10 * 2**number} Hz", amplitude, 0, 0, 4, 100, (1,), True, 0.0, 2.0, band=band)


def test_points_that_are_kept_take_no_time(plan: MeasurementPlan) -> None:
    last = plan.points[2]
    seconds = (last.settling + last.counts.record + last.ramp_out) * last.sample_time
    assert plan_total(plan) == f"3 points, about {duration_text(plan.seconds)} of machine time"
    text = f"3 points, 2 kept, about {duration_text(seconds)} of machine time"
    assert plan_total(plan, {0, 1}) == text
    assert begin_text(MeasurementBegun(plan, (measured(0), measured(1)))) == f"axis: {text}"
    assert plan_total(plan, {0, 1, 2}) == "3 points, all kept: nothing is left to play"


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (measured(0, 9e-4), "10 Hz: settled, 4 periods, band ±0.0009 dB"),
        (measured(0, 0.012), "10 Hz: settled, 4 periods, band ±0.012 dB, missed ±0.001 dB"),
        (measured(0), "10 Hz: settled, 4 periods, band unknown, missed ±0.001 dB"),
        (measured(0, math.inf), "10 Hz: settled, 4 periods, no band, as noise hides the motion, missed ±0.001 dB"),
        (replace(measured(0), periods=1), "10 Hz: settled, 1 period, band not known from one period, missed ±0.001 dB"),
        (measured(0, 9e-4, 20.0), "10 Hz: settled, 4 periods, band ±0.0009 dB, 20 N peak"),
        (measured(0, 9e-4, 14.0), "10 Hz: settled, 4 periods, band ±0.0009 dB, 14 N peak (planned × 0.70)"),
    ],
)
def test_a_point_says_what_it_missed_and_how_it_was_excited(
    plan: MeasurementPlan, point: MeasuredPoint, words: str
) -> None:
    assert found_text(PointEstimated(PointMeasured(point, 1, 3, 2.0, 4.0), ()), plan) == words


def test_the_end_counts_the_points_that_missed_their_band(plan: MeasurementPlan) -> None:
    missed = MissedBands()
    missed.begin(MeasurementBegun(plan, (measured(0, 0.012),)))
    missed.add(measured(1, 1e-3))
    missed.add(measured(2, 0.004))
    assert missed.text.startswith("2 of 3 points did not reach the band of ±0.001 dB; the widest is ±0.012 dB at 10 Hz")


def test_without_a_band_nothing_is_missed(plan: MeasurementPlan) -> None:
    settings = plan.task.settings
    assert settings is not None
    task = replace(plan.task, settings=settings.model_copy(update={"band": None}))
    missed = MissedBands()
    missed.begin(MeasurementBegun(replace(plan, task=task), (measured(0, 0.012), measured(1))))
    assert missed.text == ""
