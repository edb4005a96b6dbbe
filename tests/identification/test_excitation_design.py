"""Sines that tell most in a given time: the search against all plans there are, the design, and what is refused."""

from bisect import bisect_right
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from fraexp_plugins.identification._law_numbers import nonzero_numbers
from fraexp_plugins.identification._machine_problem import SCALES, FreeParameters
from fraexp_plugins.identification._record_fit import RecordFit
from fraexp_plugins.identification.excitation_design import (
    Plan,
    PlannedRecord,
    PlanSearch,
    planned_records,
    repeated_error,
)

from fraexp.components.kinds import Estimator, Excitation, FrictionModel, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError, RecordError
from tests.identification.plant_responses import SCALE
from tests.identification.test_maximum_likelihood import MACHINE, metrics, scaled

NOISE = 3e-7
LOOP = {**MACHINE["loop"], "resolution": SCALE["resolution"]}
SINE = {"name": "stepped_sine", "amplitude": 12.0, "min_frequency": 2.0, "max_frequency": 120.0, "points": 12}


def design(**given):
    method = {
        "name": "maximum_likelihood", "friction": scaled(1.1, 0.9), "resolution": SCALE["resolution"], "noise": NOISE,
        "input_dead_time": LOOP["input_dead_time"],
    }  # fmt: skip
    common = {"method": method, "amplitudes": [6.0, 12.0], "measuring_time": 40.0, "controller": MACHINE["controller"]}
    return create(discover(), Estimator, {"name": "excitation_design", "loop": LOOP, **common, **given})


def drawn_record(random, frequency, amplitude, repeated=0.0):
    """Return a record of random information, of which a greater amplitude tells more.

    Its six samples depend on three shared parameters, and on the two parts of its own response.
    """
    shared, own = amplitude * random.normal(0, 1, (6, 3)), amplitude * random.normal(0, 1, (6, 2))
    known, told = np.linalg.inv(own.T @ own), np.linalg.lstsq(own, shared)[0]
    times = 1 / frequency, 0.2 + 1 / frequency
    return PlannedRecord(
        frequency, amplitude, *times, amplitude, shared.T @ shared, known, slopes=-told, told=told, repeated=repeated
    )


@pytest.fixture(params=range(4))
def search(request):
    random = np.random.default_rng(request.param)
    choices = tuple(tuple(drawn_record(random, f, amplitude) for amplitude in (1.0, 1.3)) for f in (1.0, 2.0, 4.0))
    return PlanSearch(choices, (True, True, request.param % 2 == 0), 2, 12.0)


def every_plan(search):
    """Yield all plans that are possible."""
    for records in product(*search.choices):
        lasting = [records[0].time(count) for count in range(1, 60)]
        counts = [range(int(wanted), 30) for wanted in search.is_wanted]
        for pair in product(*counts[1:]):
            left = search.time - sum(record.time(count) for record, count in zip(records[1:], pair, strict=True))
            if lasting[0] <= left:
                yield Plan(records, (bisect_right(lasting, left), *pair))


def test_the_search_finds_the_best_of_all_plans(search):
    start = search.uniform()
    found = search.best()
    best = min(map(search.criterion, every_plan(search)))
    assert start.time <= search.time
    assert found.time <= search.time
    assert search.criterion(found) <= best + 0.01
    assert search.criterion(found) <= search.criterion(start)


def test_a_repeated_period_tells_what_is_not_rounded_alike():
    random = np.random.default_rng(1)
    position, step = random.uniform(-50, 50, 4000), 1.0
    for noise in (0.0, 0.1, 0.2, 1.0):
        periods = position + noise * random.standard_normal((200, position.size))
        errors = step * np.round(periods / step) - position
        found = np.mean(errors.mean(axis=0) ** 2) / np.mean(errors**2)  # 1/200 more of what is not repeated
        assert repeated_error(noise, step) == pytest.approx(found, abs=0.02)
    silent, noisy = (drawn_record(random, 1.0, 1.0, repeated) for repeated in (1.0, 0.0))
    once, often = (Plan((silent,), (count,)).standard_deviations() for count in (1, 9))
    np.testing.assert_array_equal(once, often)
    once, often = (Plan((noisy,), (count,)).standard_deviations() for count in (1, 9))
    np.testing.assert_allclose(once, 3 * often)


