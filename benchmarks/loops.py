"""Loops of the same length side by side, run by fraexp's kernel with no settling and no Python around it."""

from dataclasses import dataclass

import numpy as np

from fraexp.components.periods import Period, Schedule
from fraexp.kernels import batch
from fraexp.kernels.batch_arrays import KernelBatch
from fraexp.kernels.lanes import WIDE
from fraexp.kernels.memory_moves import TILE
from fraexp.simulation.batch_preparation import empty_records, prepare_batch
from fraexp.simulation.experiments import Experiment, ExperimentPlan, Setup

RAMP, RECORD = 2000, 500
"""Samples of each loop: of which the measured position is kept, then all channels, as of a sweep."""
RISE = 200
"""Samples over which the amplitude rises."""
AMPLITUDE, SLOWEST = 12.0, 10.0
"""Of the excitation [N]; frequency of the first loop [Hz]."""
SIZES = {
    "STATES": "states",
    "STEPS": "steps",
    "ORDER": "controller_order",
    "LATE": "input_delay",
    "HELD": "output_delay",
}
"""What C calls the loop's sizes, and their fields in a frame."""


@dataclass(frozen=True)
class Loops:
    """Jobs that fill the lanes `batches` times."""

    setup: Setup
    batches: int
    work: KernelBatch
    pool: np.ndarray

    @classmethod
    def of(cls, setup: Setup, batches: int) -> "Loops":
        """Return loops at different frequencies, with periods of different length."""
        width = WIDE if setup.is_vectorised else 1
        schedule = Schedule(ramp=RISE * setup.sample_time, settling_timeout=0.0)
        made = [Experiment(setup, _period(setup, i % width), schedule, i) for i in range(width * batches)]
        plans = [ExperimentPlan.from_experiment(each) for each in made]
        work = prepare_batch(plans, setup)
        arrays = work.arrays._replace(
            history=np.empty((width, RAMP + RECORD + TILE)), recorded=empty_records(width, 3, RECORD)
        )
        for name, value in {"ramp": RAMP, "record": RECORD, "start_amplitude": 0.0, "amplitude_rise": 1 / RISE}.items():
            arrays.jobs[name] = value
        return cls(setup, batches, work._replace(arrays=arrays), np.zeros(len(plans) * (RAMP + 4 * RECORD)))

    def run(self) -> int:
        """Run all jobs."""
        for array in (self.work.arrays.lanes, self.work.arrays.queue):
            array[:] = 0
        self.work.arrays.results["pool_index"] = -1
        return batch.advance(self.setup.laws, self.work, self.pool, 1 << 60)

    @property
    def steps(self) -> int:
        """Steps of all jobs together."""
        return self.work.arrays.jobs.size * (RAMP + RECORD) * self.setup.steps

    @property
    def stayed(self) -> bool:
        """Whether no job exceeded the divergence limit."""
        return bool(np.all(self.work.arrays.results["pool_index"] >= 0))

    @property
    def sizes(self) -> dict[str, int]:
        """What C calls the loop's sizes."""
        frame = self.work.arrays.frame[0]
        return {name: int(frame[field]) for name, field in SIZES.items()}

    def channels(self, pool: np.ndarray | None = None) -> np.ndarray:
        """Return measured position, then control input, displacement and force of the records, each of the same size.

        The measured positions before the record are left out.
        """
        jobs = (self.pool if pool is None else pool).reshape(-1, RAMP + 4 * RECORD)
        return jobs[:, RAMP:].reshape(-1, 4, RECORD).swapaxes(0, 1).reshape(4, -1)


def _period(setup: Setup, lane: int) -> Period:
    samples = 400 + 16 * lane
    cycles = max(round(SLOWEST * (1 + lane) * setup.sample_time * samples), 1)
    phase = 2 * np.pi * cycles * np.arange(samples) / samples
    return Period(AMPLITUDE * np.sin(phase), np.array([cycles]))
