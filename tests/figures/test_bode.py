import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure
from fraexp.figures.elements.bands import isolated_points
from fraexp.figures.elements.frequency_lines import MODEL_LINE_WIDTH
from fraexp.figures.elements.grouping import CurvePlace, ShownResult
from fraexp.figures.kinds.bode import RIGID_BODY_STYLE, bode_info, draw_bode
from tests.figures.curves import make_response
from tests.refusals import refused


def test_magnitudes_are_in_decibel_of_a_millimetre_per_newton() -> None:
    info = bode_info([("P", make_response([10.0, 1.0], [-1e-3, -1e-1]))])
    assert info.unit == "mm/N"
    np.testing.assert_allclose(info.curves[0].frequency, [1, 10])
    np.testing.assert_allclose(info.curves[0].magnitude, [40, 0], atol=1e-9)
    np.testing.assert_allclose(info.curves[0].phase, [-180, -180])


def test_curves_lie_on_the_branch_of_the_reference() -> None:
    frequency = np.geomspace(1, 200, 50)
    plant = 0.1 / (2j * np.pi * frequency) ** 2
    noisy = make_response(frequency, plant * np.exp(1j * np.where(np.arange(50) % 2, 0.02, -0.02)))
    info = bode_info([("noisy", noisy)], ("P(s)", frequency, plant))
    assert info.reference is not None
    np.testing.assert_allclose(info.reference.phase, -180)
    assert np.abs(info.curves[0].phase + 180).max() == pytest.approx(np.degrees(0.02))


def test_the_band_is_that_of_95_percent() -> None:
    info = bode_info([("P", make_response([1.0, 2.0], [1e-3, 1e-3j], deviation=[1e-5, 1e-3]))])
    curve = info.curves[0]
    expected = 20 * np.log10(1 + 1.959964e-2 * np.array([-1, 1]))
    np.testing.assert_allclose(curve.magnitude_band[:, 0], expected, rtol=1e-6)
    np.testing.assert_allclose(curve.phase_band[:, 0], np.degrees([-1.959964e-2, 1.959964e-2]), rtol=1e-6)
    assert curve.magnitude_band[0, 1] == -np.inf, "a deviation above the magnitude has no lower limit in dB"


def test_a_band_without_a_limit_ends_at_the_edge_of_the_axis() -> None:
    frequency = np.geomspace(1, 100, 20)
    plant = -1e-3 / frequency**2
    deviation = np.abs(plant) * np.where(frequency < 5, 3.0, 1e-3)
    axes = draw_bode({"": bode_info([("P", make_response(frequency, plant, deviation=deviation))])}).axes[0]
    span = np.ptp(axes.get_ylim())
    assert span < 2 * np.ptp(20 * np.log10(np.abs(plant))), "the lines keep most of the axis"
    edges = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert edges.min() < axes.get_ylim()[0]
    assert np.isfinite(edges).all()


@pytest.mark.parametrize("lower", [0.0, 1e-45])
def test_the_axis_of_many_facets_follows_the_curves_and_not_a_band_that_nearly_reaches_zero(lower: float) -> None:
    frequency = np.geomspace(1, 100, 20)
    plant = -1e-3 / frequency**2
    deviation = np.abs(plant) * np.where(frequency < 5, (1 - lower) / 1.959964, 1e-3)
    places = [CurvePlace(facet=f"facet {n}", group="a", point=str(n)) for n in range(9)]
    results = [Result(Outcome.OK, response=make_response(frequency, plant, deviation=deviation)) for _ in places]
    figure = draw_figure([ShownResult("a", of, place) for of, place in zip(results, places, strict=True)])
    magnitude = 20 * np.log10(1e3 * np.abs(plant))
    low, high = figure.axes[0].get_ylim()
    assert low < magnitude.min() < magnitude.max() < high
    assert high - low < 2 * np.ptp(magnitude)


