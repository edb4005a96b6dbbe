"""Workers whose jobs take simulated time; some of them are lost."""

import random
from collections.abc import Callable
from concurrent.futures import Future

from fraexp.data.results import Metric, Outcome, Result
from fraexp.execution.executors import Answer, WorkerLostError, Workers
from fraexp.execution.sent_jobs import Job

LOSS_RATE = 0.03
"""Share of the jobs whose worker is lost: too few for three times the same job."""


class SimulatedWorkers(Workers):
    """Two workers that compute the number of an experiment."""

    count = 2

    def __init__(self, draw: random.Random, now: Callable[[], float]) -> None:
        super().__init__()
        self._random, self._now = draw, now
        self._jobs: list[tuple[float, Job, Future[Answer]]] = []

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        future: Future[Answer] = Future()
        self._jobs.append((self._now() + self._random.uniform(0.05, 10), job, future))
        return future

    def next_answer_after(self, seconds: float) -> float:
        """Return the time to the next answer [s], at least `seconds`; infinite if nothing is computed."""
        return max(seconds, min((end - self._now() for end, _, _ in self._jobs), default=float("inf")))

    def deliver(self) -> None:
        """Answer the jobs whose time has passed."""
        due = [job for job in self._jobs if job[0] <= self._now()]
        self._jobs = [job for job in self._jobs if job[0] > self._now()]
        for _, job, future in sorted(due, key=lambda of: of[0]):
            if self._random.random() < LOSS_RATE:
                future.set_exception(WorkerLostError("its worker was lost"))
            else:
                metric = Metric("number", float(job.experiment["n"]), "1")
                future.set_result([Result(Outcome.OK, metrics=(metric,))])

    def stop(self) -> None:
        """Do nothing."""

    close = stop
