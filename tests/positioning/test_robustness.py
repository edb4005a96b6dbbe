"""Machines drawn at random, from the study to the figure: the worst one is found again."""

import numpy as np
import pytest

from fraexp.cli.summary import print_summary
from fraexp.store import Store
from fraexp.workspace.workspace_service import WorkspaceService

RIGHT, COUNT = "nominal P_d", 8


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robustness")
    found = WorkspaceService.open(folder)
    *_, ended = found.run(["positioning/robustness"], executor="serial", overrides=[f"monte_carlo.count={COUNT}"])
    assert ended.state == "complete"
    assert [path.name for path in ended.figures] == [f"robustness_monte_carlo.count={COUNT}.png"]
    return found


@pytest.fixture(scope="module")
def stored(workspace):
    with Store.open(workspace.database, read_only=True) as store:
        sweeps = store.sweeps(1)
        return sweeps, store.results(sweep.key for sweep in sweeps)


def column(stored, case, name):
    sweeps, results = stored
    chosen = [sweep for sweep in sweeps if sweep.labels["case"] == case]
    values = [next(of.value for of in results[sweep.key].metrics if of.name == name) for sweep in chosen]
    return chosen, np.array(values)


@pytest.mark.thorough
def test_a_wrong_model_costs_more_than_the_tolerances(stored):
    (wrong,) = {sweep.labels["case"] for sweep in stored[0]} - {RIGHT}
    (_, nominal), (_, error) = (column(stored, case, "overshoot") for case in (RIGHT, wrong))
    assert nominal.size == error.size == COUNT
    assert (error > nominal).all(), "on each machine"
    assert np.isnan(column(stored, wrong, "settling time")[1]).all()
    assert np.isfinite(column(stored, RIGHT, "settling time")[1]).any()


@pytest.mark.thorough
def test_the_worst_draw_is_found_again_by_its_number_and_its_parameters(workspace, stored):
    sweeps, overshoot = column(stored, RIGHT, "overshoot")
    worst = sweeps[int(np.argmax(overshoot))]
    (study,) = workspace.studies(["positioning/robustness"], [f"monte_carlo.count={COUNT + 2}"])
    again = next(of for of in study.sweeps if of.labels == worst.labels)
    assert again.key == worst.key, "though more are drawn"
    drawn = {path: value for path, value in worst.labels.items() if "." in path}
    overrides = [
        "monte_carlo.count=1",
        *(f"{path}={value!r}" for path, value in drawn.items() if path[-1] not in "012"),
    ]
    (alone,) = workspace.studies(["positioning/robustness"], overrides)
    # what is set moves the nominal machine, around which is drawn
    ratio = alone.sweeps[0].labels["plant.rigid_body_gain"] / study.sweeps[0].labels["plant.rigid_body_gain"]
    assert ratio == pytest.approx(drawn["plant.rigid_body_gain"] / 0.132, rel=1e-12)


@pytest.mark.thorough
def test_the_summary_counts_draws_and_does_not_measure_them(workspace, stored, capsys):
    print_summary(*stored, workspace.registry)
    assert f"{COUNT} values" in capsys.readouterr().out.partition("over the sweeps")[0]


def test_the_motions_are_drawn_as_bundles(workspace, stored, tmp_path):
    with Store.open(workspace.database, read_only=True) as store:
        drawn = workspace.figures.draw(store, stored[0], tmp_path / "motions.png", "Motions", "positioning")
    assert drawn == {tmp_path / "motions.png": True}
