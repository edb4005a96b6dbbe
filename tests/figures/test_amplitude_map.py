import numpy as np
import pytest

from fraexp.data.results import Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.kinds.amplitude_map import amplitude_map_info, draw_amplitude_map
from tests.figures.curves import make_response
from tests.refusals import refused

FREQUENCY = np.geomspace(1, 100, 30)
PLANT = -0.1 / FREQUENCY**2


def shown(amplitude: float, series: str = "", **options) -> ShownResult:
    """A response that is off by the amplitude [dB] and by as many degrees."""
    factor = 10 ** (amplitude / 20) * np.exp(1j * np.radians(amplitude))
    frequency = options.pop("frequency", FREQUENCY)
    plant = -0.1 / frequency**2
    result = Result(Outcome.OK, response=make_response(frequency, plant * factor, **options))
    truth = None if series == "unknown" else plant
    return ShownResult(f"{amplitude} N", result, truth=truth, amplitude=amplitude, amplitude_unit="N", series=series)


def test_rows_are_amplitudes_and_values_are_relative_to_the_plant() -> None:
    info = amplitude_map_info([shown(amplitude) for amplitude in (12.0, 3.0, 75.0)])
    (found,) = info.maps
    assert info.is_relative
    np.testing.assert_array_equal(found.amplitude, [3, 12, 75])
    np.testing.assert_allclose(found.magnitude, np.repeat([[3.0], [12.0], [75.0]], 30, axis=1))
    np.testing.assert_allclose(found.phase, found.magnitude)


def test_without_the_plant_values_are_absolute() -> None:
    info = amplitude_map_info([shown(amplitude, "unknown") for amplitude in (1.0, 2.0)])
    assert (info.is_relative, info.unit) == (False, "mm/N")
    np.testing.assert_allclose(info.maps[0].magnitude[0], 20 * np.log10(-1e3 * PLANT) + 1)
    labels = [axes.get_ylabel() for axes in draw_amplitude_map(info).axes]
    assert labels == ["Excitation amplitude [N]"] * 2 + ["Magnitude [dB re 1 mm/N]", "Phase [deg]"]


def test_other_frequencies_are_interpolated_and_nothing_is_guessed_beyond() -> None:
    narrow = np.geomspace(3, 30, 17)
    (found,) = amplitude_map_info([shown(1.0), shown(2.0, frequency=narrow)]).maps
    inside = (FREQUENCY >= 3) & (FREQUENCY <= 30)
    np.testing.assert_allclose(found.magnitude[1, inside], 2)
    assert np.isnan(found.magnitude[1, ~inside]).all()
    np.testing.assert_array_equal(found.settled[1], inside)


def test_what_has_not_settled_is_hatched_and_has_no_colour() -> None:
    settled = FREQUENCY > 2
    info = amplitude_map_info([shown(1.0, settled=settled), shown(5.0)])
    figure = draw_amplitude_map(info)
    upper = figure.axes[0]
    mesh = upper.collections[0]
    assert np.ma.getmaskarray(mesh.get_array()).sum() == (~settled).sum()
    hatched = [collection for collection in upper.collections if collection.get_hatch()]
    assert len(hatched[0].get_paths()) == (~settled).sum()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["not settled"]


def test_each_series_has_a_map_and_all_share_their_colours() -> None:
    curves = [shown(amplitude, name) for name in ("conventional", "proposed") for amplitude in (3.0, 30.0)]
    figure = draw_amplitude_map(amplitude_map_info(curves, "Both"))
    assert [axes.get_title() for axes in figure.axes[:2]] == ["conventional", "proposed"]
    assert figure.get_suptitle() == "Both"
    assert len(figure.axes) == 4 + 2


@pytest.mark.parametrize(
    ("count", "series", "names"),
    [
        (1, 1, ('"excitation.amplitude"', "[grid]")),
        (0, 1, ('"excitation.amplitude"', "[grid]")),
        (2, 5, ("5 series", "4 maps")),
    ],
)
def test_what_makes_no_map_is_refused(count: int, series: int, names: tuple[str, ...]) -> None:
    curves = [shown(1.0 + row, str(name)) for name in range(series) for row in range(count)]
    with refused(FraexpError, "amplitude map", *names):
        amplitude_map_info(curves)


def test_a_narrow_axis_has_ticks() -> None:
    scales = [0.9, 1.0, 1.1]
    figure = draw_amplitude_map(amplitude_map_info([shown(of, "unknown") for of in scales]))
    axes = figure.axes[0]
    inside = [of for of in axes.get_yticks() if axes.get_ylim()[0] < of < axes.get_ylim()[1]]
    assert len(inside) >= 3
