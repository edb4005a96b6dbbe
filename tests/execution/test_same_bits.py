"""A result does not depend on who computes it, on how many there are, nor on what was computed before."""

import pickle
import random
from dataclasses import replace
from pathlib import Path

import pytest

from fraexp.data import fit_references
from fraexp.data.results import Result
from fraexp.execution.executors import create_workers
from fraexp.execution.sent_jobs import Job
from fraexp.workspace.workspace_service import WorkspaceService
from tests.waiting import HANG_TIMEOUT_S

STUDIES = [
    "contacts/two_mass",
    "friction/drift",
    "friction/hysteresis",
    "identification/friction_viscous",
    "identification/plant_fit",
    "methods/best_linear",
    "methods/chirp",
    "methods/fast_best_linear",
    "methods/feedback_compensated",
    "methods/higher_order",
    "methods/joint_input_output",
    "methods/local_polynomial",
    "methods/maximum_likelihood",
    "methods/moving_axis",
    "methods/self_diagnosis",
    "methods/spectral",
    "positioning/profiles",
    "quick",
]
"""In which each estimator has a sweep of a few seconds at most."""
LONG = {"plant_and_friction"}
"""Identification that takes ten seconds and more; it computes as maximum_likelihood does, which is here."""
UNUSED = {"local_rational", "injection_on_motion", "loop_tuning", "excitation_design"}
"""Estimators that are in none of these studies."""


def jobs_of_each_estimator(folder: Path) -> dict[str, Job]:
    workspace = WorkspaceService.open(folder)
    jobs: dict[str, Job] = {}
    for study in workspace.studies(STUDIES):
        for sweep in study.sweeps:
            name = sweep.estimator["name"]
            if name not in jobs and not list(fit_references.references_in([sweep.experiment, sweep.estimator])):
                jobs[name] = Job(sweep.experiment, (sweep.estimator,), sweep.files)
    assert set(jobs) >= set(workspace.registry.names("estimator")) - LONG - UNUSED
    return {name: job for name, job in jobs.items() if name not in LONG}


def bits(result: object) -> bytes:
    """Return everything that a result says, to the last bit; not how long it took."""
    assert isinstance(result, Result), result
    return pickle.dumps(pickle.loads(pickle.dumps(replace(result, elapsed=0.0))))


def test_results_are_the_same_to_the_last_bit(tmp_path: Path) -> None:
    jobs = jobs_of_each_estimator(tmp_path)
    found: dict[str, dict[str, bytes]] = {}
    for executor, seed in (("serial", 0), ("processes:3", 2)):
        order = sorted(jobs)
        random.Random(seed).shuffle(order)
        with create_workers(executor, len(jobs)) as workers:
            futures = {name: workers.submit(number, jobs[name]) for number, name in enumerate(order)}
            answers = {name: bits(future.result(timeout=HANG_TIMEOUT_S)[0]) for name, future in futures.items()}
        for name, answer in answers.items():
            found.setdefault(name, {})[f"{executor}, {seed}"] = answer
    differing = {name: list(of) for name, of in found.items() if len(set(of.values())) > 1}
    assert not differing


pytestmark = pytest.mark.thorough
