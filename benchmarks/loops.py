"""Loops of the same length side by side, run by fraexp's kernel with no settling and no Python around it."""

from dataclasses import dataclass

import numpy as np

from fraexp import experiments
from fraexp.components import Period, Schedule
from fraexp.experiments import Experiment, Setup
from fraexp.kernels import experiments as kernel
from fraexp.kernels.lanes import WIDTH

RAMP, RECORD = 2000, 500
"""Samples of each loop: of which the measured position is kept, then all channels, as of a sweep."""
RISE = 200
"""Samples over which the amplitude rises."""
AMPLITUDE, SLOWEST = 12.0, 10.0
"""Of the excitation [N]; frequency of the first loop [Hz]."""


@dataclass(frozen=True)
class Loops:
    """Jobs that fill the lanes `batches` times."""

    setup: Setup
    batches: int
    jobs: kernel.Jobs
    table: kernel.Table
    lanes: kernel.Lanes
    results: kernel.Results
    pool: np.ndarray

    @classmethod
    def of(cls, setup: Setup, batches: int) -> "Loops":
        """Return loops at different frequencies, with periods of different length."""
        width = WIDTH if setup.wide else 1
        schedule = Schedule(ramp=RISE * setup.sample_time, settle_limit=0.0)
        made = [Experiment(setup, _period(setup, i % width), schedule, i) for i in range(width * batches)]
        plans = [experiments._Plan.of(each) for each in made]
        table = experiments._table(plans, setup)
        jobs = experiments._jobs(plans)._replace(
            ramp=np.full(len(plans), RAMP),
            record=np.full(len(plans), RECORD),
            base=np.zeros(len(plans)),
            rate=np.full(len(plans), 1 / RISE),
        )
        lanes = experiments._lanes(plans, setup, table)._replace(
            history=np.empty((width, RAMP + RECORD)), others=np.empty((width, 3, RECORD))
        )
        pool = np.zeros(len(plans) * (RAMP + 4 * RECORD))
        return cls(setup, batches, jobs, table, lanes, experiments._results(len(plans)), pool)

    def run(self) -> int:
        """Run all jobs."""
        self.lanes.counters[:] = 0
        self.lanes.queue[:] = 0
        self.results.place[:] = -1
        laws = (self.setup.friction.law,) * 2
        return kernel.advance(laws, self.jobs, self.table, self.lanes, self.results, self.pool, 1 << 60)

    @property
    def steps(self) -> int:
        """Steps of all jobs together."""
        return self.jobs.begin.size * (RAMP + RECORD) * int(self.table.sizes[1])

    @property
    def stayed(self) -> bool:
        """Whether no job left the stroke."""
        return bool(np.all(self.results.place >= 0))

    @property
    def sizes(self) -> dict[str, int]:
        """What C calls the loop's sizes."""
        n, m, _, order, late, held, _ = self.table.sizes
        return {"STATES": n, "STEPS": m, "ORDER": order, "LATE": late, "HELD": held}

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
