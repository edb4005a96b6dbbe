"""The figure of distributions: quantiles, the worst draw and those without a value."""

from dataclasses import replace

import numpy as np

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


def test_the_worst_is_that_of_the_draws():
    info = distribution_info(shown("nominal", TIMES), "T")
    (panel,) = info.panels
    (sample,) = panel.samples
    assert (panel.metric, panel.unit, sample.count) == ("metric 0", "ms", 10)
    np.testing.assert_allclose(sample.values, np.arange(10.0, 20.0))
    assert sample.worst.drawn == RandomDraw(3, "nominal")


def test_a_draw_without_a_value_counts_as_worse_than_all():
    (axes,) = draw_figure(shown("nominal", [*TIMES[:9], np.nan]), kind="distribution").axes
    (steps,) = (line for line in axes.lines if len(line.get_xdata()) == 10)
    np.testing.assert_allclose(steps.get_xydata()[[0, 5, 9]], [[11.0, 0.0], [15.0, 50.0], [19.0, 90.0]])


def test_a_case_that_never_has_a_value_is_in_the_legend():
    found = shown("nominal", TIMES) + shown("wrong", [np.nan] * 10)
    (panel,) = distribution_info(found).panels
    assert [sample.worst is None for sample in panel.samples] == [False, True]
    figure = draw_figure(found, kind="distribution")
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.texts] == ["draw 3"]
    assert [text.get_text() for text in figure.legends[0].texts] == ["nominal", "wrong"]


def test_the_worst_is_the_greatest_magnitude():
    (panel,) = distribution_info(shown("", [-0.5, *TIMES])).panels
    assert panel.samples[0].worst.drawn.number == 1


def test_cases_lie_over_each_other_and_the_worst_draws_are_named():
    both = shown("nominal", TIMES) + shown("wrong", [2 * time for time in reversed(TIMES)])
    figure = draw_figure(both, title="Robustness", kind="distribution")
    (panel,) = figure.axes
    assert panel.get_xlabel() == "Metric 0 [ms]"
    assert [text.get_text() for text in panel.texts] == ["draw 3", "draw 8"]
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
    names = [panel.metric for panel in distribution_info(taken).panels]
    assert names == ["metric 1", "metric 2", "metric 3", "metric 4"]
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