def test_unsettled_points_are_gaps_in_the_line() -> None:
    settled = [True, False, True, False, True, True]
    info = bode_info([("P", make_response(np.arange(1, 7), np.full(6, 1e-3), settled=settled))])
    curve = info.curves[0]
    np.testing.assert_array_equal(np.isnan(curve.with_gaps(curve.magnitude)), ~np.array(settled))
    np.testing.assert_array_equal(isolated_points(curve.settled), [True, False, True, False, False, False])
    np.testing.assert_allclose(curve.magnitude, 0, atol=1e-9)  # still there to be drawn hollow
    hollow = [line for line in draw_bode({"": info}).axes[0].lines if line.get_fillstyle() == "none"]
    assert [list(line.get_xdata()) for line in hollow] == [[2, 4]]


def test_no_line_crosses_a_gap_in_which_a_mode_could_hide() -> None:
    frequency = [1.0, 2.0, 4.0, 8.0, 9.0, 10.0]
    response = make_response(frequency, np.full(6, 1e-3), deviation=np.full(6, 1e-5))
    axes = draw_bode({"": bode_info([("P", response)])}).axes[0]
    points, lines = (
        [of for of in axes.lines if of.get_marker() == "o"],
        [of for of in axes.lines if of.get_marker() != "o"],
    )
    assert [list(of.get_xdata()) for of in points] == [[1, 2, 4]]
    (line,) = lines
    np.testing.assert_array_equal(
        np.isnan(line.get_ydata()), [False, True, False, True, False, True, False, False, False]
    )
    (bars,) = [of for of in axes.collections if hasattr(of, "get_segments")]
    np.testing.assert_allclose([each[:, 0] for each in bars.get_segments()], [[1, 1], [2, 2], [4, 4]])


def test_a_response_of_points_alone_stands_in_the_legend() -> None:
    response = make_response([1.0, 2.0, 4.0], np.full(3, 1e-3))
    figure = draw_bode({"": bode_info([("few", response)])})
    (handle,) = figure.legends[0].legend_handles
    assert [of.get_text() for of in figure.legends[0].get_texts()] == ["few"]
    assert (handle.get_marker(), handle.get_linestyle()) == ("o", "None")


def test_responses_of_different_units_do_not_share_axes() -> None:
    one, other = make_response([1.0], [1.0]), make_response([1.0], [1.0], unit="rad/A")
    with refused(FraexpError, "Bode plot", "m/N", "rad/A"):
        bode_info([("a", one), ("b", other)])


def test_panels_share_a_logarithmic_axis_with_units() -> None:
    response = make_response(np.geomspace(1, 200, 9), np.ones(9))
    upper, lower = draw_bode({"": bode_info([("a", response)], title="My study")}).axes
    assert upper.get_xscale() == lower.get_xscale() == "log"
    assert upper.get_xlim() == lower.get_xlim() == pytest.approx((1, 200), rel=0.02)
    assert (upper.get_title(), upper.get_ylabel()) == ("My study", "Magnitude [dB re 1 mm/N]")
    assert (lower.get_xlabel(), lower.get_ylabel()) == ("Frequency [Hz]", "Phase [deg]")


def test_every_curve_has_a_style_of_its_own_and_a_place_in_the_legend() -> None:
    count = 20
    response = make_response([1.0, 2.0], [1.0, 1.0])
    figure = draw_bode({"": bode_info([(f"curve {index}", response) for index in range(count)])})
    styles = {(line.get_color(), str(line.get_linestyle())) for line in figure.axes[0].lines}
    assert len(styles) == count
    assert len(figure.legends[0].get_texts()) == count


PLANT = Modal(rigid_body_gain=0.132, frequencies=(38.8,), damping_ratios=(0.005,), modal_gain_ratios=(0.34,))
"""A resonance far narrower than the points are apart."""
MARKS = ["resonance", "antiresonance", "rigid body (apparent mass 7.576 kg)"]


def fitted(**given: object) -> Result:
    frequency = np.geomspace(5, 150, 60)
    response: FrequencyResponse = make_response(frequency, PLANT.response(2 * np.pi * frequency))
    return ModalFit(method=Conventional(), modes=1, min_frequency=10, **given).fit_response(response)


