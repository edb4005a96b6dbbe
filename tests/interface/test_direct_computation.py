"""Experiments without a database: the same numbers as those of a run, and laws that only this session knows."""

import pickle
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fraexp
from fraexp.api import FrictionModel, param
from fraexp.errors import StoreError
from tests.interface.conftest import POINTS
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S, wait_until

EXCITATION = {"name": "stepped_sine", "points": POINTS, "amplitude": 12.0}


def law_class(factor: float) -> type[FrictionModel]:
    class Scaled(FrictionModel, name="scaled_in_session", version=1):
        """A spring with a slider."""

        states = ("force [N]",)
        stiffness: float = param("N/m", "stiffness", above=0)
        coulomb_force: float = param("N", "Coulomb force", above=0)

        @property
        def scaled_force(self) -> float:
            return factor * self.coulomb_force

        @staticmethod
        def advance(z, dy, dt, z_next, stiffness, scaled_force):
            z_next[0] = min(max(z[0] + stiffness * dy, -scaled_force), scaled_force)
            return z_next[0]

    return Scaled


def test_simulate_and_estimate_give_the_numbers_of_a_run(workspace: fraexp.Workspace, run: fraexp.Run) -> None:
    recording = workspace.simulate("linear_motor_table", EXCITATION)
    for stored in run.filter("excitation.amplitude=12"):
        name = stored.estimator
        found = workspace.estimate(
            recording, {"name": name, **({"refer_to_plant": True} if name == "conventional" else {})}
        )
        assert found.key == stored.key
        np.testing.assert_array_equal(found.response, stored.response)
        np.testing.assert_array_equal(
            found.frequency_response.numerical_error, stored.frequency_response.numerical_error
        )
    assert recording.outcome == "ok"


def test_signals_of_a_stored_result_are_simulated_again(workspace: fraexp.Workspace, run: fraexp.Run) -> None:
    result = run.one("estimator=conventional excitation.amplitude=75")
    recording = workspace.signals(result)
    data = recording.to_xarray()
    assert data.u.attrs["units"] == recording.channels["u"] == "N"
    first = data.where(data.segment == 0, drop=True)
    period = first.where(first.period == first.period.max(), drop=True)
    turns = np.exp(-2j * np.pi * result.frequency[0] * period.time.values)
    gain = (turns @ period.y.values) / (turns @ period.u.values)
    magnitude = abs(run.one("estimator=conventional excitation.amplitude=75").response[0])
    assert abs(gain) == pytest.approx(magnitude, rel=1e-2)  # refer_to_plant takes off the dead time only


@pytest.mark.thorough
def test_a_law_of_this_session_is_simulated_and_its_new_definition_counts(workspace: fraexp.Workspace) -> None:
    peaks = []
    for factor in (1.0, 0.5):
        law = fraexp.FrictionLaw(law_class(factor)(stiffness=1e6, coulomb_force=10.0))
        recording = workspace.simulate("linear_motor_table", {**EXCITATION, "amplitude": 75.0}, friction=law)
        peaks.append(float(abs(recording.to_xarray().friction).max()))
    assert workspace.estimate(recording, "effective_input").outcome == "ok"
    assert peaks == pytest.approx([10.0, 5.0])


def test_a_law_of_this_session_is_not_run_in_other_processes(workspace: fraexp.Workspace) -> None:
    law = law_class(1.0)(stiffness=1e6, coulomb_force=10.0)
    study = fraexp.Study(
        "own", machine="linear_motor_table", friction=law, excitation=EXCITATION, estimator="conventional"
    )
    before = len(workspace.runs())
    with refused(fraexp.FraexpError, "own", workspace.folder / "plugins" / "scaled_in_session.py", "reload()"):
        workspace.run(study)
    assert len(workspace.runs()) == before


def test_a_law_cannot_take_the_name_of_a_plugin(workspace: fraexp.Workspace) -> None:
    class Rolling(FrictionModel, name="rolling", version=1):
        """Not the one that is known."""

        @staticmethod
        def advance(z, dy, dt, z_next):
            return 0.0

    with refused(fraexp.FraexpError, "'rolling'", "fraexp 0.1.0"):
        workspace.simulate("linear_motor_table", EXCITATION, friction=Rolling())


def test_a_model_that_was_identified_is_used(workspace: fraexp.Workspace) -> None:
    recording = workspace.simulate("linear_motor_table", {**EXCITATION, "points": 30, "amplitude": 75.0})
    found = workspace.estimate(recording, "modal_fit", method={"name": "effective_input"}, modes=2)
    assert found.models["plant"]["rigid_body_gain"] == pytest.approx(0.132, rel=1e-2)
    assert found.state_space["a"].shape == (6, 6)
    without = workspace.simulate("linear_motor_table", EXCITATION, plant=found.models["plant"], friction="none")
    response = workspace.estimate(without, "conventional")
    assert abs(response.response[0]) == pytest.approx(0.132 / (2 * np.pi) ** 2, rel=2e-2)


