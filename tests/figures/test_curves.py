"""The figure of any curves: names, decades, models, limits and gaps."""

import numpy as np
import pytest
from fraexp_plugins.identification._law_forces import force_over_velocity, virgin_curve
from matplotlib.colors import to_hex

from fraexp.data.results import Curve, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure
from fraexp.figures.elements.bands import TINT_SHARE, mix_grey
from fraexp.figures.elements.frequency_lines import MODEL_LINE_WIDTH
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.panel_figure import draw_panels
from fraexp.figures.kinds.curves import curves_info
from tests.figures.curves import make_loop
from tests.refusals import refused

FREQUENCY = np.geomspace(1, 200, 40)


def harmonic(name, size=1.0):
    columns = {"frequency": FREQUENCY, "magnitude": size * 1e-3 / FREQUENCY**2, "phase": np.full(40, 40.0)}
    return Curve(name, columns, {"frequency": "Hz", "magnitude": "m/N", "phase": "deg"})


def levels():
    columns = {"frequency": FREQUENCY, "output": 1 / FREQUENCY, "noise": np.full(40, 1e-6), "change": 1e-3 - FREQUENCY}
    return Curve("levels", columns, dict.fromkeys(columns, "m") | {"frequency": "Hz"})


def sliding():
    velocity = np.array([0.02, -0.01, 0.01, -0.02])
    model = 5 * np.sign(velocity) + velocity
    return force_over_velocity(velocity, model + 0.1, model)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_curves_with_names_of_their_own_are_told_apart():
    figure = draw_panels(curves_info([("a", harmonic("H1")), ("a", harmonic("H2", 0.1))], "Study"))
    assert legend(figure) == ["H1", "H2"]
    figure = draw_panels(curves_info([(name, harmonic(of)) for name in "ab" for of in ("H1", "H2")]))
    assert legend(figure) == ["a, H1", "a, H2", "b, H1", "b, H2"]
    upper = figure.axes[0]
    drawn = {(line.get_color(), str(line.get_linestyle())) for line in upper.lines if len(line.get_xdata())}
    assert len(drawn) == 4


def test_curves_with_other_columns_are_below_under_their_names():
    figure = draw_figure(
        [ShownResult("a", Result(Outcome.OK, curves=(harmonic("H1"), levels())))], title="Study", kind="curves"
    )
    assert figure.get_suptitle() == "Study"
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["H1", "", "Levels", "", ""]
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "Magnitude [mm/N]", "Phase [deg]", "Output [mm]", "Noise [mm]", "Change [mm]",
    ]  # fmt: skip
    assert legend(figure) == ["a"]


def test_a_column_that_some_lack_keeps_no_curve_out():
    short = harmonic("fit")
    del short.columns["phase"]
    info = curves_info([("short", short), ("whole", harmonic("fit"))])
    (family,) = info.families
    assert [[trace.name for trace in panel.lines] for panel in family.panels] == [["short", "whole"], ["whole"]]


def test_frequency_and_amplitudes_over_it_are_in_decades():
    upper, lower = draw_panels(curves_info([("a", harmonic("H1"))])).axes
    assert upper.get_xscale() == lower.get_xscale() == "log"
    assert upper.get_xlim() == pytest.approx((1, 200), rel=0.02)
    assert (upper.get_yscale(), lower.get_yscale()) == ("log", "linear")
    np.testing.assert_allclose(upper.lines[0].get_ydata(), 1 / FREQUENCY**2)


@pytest.mark.parametrize(
    ("amplitudes", "scale"), [(np.geomspace(1e-8, 1e-2, 25), "log"), (np.linspace(1e-8, 1e-2, 25), "linear")]
)
def test_an_abscissa_spaced_by_ratios_is_in_decades(amplitudes, scale):
    columns = {"amplitude": amplitudes, "modulus margin": np.linspace(0.3, 0.6, 25)}
    (axes,) = draw_panels(curves_info([("a", Curve("loop", columns, {"amplitude": "m", "modulus margin": "1"}))])).axes
    assert (axes.get_xscale(), axes.get_yscale()) == (scale, "linear")
    assert (axes.get_xlabel(), axes.get_xlim()[1]) == ("Amplitude [mm]", pytest.approx(10, rel=0.06))


