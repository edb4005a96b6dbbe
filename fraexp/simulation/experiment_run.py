"""Experiments on loops, run side by side, from machines and periods to segments; and a machine that is run live."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import FrictionModel
from fraexp.components.law_step import Law, call_fault, hang_fault, law_place
from fraexp.components.periods import Period, Schedule
from fraexp.components.registry import discover
from fraexp.data.signals import Segment
from fraexp.data.sweep import Plain
from fraexp.errors import PluginError
from fraexp.kernels.call_watch import CallBudget, call_explainer
from fraexp.kernels.law_error import LawCall, LawCallError
from fraexp.simulation.experiments import DeliveredRecord, Experiment, ExperimentPlan, Setup
from fraexp.simulation.loop_setup import prepare_setup
from fraexp.simulation.machine import Numerics, build_machine

if TYPE_CHECKING:
    from fraexp.kernels.batch_arrays import KernelBatch

STEPS_PER_CALL = 1_000_000
"""Steps after which compiled code returns: a long experiment then reports progress, and can be interrupted."""
MAX_POOL_SIZE = 1 << 24
"""Numbers of results that share one array, unless a single experiment has more."""
UNFINISHED_SHARE = 0.9
"""Greatest share of an experiment that counts as done while it is running."""
Progress = Callable[[float], None]
"""Takes the fraction that is done."""


def run_experiments(experiments: Sequence[Experiment], progress: Progress) -> list[Segment | None]:
    """Return what each experiment recorded, in their order; None where the loop diverged."""
    from fraexp.kernels.batch import ALL_DONE, POOL_FULL, advance  # numba: imported only where a loop is run
    from fraexp.simulation.batch_preparation import prepare_batch

    plans = [ExperimentPlan.from_experiment(experiment) for experiment in experiments]
    order = sorted(range(len(plans)), key=lambda k: -plans[k].expected_samples)  # the longest first: lanes end together
    plans = [plans[k] for k in order]
    setup = experiments[0].setup
    batch, laws = prepare_batch(plans, setup), setup.laws
    budget = CallBudget(STEPS_PER_CALL // setup.steps, laws.law, laws.first_steps // setup.steps)
    results = batch.arrays.results
    expected = np.array([plan.expected_samples for plan in plans])
    weights = expected / expected.sum()
    pools: list[NDArray[np.float64]] = []
    pool_of = np.full(len(plans), -1)
    status = POOL_FULL
    while status != ALL_DONE:
        if status == POOL_FULL:
            pools.append(np.empty(_pool_size(plans, batch, is_first=not pools)))
            batch.arrays.queue["pool_used"] = 0
        try:
            with call_explainer(partial(_hang_fault, setup)), budget.measure() as samples:
                status = advance(laws, batch, pools[-1], samples)
        except LawCallError as error:
            raise PluginError(_law_fault(setup, error)) from error
        pool_of[(results["pool_index"] >= 0) & (pool_of < 0)] = len(pools) - 1
        progress(_fraction_done(weights, plans, batch))
    _require_finite([experiments[k] for k in order], results)
    segments: list[Segment | None] = [None] * len(plans)
    for number, plan, record, pool in zip(order, plans, _delivered_records(results), pool_of.tolist(), strict=True):
        if record.pool_index >= 0:
            segments[number] = plan.read_segment(record, pools[pool])
    return segments


def _delivered_records(results: NDArray[np.void]) -> list[DeliveredRecord]:
    """Return what the kernel says of each experiment; one without a record has a pool index below 0."""
    from fraexp.kernels.batch_arrays import SETTLED

    names = ("pool_index", "lead_in", "settling", "residual")
    columns = [(results["status"] == SETTLED).tolist(), *(results[name].tolist() for name in names)]
    return [DeliveredRecord(*row) for row in zip(*columns, strict=True)]


def _law_fault(setup: Setup, error: LawCallError) -> str:
    """Return in one line what is wrong with a law that failed in compiled code."""
    model = _model_of(setup, error.law)
    return call_fault(model.name, error.law, model.law_arguments(), error)


def _hang_fault(setup: Setup, law: Law, call: LawCall | None, seconds: float) -> str:
    """Return in one line where a law hangs in compiled code."""
    model = _model_of(setup, law)
    return hang_fault(model.name, law, model.law_arguments(), call, seconds)


def _model_of(setup: Setup, law: Law) -> FrictionModel:
    """Return the model of a law: that of the friction, or that of its compensation.

    Of several contacts it is one that does not come with fraexp, if there is one.
    """
    compensation = setup.compensation
    is_compensation = compensation is not None and law is setup.laws.compensation_law
    if compensation is not None and is_compensation:
        return compensation.friction
    from fraexp.kernels.law import is_built_in  # numba, which only a loop that is run needs

    models = list(setup.frictions.values())
    return next((model for model in models if not is_built_in(model.law)), models[0])


def _require_finite(experiments: Sequence[Experiment], results: NDArray[np.void]) -> None:
    """Raise PluginError if a position is no number: that is not divergence, but a law whose force is none.

    Experiments side by side are told apart by running one alone, where the call that gives it is on record.
    """
    from fraexp.kernels.batch_arrays import NOT_FINITE

    wrong = np.flatnonzero(results["status"] == NOT_FINITE)
    if not wrong.size:
        return
    experiment = experiments[wrong[0]]
    if experiment.setup.is_vectorised:
        alone = replace(experiment, setup=replace(experiment.setup, is_vectorised=False))
        run_experiments([alone], lambda _: None)
    friction = _model_of(experiment.setup, experiment.setup.laws.law)
    raise PluginError(
        f"the law of {friction.name} ({law_place(friction.law)}) gives a force that is not a finite number, in the loop"
    )


def _pool_size(plans: list[ExperimentPlan], batch: "KernelBatch", is_first: bool) -> int:
    """Return the numbers that the next results need: a guess, which may be too small for one result at first only."""
    largest_result = batch.arrays.history.shape[1] + batch.arrays.recorded[0].size
    guess = sum(plan.expected_samples + batch.arrays.recorded.shape[1] * plan.record for plan in plans)
    guess = min(guess, MAX_POOL_SIZE)
    return guess if is_first and len(plans) > 1 else max(largest_result, guess)


def _fraction_done(weights: NDArray[np.float64], plans: list[ExperimentPlan], batch: "KernelBatch") -> float:
    """Return the fraction of all experiments that is certainly done."""
    from fraexp.kernels.batch_arrays import DIVERGED, IDLE

    is_done = (batch.arrays.results["pool_index"] >= 0) | (batch.arrays.results["status"] == DIVERGED)
    done = float(np.sum(weights[is_done]))
    busy = batch.arrays.lanes[batch.arrays.lanes["stage"] != IDLE]
    for job, elapsed in zip(busy["job"].tolist(), busy["elapsed"].tolist(), strict=True):
        done += weights[job] * min(elapsed / max(plans[job].max_samples, 1), UNFINISHED_SHARE)
    return min(done, 1.0)


CHUNK_SAMPLES = 1024
"""Maximum number of samples that are computed at once."""


class LiveLoop:
    """The loop of a machine from rest; the same samples as an experiment of a run, with the same noise."""

    def __init__(self, setup: Setup, number: int = 0) -> None:
        """Put the machine at rest; its noise is that of experiment `number` of a run."""
        from fraexp.kernels.batch import advance  # numba: imported only where a loop is run
        from fraexp.simulation.batch_preparation import prepare_batch

        period = Period(np.zeros(CHUNK_SAMPLES), np.array([1]))
        experiment = Experiment(setup, period, Schedule(settling_timeout=0.0), number)
        # The record is one sample longer than a chunk: it never ends, and the kernel begins no other experiment.
        self._record = CHUNK_SAMPLES + 1
        plan = ExperimentPlan(experiment, 0, 0, 0, 1, self._record, 1.0, 0.0)
        self._setup, self._batch, self._advance = setup, prepare_batch([plan], setup), advance
        self._pool = np.empty(0)
        self._run(0)

    @property
    def has_diverged(self) -> bool:
        """Whether the displacement has left the divergence limit, or is no number."""
        from fraexp.kernels.batch_arrays import DIVERGED, NOT_FINITE

        return int(self._batch.arrays.results["status"][0]) in (DIVERGED, NOT_FINITE)

    def play(self, excitation: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return what each channel records while the excitation [N], shape (n,), is added to the control input.

        After divergence there is nothing more to record, and the channels are NaN.
        """
        parts = [self._chunk(excitation[k : k + CHUNK_SAMPLES]) for k in range(0, excitation.size, CHUNK_SAMPLES)]
        channels = {
            name: np.concatenate([np.empty(0), *(part[row] for part in parts)])
            for row, name in enumerate(self._setup.channels)
        }
        return {**channels, "excitation": excitation.copy()}

    def _chunk(self, excitation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the samples of all channels, shape (channels, n)."""
        from fraexp.kernels.batch_arrays import FILL_COUNT
        from fraexp.kernels.block import TRACE_SAMPLES

        arrays, size = self._batch.arrays, excitation.size
        if not self.has_diverged:
            arrays.waveforms[:size] = excitation
            arrays.lanes[0]["remaining"], arrays.lanes[0]["phase"] = self._record, 0
            arrays.cursors[FILL_COUNT, 0] = 0
            self._run(size)
        if self.has_diverged:
            return np.full((len(self._setup.channels), size), np.nan)
        others = arrays.recorded[0, :, TRACE_SAMPLES : TRACE_SAMPLES + size]
        return np.vstack([arrays.history[0, :size], others])

    def _run(self, samples: int) -> None:
        self._advance(self._setup.laws, self._batch, self._pool, samples)


def live_setup(sections: Plain, folder: Path) -> Setup:
    """Return the machine of a study's sections made ready; `folder` is the workspace, whose friction laws it may have.

    The sections are plant, friction, controller and loop; numerics and compensation may be missing.
    """
    registry = discover(folder / "plugins")
    return prepare_setup(build_machine({"numerics": Numerics().plain(), **sections}, registry))
