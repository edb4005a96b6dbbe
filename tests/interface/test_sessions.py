"""A session of Python as users have it: scripts without a guard, other folders, laws that fail, Ctrl-C."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import fraexp
from fraexp.api import FrictionModel, param
from fraexp.errors import FraexpError, PluginError
from fraexp.store.store import deferred_interrupt
from tests.examples import thorough
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[2]
RECORD = ROOT / "studies/records/table_stepped_sine.csv"
SCRIPT = """
import fraexp
print("begins")
study = fraexp.Study("pair", machine="linear_motor_table", excitation={"name": "stepped_sine", "points": 4},
                     estimator="conventional", grid={"excitation.amplitude": [12.0, 75.0]})
print(fraexp.Workspace().run(study, executor="processes:2", progress=False).state)
"""


class Uncompiled(FrictionModel, name="uncompiled_in_session", version=1):
    """A law that uses what the compiler does not support."""

    states = ("force [N]",)
    stiffness: float = param("N/m", "stiffness", above=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness):
        z_next[0] = float(str(z[0])) + stiffness * dy
        return z_next[0]


@pytest.mark.thorough
@pytest.mark.parametrize("way", ["file", thorough("standard input")])
def test_workers_do_not_run_a_script_again(tmp_path: Path, way: str) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "script.py"] if way == "file" else [sys.executable, "-"]
    given = SCRIPT if way == "standard input" else ""
    done = subprocess.run(
        command, cwd=tmp_path, input=given, capture_output=True, text=True, timeout=HANG_TIMEOUT_S, check=False
    )
    assert done.stdout.split() == ["begins", "complete"], done.stderr


def test_a_session_stays_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    workspace = fraexp.Workspace()
    (tmp_path / "other").mkdir()
    os.chdir(tmp_path / "other")
    assert workspace.folder == tmp_path
    with refused(FraexpError, tmp_path / "results.db"):
        workspace.runs()


@pytest.mark.thorough
def test_a_law_that_cannot_be_compiled_is_one_of_our_errors(tmp_path: Path) -> None:
    law = fraexp.FrictionLaw(Uncompiled(stiffness=1e6))
    with refused(PluginError, "compiled"):
        law.force(np.linspace(0, 1e-6, 10))
    with refused(PluginError, "compiled"):
        fraexp.Workspace(tmp_path).simulate(
            "linear_motor_table", {"name": "stepped_sine", "points": 2, "amplitude": 12.0}, friction=law
        )


def plan(**keys: object) -> dict[str, object]:
    shown = {"name": "stepped_sine", "amplitude": 12.0, "points": 2}
    machine = {"machine": "linear_motor_table", "excitation": shown, "estimator": "conventional"}
    return fraexp.Workspace().plan(fraexp.Study("planned", **{**machine, **keys}))


def simulate(plant: dict[str, float] | None = None, **excitation: object) -> fraexp.Recording:
    sections = {"plant": plant} if plant else {}
    shown = {"name": "stepped_sine", "amplitude": 12.0, "points": 2, **excitation}
    return fraexp.simulate("linear_motor_table", shown, **sections)


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (Uncompiled, ["Uncompiled", "'stiffness'", "N/m"]),
        (lambda: Uncompiled(stiffness=-1), ["Uncompiled.stiffness", -1, "0 N/m"]),
        (lambda: Uncompiled(stiffnes=1), ["'stiffnes'", "'stiffness'"]),
        (lambda: fraexp.FrictionLaw(Uncompiled(stiffness=1e6)).force([0, 1j]), ["displacement", "complex"]),
        (lambda: fraexp.FrictionLaw(Uncompiled), ["class Uncompiled", "Uncompiled(stiffness"]),
        (lambda: fraexp.friction_law("uncompiled_in_session"), ["class Uncompiled", "Uncompiled(stiffness"]),
        (lambda: fraexp.Study(friction=Uncompiled), ["class Uncompiled", "Uncompiled(stiffness"]),
        (lambda: plan(estimator=["conventional", "h1_h2_hv"]), ["[grid]", "estimator = [...]"]),
        (lambda: simulate(amplitude=[12.0, 30.0]), ["[grid]"]),
        (lambda: fraexp.read_record(RECORD, {"u": "-thrust [N]"}), ["'thrust * -1'"]),
        (lambda: fraexp.read_record(RECORD), ["'fraexp import"]),
        (lambda: fraexp.read_record("a.csv", ["u", "y"]), ["channels", "['u', 'y']"]),
        (lambda: fraexp.read_record(ROOT / "LICENSE", {"u": "a"}), ["LICENSE", "reader"]),
        (lambda: fraexp.run({"machine": "table"}), ["study", "{'machine': 'table'}"]),
        (lambda: fraexp.run(fraexp.Study("own", machine="motor")), ["Study('own')", "'motor'"]),
        (lambda: fraexp.Study(case={"label": "stiff"}), ["case", "{'label': 'stiff'}"]),
        (lambda: fraexp.Study(grid={"loop.noise": iter([1e-9])}), ["list"]),
        (lambda: simulate(amplitude=-1), ["simulate", "[excitation]", "stepped_sine.amplitude", -1]),
        (lambda: simulate(plant={"rigid_body_gain": 1e12}), ["max_stiffness"]),
    ],
)
def test_a_wrong_call_is_one_line(call, names: list[str]) -> None:
    with refused(FraexpError, *names):
        call()


def test_values_of_pandas_and_xarray_make_a_grid() -> None:
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    studies = [
        fraexp.Study(grid={"excitation.amplitude": values})
        for values in (pandas.Series([12.0, 75.0]), xarray.DataArray([12.0, 75.0]), [12.0, 75.0])
    ]
    assert studies[0].data == studies[1].data == studies[2].data


def test_an_error_of_several_lines_is_told_in_one() -> None:
    assert str(FraexpError("first\nsecond")) == "first second"


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt, which a shell's background process ignores."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_waits_for_what_is_written() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), deferred_interrupt():
        signal.raise_signal(signal.SIGINT)
        done.append("written")
    assert done == ["written"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("interruptible")
def test_a_second_interrupt_does_not_wait() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), deferred_interrupt():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        done.append("never")
    assert not done


def test_results_of_two_estimators_are_drawn_together(tmp_path: Path) -> None:
    workspace = fraexp.Workspace(tmp_path)
    recording = workspace.simulate("linear_motor_table", {"name": "stepped_sine", "points": 4, "amplitude": 12.0})
    found = [workspace.estimate(recording, name) for name in ("conventional", "effective_input")]
    (legend,) = [axes.get_legend() for axes in found[0].plot(beside=found[1:]).axes if axes.get_legend()] or [None]
    texts = [text.get_text() for text in (legend or found[0].plot(beside=found[1:]).legends[0]).get_texts()]
    assert any("conventional" in text for text in texts)
    assert any("effective input" in text for text in texts)
