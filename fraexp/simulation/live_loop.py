"""A machine that is simulated as it is excited: samples go in and come out chunk by chunk, and its state goes on."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.components.periods import Period, Schedule
from fraexp.components.registry import discover
from fraexp.data.sweep import Plain
from fraexp.simulation.experiments import Experiment, ExperimentPlan, Setup
from fraexp.simulation.loop_setup import prepare_setup
from fraexp.simulation.machine import Numerics, build_machine

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

        return int(self._batch.results["status"][0]) in (DIVERGED, NOT_FINITE)

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

        batch, size = self._batch, excitation.size
        if not self.has_diverged:
            batch.waveforms[:size] = excitation
            batch.lanes[0]["remaining"], batch.lanes[0]["phase"], batch.cursors[FILL_COUNT, 0] = self._record, 0, 0
            self._run(size)
        if self.has_diverged:
            return np.full((len(self._setup.channels), size), np.nan)
        others = batch.recorded[0, :, TRACE_SAMPLES : TRACE_SAMPLES + size]
        return np.vstack([batch.history[0, :size], others])

    def _run(self, samples: int) -> None:
        self._advance(self._setup.laws, self._batch, self._pool, samples)


def live_setup(sections: Plain, folder: Path) -> Setup:
    """Return the machine of a study's sections made ready; `folder` is the workspace, whose friction laws it may have.

    The sections are plant, friction, controller and loop; numerics and compensation may be missing.
    """
    registry = discover(folder / "plugins")
    return prepare_setup(build_machine({"numerics": Numerics().plain(), **sections}, registry))
