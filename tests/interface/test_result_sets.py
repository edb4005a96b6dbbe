"""Results of several sweeps as a sequence: how they are searched, and what they are when all have failed."""

import pytest

import fraexp
from fraexp.interface.result_sets import Results
from tests.interface.conftest import POINTS
from tests.refusals import refused


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda run: run["conventional"], ["'conventional'", "[0]", "one("]),
        (lambda run: run[1.0], ["1.0", "[0]"]),
        (lambda run: run.filter("excitation.amplitude >= 20 N m"), ["'N m'", "'N'"]),
    ],
)
def test_a_wrong_search_is_one_line_with_the_remedy(run: fraexp.Run, call, names: list[str]) -> None:
    with refused(fraexp.FraexpError, *names):
        call(run)


def test_a_quantity_may_be_written_with_blanks(run: fraexp.Run) -> None:
    wanted = [of.key for of in run if of.labels["excitation.amplitude"] >= 20]
    for text in ("excitation.amplitude>=20", "excitation.amplitude >= 20 N", "excitation.amplitude >=20000 mN"):
        assert [of.key for of in run.filter(text)] == wanted
    assert 0 < len(wanted) < len(run)


def test_results_are_true_if_there_is_one(run: fraexp.Run, workspace: fraexp.Workspace) -> None:
    assert run
    assert not run.filter("estimator=conventional -estimator=conventional")
    failed = workspace.run(
        fraexp.Study(
            "failing",
            machine="linear_motor_table",
            excitation={"name": "stepped_sine", "amplitude": 12.0, "points": POINTS},
            estimator={"name": "conventional", "input": "nothing"},
        ),
        executor="serial",
        progress=False,
    )
    assert isinstance(failed, Results)
    assert not failed
    assert len(failed.missing) == 1
