"""What an identification of friction fits: records, how friction shows in them, and the terms beside the law."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Finding, Quantity, RecordError
from fraexp_plugins.identification._shared.stop_operator import turning_points
from fraexp_plugins.identification.friction._friction_record import FrictionRecord
from fraexp_plugins.identification.friction._observation import Observation, ThrustAndMotion
from fraexp_plugins.identification.friction._regression import CompressedRows, Rows

TERM_UNITS = {"mass": "kg", "viscous": "N s/m", "offset": "N", "asymmetry": "N s/m"}
"""Terms that may be fitted beside a law, with their units."""
SIGNED_TERMS = ("offset", "asymmetry")
"""Those of either sign, which come first; all others are not negative."""
MAX_UNKNOWN_WEIGHT = 1e-3
"""Weight of samples whose friction is unknown up to which a row is used."""
STANDSTILL_SPEED_RATIO = 0.3
"""Speed over that of sliding below which the machine turns: a jump of friction looks like inertia there."""


@dataclass(frozen=True)
class FrictionProblem:
    """Records, their observation, and the terms beside a law."""

    records: tuple[FrictionRecord, ...]
    observation: Observation
    terms: tuple[str, ...]
    """Those of either sign first."""
    known: tuple[NDArray[np.bool_], ...]
    """Whether the law's force is known at each sample of a record if its parameters are, shape (n,) each."""
    thresholds: NDArray[np.float64]
    """Y_i of the grid [m], ascending, shape (N,)."""
    viscous: float | None
    """Known viscous coefficient [N s/m], or None."""
    resolution: float
    """Quantisation step of the encoder [m]; 0 if it is ideal."""
    held_out: NDArray[np.int64]
    """Numbers of the cycles that are held out."""
    cycles: NDArray[np.int64]
    """Numbers of the cycles that are fitted."""
    findings: tuple[Finding | str, ...] = ()
    speed: float | None = None
    """The speed of all sliding [m/s] if there is only one."""
    is_sliding: bool = False
    """Whether only rows in which the machine slides are fitted."""
    lead_doubt: float = 0.0
    """Samples by which the thrust may come earlier than the observation assumes."""

    @cached_property
    def rows(self) -> list[Rows]:
        """Rows of each record, with the terms as columns."""
        found = [self._rows(*pair) for pair in zip(self.records, self.known, strict=True)]
        count = sum(each.force.size for each in found)
        if count < self.observation.min_rows:
            spans: tuple[Quantity | str, ...] = ("the machine slides",)
            if self.thresholds.size:
                largest = Quantity(float(self.thresholds.max()), "m")
                spans = ("the motion spans twice the largest threshold, ", largest, ",")
            found_rows = f" in {count} {self.observation.rows_name}; expected {self.observation.min_rows} or more: "
            raise RecordError(*spans, found_rows, "record more cycles with gross sliding")
        return found

    def _rows(self, record: FrictionRecord, known: NDArray[np.bool_]) -> Rows:
        seen, v = self.observation, record.velocity()
        plain = seen.friction(record, np.column_stack([np.ones_like(v), np.abs(v), v, ~known]))
        columns = dict(zip(("offset", "asymmetry", "viscous", "unknown"), plain.T, strict=True))
        columns["mass"] = seen.acceleration(record)[:, 0]
        samples = seen.samples(record)
        every = Rows(
            columns=np.array([columns[term] for term in self.terms]).reshape(-1, samples.size).T,
            force=seen.force(record)[:, 0] - (self.viscous or 0.0) * columns["viscous"],
            velocity=columns["viscous"],
            cycle=record.cycle[samples],
            time=np.asarray(record.sample_time * samples, dtype=np.float64),
            place=np.arange(samples.size),
        )
        return every.select(columns["unknown"] < MAX_UNKNOWN_WEIGHT)

    def forces_in_rows(self, forces: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return forces at the samples of each record, shape (n, N), in its rows, shape (rows, N)."""
        triples = zip(self.records, forces, self.rows, strict=True)
        return [self.observation.friction(record, each)[rows.place] for record, each, rows in triples]

    def rows_with(self, forces: Sequence[NDArray[np.float64]]) -> list[Rows]:
        """Return the rows with further columns, of forces at the samples of each record, shape (n, N)."""
        pairs = zip(self.rows, self.forces_in_rows(forces), strict=True)
        return [replace(rows, columns=np.hstack([rows.columns, each])) for rows, each in pairs]

    def compress(self, rows: Sequence[Rows], cycles: NDArray[np.int64]) -> CompressedRows:
        """Return the rows of some cycles, compressed."""
        return CompressedRows(rows, sum(term in SIGNED_TERMS for term in self.terms), cycles)

    def fitted(self, parts: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return what belongs to the cycles that are fitted, of each record."""
        return [part[np.isin(rows.cycle, self.cycles)] for part, rows in zip(parts, self.rows, strict=True)]

    def with_lead(self, lead: float) -> "FrictionProblem":
        """Return the problem with a thrust that comes so many samples earlier than a held one."""
        assert isinstance(self.observation, ThrustAndMotion)
        return replace(self, observation=replace(self.observation, lead=lead))

    @property
    def thrust_doubt(self) -> NDArray[np.float64]:
        """Change of the forces of all fitted rows [N] by the lead of the thrust that is not known, shape (rows,)."""
        assert isinstance(self.observation, ThrustAndMotion)
        moved = self.with_lead(self.observation.lead + self.lead_doubt)
        return np.concatenate(self.fitted([a.force - b.force for a, b in zip(moved.rows, self.rows, strict=True)]))

    def noise(self, mass: float) -> float:
        """Return the error of a row [N] by noise of the channels."""
        return max(self.observation.noise(record, max(mass, 0.0)) for record in self.records)

    @property
    def rows_per_noise(self) -> float:
        """Rows over which white noise is correlated."""
        return self.observation.rows_per_noise(self.records[0])

    @property
    def standstill_time(self) -> float:
        """Standstill time at a reversal of a motion at one speed, plus one sample [s]."""
        return max(_standstill_time(record, self.speed or 0.0) for record in self.records)


def _standstill_time(record: FrictionRecord, speed: float) -> float:
    turns = turning_points(record.displacement, speed * record.sample_time).size
    slow = int(np.sum(np.abs(record.velocity()) < STANDSTILL_SPEED_RATIO * speed))
    return (1 + slow / max(turns, 1)) * record.sample_time