def test_a_fitted_plant_is_a_thin_line_through_the_points_of_its_response() -> None:
    plain = ShownResult("plain", Result(Outcome.OK, response=make_response([5.0, 150.0], [-1e-3, -1e-6])))
    figure = draw_figure([plain, ShownResult("a", fitted()), ShownResult("b", fitted())])
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["plain", "a", "b", "fitted plant", *MARKS]
    for axes, part in zip(figure.axes, ("magnitude", "phase"), strict=True):
        rigid = RIGID_BODY_STYLE["linewidth"]
        drawn = [line for line in axes.lines if len(line.get_xdata()) > 2 and line.get_linewidth() != rigid]
        points, lines = drawn[::2], drawn[1::2]
        assert [(line.get_linestyle(), len(line.get_xdata())) for line in points] == [("None", 60)] * 2
        assert [line.get_linewidth() for line in lines] == [MODEL_LINE_WIDTH] * 2
        x, y = (np.asarray(values) for values in lines[0].get_data())
        assert x.min() == pytest.approx(min(f for f in points[0].get_xdata() if f >= 10)), "the band that was fitted"
        expected = PLANT.response(2 * np.pi * x)
        if part == "magnitude":
            np.testing.assert_allclose(y, 20 * np.log10(1e3 * np.abs(expected)), atol=1e-6)
            peak = 1e3 * np.abs(PLANT.response(np.array([2 * np.pi * 38.8]))[0])
            assert y[(x > 30) & (x < 45)].max() == pytest.approx(20 * np.log10(peak), abs=1e-3)
        else:
            turns = (y - np.degrees(np.angle(expected))) / 360
            np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)
            near = np.interp(points[0].get_xdata(), x, y)
            assert np.abs(near - points[0].get_ydata())[-20:].max() < 5, "on the branch of its points"


def test_a_plant_fitted_to_the_magnitude_has_no_phase_to_draw() -> None:
    result = fitted(quantity="magnitude")
    assert result.response is not None
    info = bode_info([("a", result.response)], fitted=[ShownResult("a", result).fitted])
    model = info.curves[0].model
    assert model is not None
    assert np.isfinite(model.magnitude).all()
    assert np.isnan(model.phase).all()
    texts = [text.get_text() for text in draw_bode({"": info}).legends[0].get_texts()]
    assert texts == ["a (fit of the magnitude)", "fitted plant", *MARKS]


@pytest.mark.parametrize(("unit", "texts"), [
    ("m/N", ["rigid body (apparent mass 7.576 kg)", "stiffness 0.05 N/µm"]),
    ("rad/(N m)", ["rigid body (apparent inertia 7.576 kg m²)", "stiffness 50000 N m/rad"]),
])  # fmt: skip
def test_a_spring_below_the_fitted_range_has_its_line(unit: str, texts: list[str]) -> None:
    """The table on the spring of its presliding, with 20 % of loss: k0/s² beside K, so flat up to √(K k0)."""
    frequency = np.geomspace(1, 150, 80)
    s = 2j * np.pi * frequency
    stiff = 1 / (5e4 * (1 + 0.2j) * (frequency < 25) + 1 / PLANT.response(s.imag))
    response: FrequencyResponse = make_response(frequency, stiff, unit=unit)
    result = ModalFit(method=Conventional(), modes=1, min_frequency=30).fit_response(response)
    info = bode_info([("a", response)], fitted=[ShownResult("a", result).fitted])
    model = info.curves[0].model
    assert model is not None
    assert model.spring is not None
    assert 1 / model.spring.magnitude == pytest.approx(5e4, rel=0.03)  # Re(1/P) of the first mode is not that of 1/k0
    assert model.spring.frequency == pytest.approx([1, np.sqrt(5e4 * 0.132) / (2 * np.pi)], rel=0.03)
    assert [text.get_text() for text in draw_bode({"": info}).legends[0].get_texts()][-2:] == texts
    plain: FrequencyResponse = make_response(frequency, PLANT.response(s.imag), unit=unit)
    without = bode_info([("a", plain)], fitted=[ShownResult("a", fitted()).fitted]).curves[0].model
    assert without is not None
    assert without.spring is None, "it moves freely"