def test_a_plan_lasts_as_long_as_its_simulation(recorded, registry):
    """Settling included, and what the windows in which it shows have of the record."""
    sines = {"name": "sine_list", "frequencies": [20.0, 80.0], "amplitudes": [12.0]}
    method = design().method
    problem = method.problem(recorded(sines, noise=NOISE), NOISE, method.law)
    plant = create(registry, Plant, MACHINE["plant"])
    records = planned_records(RecordFit.around(problem, plant), (12.0, 12.0))
    for counts in ((1, 1), (3, 10)):
        segments = recorded({**sines, "period_counts": counts}, noise=NOISE).segments
        lasted = [each.settling.time + each.channels["y"].size * each.sample_time for each in segments]
        assert [each.time(count) for each, count in zip(records, counts, strict=True)] == pytest.approx(lasted)


@pytest.fixture(scope="module")
def short(recorded):
    """One period at each frequency."""
    return recorded(SINE, noise=NOISE)


@pytest.mark.thorough
def test_the_bands_of_a_plan_are_those_of_the_estimate(short, registry):
    friction, plant = create(registry, FrictionModel, MACHINE["friction"]), create(registry, Plant, MACHINE["plant"])
    method = design().method.model_copy(update={"friction": friction})
    fit = RecordFit.around(method.problem(short, NOISE, friction), plant)
    records = planned_records(replace(fit, free=FreeParameters(SCALES, nonzero_numbers(plant))), (12.0,) * 12)
    response = method.estimate(short).response
    true = np.abs(plant.response(2 * np.pi * response.frequency))
    found = response.standard_deviation * true / np.abs(response.response) ** 2  # of 1/P̂, over the true 1/P
    np.testing.assert_allclose(Plan(tuple(records), (1,) * 12).standard_deviations(), found, rtol=0.06)


@pytest.mark.thorough
def test_designed_sines_last_as_long_as_allowed_and_promise_more(short, registry):
    result = design().estimate(short)
    assert result.outcome is Outcome.OK, result.message
    known = metrics(result)
    assert known["designed plan: time"] <= 40
    assert known["designed plan: band, rms"] < known["uniform plan: band, rms"]
    assert known["designed plan: force_scale, 95 %"] < known["uniform plan: force_scale, 95 %"]
    units = {metric.name: metric.unit for metric in result.metrics}
    intervals = [name for name in units if f"uniform plan: {name}" in units]
    assert "k0, 95 %" in intervals
    for name in intervals:  # 40 s instead of the 15 s or so of one period each
        assert units[f"uniform plan: {name}"] == units[name]
        assert 0.1 < known[f"uniform plan: {name}"] / known[name] < 1.1, name
    (fit,) = (each for each in result.fits if each.kind == "excitation")
    excitation = create(registry, Excitation, fit.component)
    assert len(excitation.frequencies) == 12
    assert set(excitation.amplitudes) <= {6.0, 12.0}
    periods = excitation.periods(LOOP["sample_time"])
    recorded_time = sum(each.recorded_periods * each.waveform.size for each in periods) * LOOP["sample_time"]
    assert 15 < recorded_time < known["designed plan: time"]


@pytest.mark.thorough
def test_amplitudes_that_move_too_far_are_not_chosen(short):
    result = design(max_stroke=1.5e-4, measuring_time=60.0).estimate(short)
    (plan,) = (curve for curve in result.curves if curve.name == "designed plan")
    far = np.array([np.ptp(segment.channels["y"]) > 1.5e-4 for segment in short.segments])
    assert 0 < far.sum() < far.size
    assert set(plan.columns["amplitude"][far]) == {6.0}
    assert 12 in plan.columns["amplitude"][~far]
    with pytest.raises(RecordError, match="farther than max_stroke"):
        design(max_stroke=1e-9).estimate(short)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"method": {"name": "conventional"}}, "method is conventional; expected maximum_likelihood"),
        ({"amplitudes": []}, "must be one or more numbers above 0 N"),
        ({"amplitudes": [3.0, -1.0]}, "must be one or more numbers above 0 N"),
        ({"loop": {"sample_time": -1.0}}, "sample_time"),
    ],
)
def test_what_cannot_be_designed_is_refused(given, reason):
    with pytest.raises(ParameterError, match=reason):
        design(**given)
