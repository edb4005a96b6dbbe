"""What tables of sweeps show: computed points, told apart by their labels."""

from dataclasses import replace

import numpy as np
import pytest

from fraexp.components.registry import Registry
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.store import StoredSweep
from fraexp.views.text_tables import response_table, sweep_table
from tests.cli.conftest import response_of


def table(responses: list[FrequencyResponse], registry: Registry) -> tuple[list[str], list[list[str]], str]:
    sweeps = [
        StoredSweep(f"fx1-{index}", {}, {}, {}, Outcome.OK, (), 1.0, None, "computed")
        for index in range(len(responses))
    ]
    results = {f"fx1-{index}": Result(Outcome.OK, response=response) for index, response in enumerate(responses)}
    return sweep_table(sweeps, dict(reversed(results.items())), registry)


def at(frequency: list[float]) -> FrequencyResponse:
    grid = np.array(frequency)
    return replace(response_of(0.1, points=len(grid)), frequency=grid, response=-0.1 / grid**2 + 0j, settled=grid > 0)


def test_columns_are_points_of_the_first_response(registry: Registry) -> None:
    titles, rows, head = table([at([1, 9.7, 39.1, 81.3, 200]), at([1.004, 9.8, 39.1, 120])], registry)
    assert titles == ["sweep", "outcome", "settled", "1 Hz", "9.7 Hz", "39.1 Hz", "81.3 Hz"]
    assert rows[0][3:7] == ["40.00", "0.53", "-23.69", "-36.40"]
    assert rows[1][3:7] == ["39.93", "", "-23.69", ""], "no number where there is no point within 0.5 %"
    assert head == "magnitudes in dB re 1 mm/N"


def test_a_resonance_between_two_points_is_not_guessed(registry: Registry) -> None:
    titles, rows, _ = table([at([1, 10, 40, 80]), at([1, 10, 30, 50, 80])], registry)
    assert rows[1][titles.index("40 Hz")] == ""


def test_points_that_say_nothing_are_empty(registry: Registry) -> None:
    first = at([1, 10, 40, 80])
    broken = replace(first, response=np.array([1, np.nan, 0, 1]) + 0j, settled=np.array([False, True, True, True]))
    assert table([first, broken], registry)[1][1][2:7] == ["3/4", "", "", "", "60.00"]


@pytest.mark.parametrize(
    ("grid", "titles"),
    [
        ([300, 500, 800, 1000, 2000], ["300 Hz", "500 Hz", "1e+03 Hz", "2e+03 Hz"]),
        ([100.01, 100.02, 100.03, 100.04], ["100.01 Hz", "100.02 Hz", "100.03 Hz", "100.04 Hz"]),
        ([7], ["7 Hz"]),
        ([2, 20], ["2 Hz", "20 Hz"]),
    ],
)
def test_elsewhere_the_columns_are_spread_and_told_apart(
    grid: list[float], titles: list[str], registry: Registry
) -> None:
    assert table([at(grid)], registry)[0][3:] == titles


def test_what_an_estimator_knows_of_noise_and_distortion_is_shown() -> None:
    response = replace(
        at([1, 10]),
        covariance=np.stack([np.eye(2) * 1e-10, np.eye(2) * 1e-2]),
        noise_variance=np.array([1e-6, 0.0]),
        nonlinear_variance=np.array([1e-4, np.nan]),
        coherence=np.array([0.99994, 0.5]),
    )
    titles, rows, _ = response_table(response, None)
    first, second = (dict(zip(titles, row, strict=True)) for row in rows)
    assert (first["noise [dB]"], first["nonlinear [dB]"], first["coherence"]) == ("-40.0", "-20.0", "0.9999")
    assert (second["noise [dB]"], second["nonlinear [dB]"], second["coherence"]) == ("", "", "0.5000")
    assert second["± 95 % [dB]"] == "∞", "the deviation exceeds the magnitude: it has no lower limit in dB"
    plain = dict(zip(titles, response_table(at([1.0]), None)[1][0], strict=True))
    assert (plain["noise [dB]"], plain["coherence"]) == ("", "")


def test_a_response_without_points_is_no_error(registry: Registry) -> None:
    assert table([at([]), at([1, 10, 40])], registry)[1][0][2] == ""