def test_a_measured_record_is_read_and_estimated(tmp_path, workspace: fraexp.Workspace) -> None:
    rng = np.random.default_rng(3)
    angle = 2 * np.pi * np.outer(np.arange(500), np.arange(1, 100)) / 500
    u = np.tile(np.cos(angle + rng.uniform(0, 6, 99)).sum(axis=1), 6)
    y = 0.5 * np.roll(u, 3)
    np.savetxt(tmp_path / "bench.csv", np.column_stack([u, y]), delimiter=",", header="current,angle", comments="")
    channels = {"u": {"column": "current", "unit": "N"}, "y": {"column": "angle", "unit": "m"}}
    recording = workspace.read_record(tmp_path / "bench.csv", channels, sample_rate=1000.0, samples_per_period=500)
    found = workspace.estimate(recording, "conventional")
    expected = 0.5 * np.exp(-2j * np.pi * found.frequency * 3e-3)
    np.testing.assert_allclose(found.response, expected, rtol=1e-9)
    assert "measured" in repr(recording)


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda of: of.simulate("linear_motor_table", {"name": "stepped_sine"}), ["[excitation]", "'amplitude'"]),
        (lambda of: of.simulate({"plant": "modal"}, EXCITATION), ["[plant]", "'rigid_body_gain'"]),
        (lambda of: of.read_record("none.csv", {"u": "u", "y": "y"}), ["none.csv"]),
        (
            lambda of: of.estimate(of.simulate("linear_motor_table", EXCITATION), "conventionl"),
            ["'conventionl'", "'conventional'"],
        ),
        (lambda of: of.open_run("never"), ["'never'"]),
        (lambda of: of.study("quik"), ["'quik'", "'quick'"]),
        (lambda of: of.open_run("quick").one("excitation.amplitude>100"), ["0 results", "'excitation.amplitude>100'"]),
        (lambda of: fraexp.Workspace(of.folder / "missing"), ["missing"]),
    ],
)
def test_a_mistake_is_said_in_one_line(workspace: fraexp.Workspace, call, names: list[str]) -> None:
    with refused(fraexp.FraexpError, *names):
        call(workspace)


def test_stored_sweeps_are_found_by_the_language_of_filters(workspace: fraexp.Workspace, run: fraexp.Run) -> None:
    found = workspace.sweeps("estimator=effective_input excitation.amplitude=75 excitation.points=6")
    assert [of.key for of in found] == [run.one("estimator=effective_input excitation.amplitude=75").key]
    assert workspace.sweep(found[0].key).key == found[0].key


@pytest.mark.thorough
def test_functions_work_in_the_current_folder(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recording = fraexp.simulate("linear_motor_table", EXCITATION)
    assert fraexp.estimate(recording, "conventional").outcome == "ok"
    assert fraexp.friction_law("coulomb", coulomb_force=2.0).name == "coulomb"
    assert list(tmp_path.iterdir()) == []
    assert (
        fraexp.run("quick", {"excitation.points": 4, "grid.excitation.amplitude": [75.0]}, progress=False).state
        == "complete"
    )
    assert (tmp_path / "results.db").exists()


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda of: of.run("quick", ["excitation.points=3"]), ["changes", "table"]),
        (lambda of: of.run("quick", executor=4), ["executor", 4]),
        (lambda of: of.run("quick", time_limit=-1), ["time_limit", -1, 0]),
        (lambda of: of.run("quick", rerun="al"), ["'al'", "'all'"]),
        (lambda of: of.open_run(1.5), ["run 1.5"]),
        (lambda of: of.simulate("linear_motor_table", "chirp", estimator="conventional"), ["estimate()"]),
        (lambda of: of.estimate(np.zeros(3), "conventional"), ["ndarray", "Recording"]),
        (lambda of: of.open_run("quick").plot("bod"), ["'bod'", "'bode'"]),
        (lambda of: of.open_run("quick")[0].plot(frequency_range="5:50"), ["frequency_range", "(4.5, 45)"]),
        (lambda of: fraexp.FrictionLaw("dahl"), ["FrictionLaw", "'dahl'", "friction_law"]),
    ],
)
def test_a_wrong_type_is_named(workspace: fraexp.Workspace, call, names: list[str]) -> None:
    with refused(fraexp.FraexpError, *names):
        call(workspace)


def test_a_result_travels_to_another_process(run: fraexp.Run) -> None:
    copied = pickle.loads(pickle.dumps(run[0]))
    np.testing.assert_array_equal(copied.response, run[0].response)
    assert copied.plot().axes


def test_an_existing_file_is_not_replaced_unasked(run: fraexp.Run, tmp_path) -> None:
    path = run[0].export(tmp_path / "a.csv")
    with refused(fraexp.FraexpError, path, "force=True"):
        run[0].export(path)
    assert run[1].export(path, force=True) == path


@pytest.mark.thorough
def test_an_interrupt_ends_a_run_and_keeps_what_is_finished(tmp_path) -> None:
    # Whatever a shell starts in the background ignores Ctrl-C: the program takes it up again.
    script = """
import signal
import fraexp
signal.signal(signal.SIGINT, signal.default_int_handler)
study = fraexp.Study("long", machine="linear_motor_table", excitation={"name": "stepped_sine", "points": 60},
                     estimator="conventional", grid={"excitation.amplitude": list(range(5, 400))})
try:
    fraexp.run(study, executor="serial")
except KeyboardInterrupt as interrupt:
    print(str(interrupt).startswith("run 1 is stopped;"))
run = fraexp.Workspace().open_run("long")
print(run.state, len(run) > 0, len(run) < 395)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", script], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    wait_until(lambda: has_computed(tmp_path))
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=HANG_TIMEOUT_S)[0].split() == ["True", "interrupted", "True", "True"]


def has_computed(folder: Path) -> bool:
    try:
        return any(run.summary.computed for run in fraexp.Workspace(folder).runs())
    except StoreError:  # there is no database yet
        return False
