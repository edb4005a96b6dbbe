"""Friction in N m over rad: that of a simulated bench is found, hardly any of a measured one is not identifiable."""

from pathlib import Path

import pytest

import fraexp
from tests.identification.friction_records import values

BENCH = Path(__file__).parents[3] / "shared" / "data" / "two_inertia_bench" / "MultisineTypeA.mat"
STUDY = Path(__file__).parents[2] / "studies" / "identification" / "friction_rotary.toml"

pytestmark = pytest.mark.thorough


def test_rolling_elements_and_a_law_are_found_in_the_units_of_the_axis(tmp_path: Path) -> None:
    results = fraexp.Workspace(tmp_path).run(str(STUDY))
    rolling, gms = (sweep.result for sweep in results)
    for result in (rolling, gms):
        assert result.outcome.name == "OK", result.message
        found = values(result)
        assert found["Coulomb force"] == pytest.approx(0.6, rel=2e-3)
        assert abs(found["viscous coefficient"] - 0.4) < max(found["viscous coefficient, 95 %"], 4e-3)
        assert {metric.unit for metric in result.metrics if metric.name == "Coulomb force"} == {"N m"}
    assert values(rolling)["mass"] == pytest.approx(0.05, rel=0.03)  # kg m²; a tenth of the first mode adds 1 %
    assert values(gms)["stiffness.0"] == pytest.approx(4000, rel=0.01)
    assert values(gms)["static force"] == pytest.approx(0.8, rel=0.05)


@pytest.mark.skipif(not BENCH.exists(), reason="the measured record is not beside this checkout")
@pytest.mark.parametrize("law", ["rolling", "gms"])
def test_of_a_bench_with_hardly_any_friction_no_friction_is_identified(tmp_path: Path, law: str) -> None:
    """Bearings take hundredths of a newton metre there: the model's error is near that."""
    channels = {"u": "iq_adx * 0.07 [N m]", "y": "theta_mx [rad]"}
    record = fraexp.read_record(BENCH, channels, sample_rate=2500, samples_per_period=2500, skip_periods=1)
    spec = {"name": "friction_identification", "laws": [law], "thrust": "u", "displacement": "y"}
    result = fraexp.Workspace(tmp_path).estimate(record, spec)
    (found,) = [each for each in result.findings if each.place == "Coulomb force"]
    assert result.outcome == "inaccurate"
    assert found.kind == "not identifiable" and found.error > 1  # the interval is wider than the force
