"""The loop of a sweep: its controller, its delays and its response, whatever the response was referred to."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fraexp.components.registry import Registry
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.store import StoredSweep
from fraexp.study.study_file import stated_controller
from fraexp.views.loop_margins_table import loop_margins, loop_rows
from tests.cli.conftest import response_of
from tests.refusals import refused

FREQUENCY = np.geomspace(1, 200, 2000)
MASS, GAIN, RISE, SAMPLE_TIME, DEAD_TIME = 2.0, 2e4, 0.02, 1e-3, 2e-3
LOOP: dict[str, Any] = {"sample_time": SAMPLE_TIME, "input_dead_time": DEAD_TIME}
PID: dict[str, Any] = {"name": "pid", "proportional": GAIN, "derivative_time": RISE, "filter_time": 2e-3}


def of(values: np.ndarray, **changes: Any) -> FrequencyResponse:
    plain = response_of(1.0, points=FREQUENCY.size)
    covariance = np.tile(np.eye(2), (FREQUENCY.size, 1, 1)) * (1e-3 * np.abs(values) ** 2)[:, None, None] * 1e-3
    settled = np.ones(FREQUENCY.size, dtype=bool)
    return replace(plain, frequency=FREQUENCY, response=values, covariance=covariance, settled=settled, **changes)


def sweep(estimator: dict[str, Any], experiment: dict[str, Any]) -> StoredSweep:
    return StoredSweep("fx1-0", experiment, estimator, {}, Outcome.OK, (), 1.0, None, "computed")


def values(sweep: StoredSweep, response: FrequencyResponse, registry: Registry, around: Any = None) -> dict[str, float]:
    return {of.name: of.value for of in loop_margins(sweep, Result(Outcome.OK, response=response), registry, around)}


def test_the_loop_is_the_same_whatever_the_response_was_referred_to(registry: Registry) -> None:
    """A mass behind hold and dead time: its sampled response is z(z + 1)/(z - 1)² in closed form."""
    omega = 2 * np.pi * FREQUENCY
    z = np.exp(1j * omega * SAMPLE_TIME)
    sampled = SAMPLE_TIME**2 / (2 * MASS) * (z + 1) / (z - 1) ** 2 * z ** -(DEAD_TIME / SAMPLE_TIME)
    plant = -1 / (MASS * omega**2) + 0j
    around = {"controller": PID, "loop": LOOP}
    included = values(sweep({"name": "any"}, around), of(sampled), registry)
    referred = values(sweep({"name": "any", "refer_to_plant": True}, around), of(plant), registry)
    effective = values(sweep({"name": "any"}, around), of(plant, input="u_e"), registry)
    fitted = values(sweep({"method": {"name": "any", "refer_to_plant": True}}, around), of(plant), registry)
    measured = values(sweep({"name": "any"}, {"source": "record"}), of(sampled), registry, around)
    assert list(included) == ["crossover", "bandwidth", "phase margin", "gain margin", "modulus margin"]
    for other in (referred, effective, fitted, measured):
        assert other == pytest.approx(included, rel=1e-4)
    s = 2 / SAMPLE_TIME * (z - 1) / (z + 1)  # bilinear
    control = GAIN * (1 + RISE * s / (1 + 2e-3 * s))
    opened = control * sampled
    assert included["modulus margin"] == pytest.approx(np.abs(1 + opened).min(), rel=1e-6)
    assert included["crossover"] == pytest.approx(FREQUENCY[np.abs(opened) > 1].max(), rel=3e-3)


def test_without_a_controller_or_a_position_over_a_thrust_there_is_no_loop(registry: Registry) -> None:
    plant = of(-1 / FREQUENCY**2 + 0j)
    around = {"controller": PID, "loop": LOOP}
    assert values(sweep({}, {"source": "record"}), plant, registry) == {}
    assert values(sweep({}, around), replace(plant, unit="m/V"), registry) == {}
    assert loop_margins(sweep({}, around), Result(Outcome.OK), registry) == []
    missing = {"controller": {"name": "not installed here"}, "loop": LOOP}
    assert values(sweep({}, missing), plant, registry) == {}


def test_rows_are_in_decibels_and_degrees_with_intervals(registry: Registry) -> None:
    response = of(-1 / (MASS * (2 * np.pi * FREQUENCY) ** 2) + 0j, input="u_e")
    figures = loop_margins(
        sweep({}, {"controller": PID, "loop": LOOP}), Result(Outcome.OK, response=response), registry
    )
    rows = {row[0]: row[1:] for row in loop_rows(figures)}
    known = {figure.name: figure for figure in figures}
    assert rows["phase margin"][2] == "deg"
    assert float(rows["phase margin"][0]) == pytest.approx(np.degrees(known["phase margin"].value), rel=1e-3)
    assert rows["gain margin"][2] == "dB"
    assert float(rows["gain margin"][0]) == pytest.approx(20 * np.log10(known["gain margin"].value), rel=1e-3)
    assert all(float(row[1]) > 0 for row in rows.values())


def test_a_machine_or_a_study_states_the_controller_of_a_measured_axis(registry: Registry, tmp_path: Path) -> None:
    table = stated_controller("machines/rotary_table", tmp_path, registry)
    assert table["controller"]["proportional"] == 40.0  # N m/rad
    assert table["loop"]["rotary"] is True
    (tmp_path / "mine.toml").write_text(
        'machine = "rotary_table"\n[controller]\nproportional = "50 N m/rad"\n', encoding="utf-8"
    )
    mine = stated_controller("mine", tmp_path, registry)
    assert mine["controller"] == {**table["controller"], "proportional": 50.0}
    (tmp_path / "lacks.toml").write_text('[loop]\nsample_time = "1 ms"\n', encoding="utf-8")
    with refused(FraexpError, "lacks.toml", "[controller]"):
        stated_controller("lacks", tmp_path, registry)
