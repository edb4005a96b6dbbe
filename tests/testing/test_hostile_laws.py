"""Friction laws that do harm late or rarely: one line names the law and what it did, and nothing is stored as ok.

`benchmarks/hostile_laws.py` gives all of them to `fraexp check` and `fraexp run`; here they are driven in this process.
"""

import sys
import threading
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from fraexp.components.first_trial import check_passivity, first_trial
from fraexp.components.kinds import FrictionModel, Motion
from fraexp.components.registry import create, discover
from fraexp.errors import PluginError
from fraexp.kernels.call_watch import MAX_SLOW_CALLS, CallBudget
from fraexp.kernels.law_error import LawCallError, LawError
from tests.examples import some, thorough
from tests.refusals import refused
from tests.testing.harmful_laws import LAWS, Law

MANY_REVERSALS = 3e-5 * np.sin(2 * np.pi * np.arange(40_000) / 40)


def hostile(name: str, folder: Path) -> FrictionModel:
    (folder / f"{name}.py").write_text(LAWS[name].source(name), encoding="utf-8")
    return create(discover(folder), FrictionModel, {"name": name})


@pytest.mark.parametrize(
    ("name", "said"),
    [
        thorough("writes_far_beyond_late", "wrote z_next[100000000] of 3 on dy = "),
        thorough("reads_parameter_beyond", "read weights[61] of 2 on dy = "),
        thorough("nan_late", "gives a force of nan N on dy = "),
        ("raises_late", "ValueError: boom"),
    ],
)
def test_what_goes_wrong_late_in_compiled_code_is_told_with_its_line(name: str, said: str, tmp_path: Path) -> None:
    model = hostile(name, tmp_path)
    with pytest.raises(PluginError) as caught:
        model.forces([Motion(MANY_REVERSALS, 1e-3)])
    assert str(caught.value).startswith(f"the law of {name} ({name}.py, line ")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    "name", some(["writes_state_late", "writes_parameter_late", "keeps_array_late"], "keeps_array_late")
)
def test_the_compiler_refuses_a_write_to_what_a_law_may_only_read(name: str, tmp_path: Path) -> None:
    with refused((LawError, PluginError), f"{name}.py", "line", "z_next"):
        hostile(name, tmp_path).forces([Motion(MANY_REVERSALS, 1e-3)])


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("random", "uses random: random numbers"),
        ("clock", "uses time: the clock"),
        ("exits_at_once", "uses os: the operating system"),
        ("counts", "from the same state"),
        ("keeps_list", "from the same state"),
        ("million_states", "a state_size of 1000000; expected a whole number from 0 to 10000"),
        ("size_is_text", "a state_size of three"),
        ("returns_none", "a force of None"),
        ("leaves_unwritten", "z_next[3] = nan"),
        ("reads_older_state", "if z_next contains 1e+30 before"),
        ("unwritten_memory", "uses empty: memory that nothing has been written to"),
        ("reads_an_address", "uses ctypes: memory by its address"),
        ("prints_late", "uses print: the terminal"),
        ("huge_tuple", "uses BIG, a tuple of 20000 elements; expected 100 or fewer"),
        ("huge_array", "uses BIG, an array of 153 MiB; expected 16 MiB or less"),
    ],
)
def test_the_trial_refuses_a_law_that_is_no_function_of_its_arguments(name: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(PluginError) as caught:
        hostile(name, tmp_path).check_law()
    assert said in str(caught.value)
    assert f"{name}.py, line " in str(caught.value)


def test_the_compiler_refuses_a_variable_that_a_branch_leaves_unassigned(tmp_path: Path) -> None:
    with refused((LawError, PluginError), "unassigned_rarely.py", "line", "'extra'"):
        hostile("unassigned_rarely", tmp_path).forces([Motion(MANY_REVERSALS, 1e-3)])


def test_a_state_that_is_left_unwritten_late_is_no_older_one(tmp_path: Path) -> None:
    with refused(PluginError, "z_next[3]", "nan"):
        hostile("leaves_unwritten_late", tmp_path).forces([Motion(MANY_REVERSALS, 1e-3)])


def test_a_law_that_takes_seconds_for_each_sample_is_given_up() -> None:
    budget = CallBudget(1, LAWS["slow"].source)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fraexp.kernels.call_watch.TARGET_CALL_S", -1.0)  # each call takes longer
        for _ in range(MAX_SLOW_CALLS):
            with budget.measure():
                pass
        with pytest.raises(LawCallError), budget.measure():
            pass


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("stiffness_too_low", "a slope of 4e+05 N/m at rest, and a max_stiffness of 1 N/m"),
        thorough("stiffness_is_text", "has a max_stiffness of 'stiff'; expected a finite number"),
        thorough("stiffness_changes", "has another max_stiffness each time"),
    ],
)
def test_the_first_trial_refuses_a_wrong_property(name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / f"{name}.py").write_text(LAWS[name].source(name), encoding="utf-8")
    with pytest.raises(PluginError) as caught:
        first_trial({"name": name}, discover(tmp_path))
    assert f"({name}.py, line " in str(caught.value)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("argument_changes", "'limit' is a parameter and a property"),
        ("states_as_text", "states is 'force [N]'; expected a tuple of names"),
        ("forks_when_loaded", "it makes fraexp go on twice by os.fork(); expected definitions only"),
        ("stops_when_loaded", "it sends a signal by os.kill("),
        ("changes_folder", "it changes the folder of fraexp by os.chdir('/')"),
        ("sets_an_alarm", "it sends a signal by signal.alarm(1)"),
        ("hangs_at_exit", "it makes fraexp do more at its end by atexit.register("),
    ],
)
def test_a_file_that_harms_the_process_is_refused_with_its_line(name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / f"{name}.py").write_text(LAWS[name].source(name), encoding="utf-8")
    (failure,) = discover(tmp_path).failures
    assert said in failure.reason
    assert f"({name}.py, line " in failure.reason


def test_a_file_that_replaces_what_all_use_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    before = time.monotonic
    (tmp_path / "clock.py").write_text(LAWS["stops_the_clock"].source("clock"), encoding="utf-8")
    (failure,) = discover(tmp_path).failures
    assert "it replaces time.monotonic for all of fraexp; expected definitions only" in failure.reason
    assert time.monotonic is before


def test_what_a_file_sets_for_the_process_is_restored(tmp_path: Path) -> None:
    before = np.geterr(), warnings.filters[:], sys.getrecursionlimit()
    module = "import threading, warnings\nnp.seterr(all='raise')\nwarnings.simplefilter('error')\n"
    module += "sys.setrecursionlimit(200)\nthreading.Thread(target=time.sleep, args=(3,), name='left behind').start()\n"
    (tmp_path / "sets.py").write_text(Law(module=module).source("sets"), encoding="utf-8")
    assert ("friction", "sets") in discover(tmp_path).providers
    assert (np.geterr(), warnings.filters[:], sys.getrecursionlimit()) == before
    assert [thread.daemon for thread in threading.enumerate() if thread.name == "left behind"] == [True]


@pytest.mark.parametrize("name", ["drives", "negative_damper", "negative_viscous"])
def test_a_law_that_gives_energy_is_refused(name: str, tmp_path: Path) -> None:
    model = hostile(name, tmp_path)
    with refused(PluginError, name, "'energy'"):
        check_passivity(name, model.law, model.law_arguments(), model.state_size, model.viscous)