def test_amplitudes_in_one_unit_share_their_decades():
    info = curves_info([("a", levels())])
    assert {panel.unit for panel in info.panels} == {"mm"}, "as they are drawn, and not as they are stored"
    output, noise, change = draw_panels(info).axes
    assert output.get_yscale() == noise.get_yscale() == "log"
    assert output.get_ylim() == noise.get_ylim()
    assert change.get_yscale() == "linear", "it is below 0 as well"


def test_a_model_is_a_line_through_points_with_a_gap_where_nothing_is_known():
    figure = draw_panels(curves_info([("a", sliding())]))
    forward, backward = figure.axes  # the slope of either would not show beside the step between them
    assert legend(figure) == ["a", "model"]
    for axes, force in ((forward, [np.nan, np.nan, np.nan, 5.01, 5.02]), (backward, [-5.02, -5.01, *[np.nan] * 3])):
        points, line = [line for line in axes.lines if len(line.get_xdata())]
        assert (points.get_linestyle(), points.get_marker(), len(points.get_xdata())) == ("None", "o", 2)
        assert to_hex(points.get_color()) == to_hex(mix_grey(line.get_color(), 1.0, TINT_SHARE))
        assert line.get_linewidth() == MODEL_LINE_WIDTH
        np.testing.assert_allclose(line.get_xdata(), [-20, -10, 0, 10, 20])
        np.testing.assert_allclose(line.get_ydata(), force)
    assert backward.get_xlabel() == "Velocity [mm/s]"
    assert backward.get_xscale() == "linear"


@pytest.mark.parametrize(
    ("width", "unit", "shown"), [(6e-4, "µm", 600), (6e-7, "nm", 600), (2e-3, "mm", 2), (0.0, "mm", 0)]
)
def test_lengths_are_in_a_unit_in_which_they_are_readable(width, unit, shown):
    x = np.linspace(0, width, 9)
    (axes,) = draw_panels(curves_info([("a", virgin_curve(x, 10 + x, np.full(9, 0.5)))])).axes
    assert axes.get_xlabel() == f"Displacement [{unit}]"
    assert axes.lines[0].get_xdata()[-1] == pytest.approx(shown)


def test_limits_are_a_band():
    x = np.linspace(0, 1e-3, 9)
    curve = virgin_curve(x, 1e4 * x, np.full(9, 0.5))
    info = curves_info([("a", curve)])
    assert len(info.panels) == 1
    figure = draw_panels(info)
    assert legend(figure) == ["a", "95 %"]
    edges = figure.axes[0].collections[0].get_paths()[0].vertices
    assert edges[:, 1].max() == pytest.approx(10 + 1.959964 * 0.5)
    assert edges[:, 0].max() == pytest.approx(1)


def test_a_curve_without_an_ordinate_is_left_out():
    bare = Curve("bare", {"time": np.arange(3.0)}, {"time": "s"})
    assert len(draw_panels(curves_info([("a", bare), ("a", sliding())])).axes) == 2, "one curve, both directions"
    with refused(FraexpError, "curves figure"):
        curves_info([("a", bare)])


def test_curves_are_chosen_where_not_every_result_has_a_loop():
    alone = ShownResult("loop", Result(Outcome.OK, curves=(make_loop(1e-5), sliding())))
    assert draw_figure([alone]).axes[0].get_ylabel() == "Friction force [N]"
    both = draw_figure([alone, ShownResult("other", Result(Outcome.OK, curves=(sliding(),)))])
    assert [axes.get_title(loc="left") for axes in both.axes] == ["Loop", "Force over velocity", ""]


def test_a_force_in_newton_metres_is_a_torque_over_an_angle():
    units = {"displacement": "rad", "friction force": "N m"}
    curve = Curve("friction force", {"displacement": np.linspace(0, 5e-4, 9), "friction force": np.ones(9)}, units)
    axes = draw_panels(curves_info([("", curve)], "Study")).axes[0]
    assert (axes.get_title(loc="left"), axes.get_xlabel()) == ("Friction torque", "Displacement [µrad]")
    assert axes.get_ylabel() == "Friction torque [N m]"
