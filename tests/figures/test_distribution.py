"""The figure of distributions: quantiles, the worst draw and those without a value."""

from dataclasses import replace

import numpy as np
import pytest

from fraexp.data.results import Metric, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure
from fraexp.figures.elements.grouping import ShownResult, group_sweeps
from fraexp.figures.elements.labels import RandomDraw, curve_names, describe_draws
from fraexp.figures.kinds.distribution import MAX_METRICS, distribution_info
from tests.refusals import refused


def shown(family, *columns, unit="s", extra=()):
    """Return a sweep for each row of metrics, drawn around a family."""
    found = []
    for number, values in enumerate(zip(*columns, strict=True), start=1):
        metrics = tuple(Metric(f"metric {n}", value, unit) for n, value in enumerate(values))
        result = Result(Outcome.OK, metrics=(*metrics, *extra))
        drawn = RandomDraw(number, family)
        found.append(ShownResult(f"{family}, draw {number}", result, key=f"fx1-{number:08d}", drawn=drawn))
    return found


TIMES = [0.012, 0.011, 0.019, 0.013, 0.015, 0.014, 0.016, 0.017, 0.018, 0.010]


def test_a_distribution_has_a_step_for_each_draw():
    info = distribution_info(shown("nominal", TIMES), "T")
    (family,) = info.families
    (line,) = family.panels[0].lines
    assert family.abscissa == "Metric 0 [ms]"
    np.testing.assert_allclose(line.x, np.repeat(np.arange(10.0, 20.0), 2))
    np.testing.assert_allclose(line.y, 10 * np.repeat(np.arange(11), 2)[1:-1])


def test_a_draw_without_a_value_counts_as_worse_than_all():
    (panel,) = distribution_info(shown("nominal", [*TIMES[:9], np.nan])).panels
    (line,) = panel.lines
    assert (line.x[0], line.y[0]) == pytest.approx((11.0, 0.0))
    assert (line.x[9], line.y[9]) == pytest.approx((15.0, 50.0)), "the fifth of ten"
    assert (line.x[-1], line.y[-1]) == pytest.approx((19.0, 90.0))


def test_cases_lie_over_each_other_and_one_that_never_has_a_value_is_in_the_legend():
    found = shown("nominal", TIMES) + shown("wrong", [np.nan] * 10)
    figure = draw_figure(found, title="Robustness", kind="distribution")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_title()) == ("Metric 0 [ms]", "Robustness")
    assert [text.get_text() for text in figure.legends[0].texts] == ["nominal", "wrong"]


def test_only_metrics_that_differ_are_drawn_in_their_order_and_not_what_an_experiment_takes():
    constant, wide = [1.0] * 10, [1e3 * time for time in TIMES]
    columns = [constant, [np.nan, *TIMES[1:]], wide, TIMES, TIMES, TIMES]
    found = shown("", *columns)
    taken = [
        ShownResult(
            of.label, Result(Outcome.OK, metrics=(Metric("stroke", 1.0 + n, "m"), *of.result.metrics)), drawn=of.drawn
        )
        for n, of in enumerate(found)
    ]
    names = [family.abscissa.partition(" [")[0] for family in distribution_info(taken).families]
    assert names == ["Metric 1", "Metric 2", "Metric 3", "Metric 4"]
    assert len(names) == MAX_METRICS


def test_too_little_or_too_much_is_refused():
    with refused(FraexpError, "distribution", "[monte_carlo]"):
        distribution_info([replace(of, drawn=None) for of in shown("", [1.0] * 20)])
    with refused(FraexpError, "deviation"):
        distribution_info(shown("", [1.0] * 20))
    for count, found in ((1, "1 draw"), (6, "6 draws")):
        with refused(FraexpError, found, 7, "'count'", "[monte_carlo]"):
            distribution_info(shown("", TIMES[:count]))
    with refused(FraexpError, "7 cases", 6):
        distribution_info([of for n in range(7) for of in shown(f"case {n}", TIMES)])


LABELS = [
    {"case": case, "draw": draw, "plant.gain": 0.13 + 0.01 * draw, "plant.frequencies.0": 38.0 + draw}
    for case in ("a", "b")
    for draw in (1, 2, 3)
]
UNITS = {"plant.gain": "m/(N s**2)", "plant.frequencies.0": "Hz"}


def test_a_draw_is_named_by_its_number_and_grouped_by_what_it_was_drawn_around():
    assert curve_names(LABELS, [""] * 6, UNITS)[:2] == ["a, draw 1", "a, draw 2"]
    assert [place.point for place in group_sweeps(LABELS, UNITS)] == ["a", "a", "a", "b", "b", "b"]
    found = describe_draws(LABELS, UNITS)
    assert found[3] == RandomDraw(1, "b")
    assert describe_draws([{"case": "a"}], {}) == [None]
