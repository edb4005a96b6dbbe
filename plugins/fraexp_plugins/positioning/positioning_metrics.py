"""Metrics of a positioning motion: overshoot, settling, residual vibration, thrust."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Estimator, Finding, Metric, Quantity, RecordError, Result, Segment, Signals, param

REST_TOLERANCE = 1e-9
"""Change of the reference per sample, relative to its range, up to which it rests."""
STEADY_STATE_DIVISOR = 10
"""The steady-state error is the mean over the last tenth of the rest."""


class PositioningMetrics(Estimator, name="positioning_metrics", version=2):
    """Overshoot, settling time into ± `settling_window`, residual vibration (paper, Fig 8); the worst of all moves.

    A move begins where the reference begins to move, and lasts until the next one; its target is where the reference
    then rests. Settling time is the time until the position stays within the window, which is more than the time to the
    first entry if it leaves the window again. Residual vibration is the oscillation once the reference is at rest: half
    of the greatest swing from one extreme to the next one, and the frequency of those swings that are at least half as
    great; swings that the encoder's quantisation and noise explain do not count (N. C. Singer and W. P. Seering, J.
    Dynamic Systems, Measurement, and Control 112(1), 1990, doi:10.1115/1.2894142, on residual vibration).

    If the position is outside the window when the next move begins, or the record ends, there is no settling time
    (NaN) and the message says so. A move that is no longer than the window begins inside it and tests nothing: it has
    no settling time that counts. The reference must rest after each move.
    """

    output: str = param("", "channel of the position", "y")
    reference: str = param("", "channel of the position reference, delayed as the position is", "reference")
    input: str = param("", "channel of the thrust; optional", "u")
    settling_window: float = param("m", "half width of the settling window around the target", 4e-6, above=0)
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the encoder's noise", 0.0, at_least=0, inherit="loop.noise")
    min_rest_time: float = param("s", "minimum time for which the reference rests at a target", 0.02, above=0)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses signals without a moving reference, with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return the metrics of the worst move, and time, position, reference, error, target, band and thrust."""
        units = {"position": signals.unit(self.output), "reference": signals.unit(self.reference)}
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        moves = [move for segment in signals.segments for move in self._moves(segment)]
        curves = tuple(self._curve(segment, signals.units, units) for segment in signals.segments)
        findings = signals.findings or tuple(self._remarks(moves))
        return Result(signals.outcome, findings, metrics=tuple(_worst_metrics(moves, signals, self)), curves=curves)

    def _remarks(self, moves: Sequence["_Move"]) -> Iterator[Finding]:
        """Yield findings on moves that test nothing, and on those after which the position is outside the window."""
        window, short = Quantity(self.settling_window, "m", "settling window ±"), sum(not of.is_tested for of in moves)
        if short:
            yield Finding("no longer than its window", (window,), place=f"{short} of {_count_text(len(moves))}")
        outside = [move for move in moves if move.is_tested and np.isnan(move.settling_time)]
        if outside:
            place, (found, remedy) = f"{len(outside)} of {_count_text(len(moves))}", self._behaviour(outside)
            yield Finding("outside its window", (window, *found), place=place, remedy=remedy)

    def _behaviour(self, outside: Sequence["_Move"]) -> tuple[list[Quantity], str]:
        """Return what keeps the position outside the settling window, and what may help."""
        if self.settling_window < self.resolution + 3 * self.noise:
            known = (("quantisation step", self.resolution), ("noise", self.noise))
            flaws = [Quantity(value, "m", f"{name} of the encoder") for name, value in known if value]
            return flaws, "take a wider settling window, or a better encoder"
        off = max(abs(move.steady_state_error) for move in outside)
        ringing = max(outside, key=lambda move: move.vibration)
        found = [Quantity(off, "m", "steady-state error")] if off > self.settling_window else []
        if ringing.vibration > self.settling_window:
            found.append(Quantity(ringing.vibration, "m", "vibration", ringing.frequency))
        return found, ""

    def _moves(self, segment: Segment) -> list["_Move"]:
        y, r = (segment.channels[name].ravel() for name in (self.output, self.reference))
        u = segment.channels[self.input].ravel() if self.input in segment.channels else np.full(y.size, np.nan)
        bounds = self._bounds(r, segment.sample_time)
        min_swing = 2 * self.resolution + 6 * self.noise
        ends_of_rest = [begin for begin, _ in bounds[1:]] + [y.size]
        return [
            _Move.from_signals(
                y[begin:last] - r[end],
                end - begin,
                r[end] - r[begin],
                u[begin:last],
                self.settling_window,
                min_swing,
                segment,
            )
            for (begin, end), last in zip(bounds, ends_of_rest, strict=True)
        ]

    def _bounds(self, r: NDArray[np.float64], sample_time: float) -> list[tuple[int, int]]:
        """Return the last sample before and the first sample after each move of the reference."""
        changes = np.flatnonzero(np.abs(np.diff(r)) > REST_TOLERANCE * np.ptp(r))
        if not changes.size:
            raise RecordError(
                f"{self.reference} does not move: positioning_metrics needs a motion, such as point_to_point"
            )
        rest_samples = max(round(self.min_rest_time / sample_time), 1)
        gaps = np.flatnonzero(np.diff(changes) > rest_samples)
        begins, ends = changes[np.append(0, gaps + 1)], changes[np.append(gaps, changes.size - 1)] + 1
        if r.size - ends[-1] < rest_samples:
            raise RecordError(
                f"{self.reference} moves until the record ends: positioning_metrics needs "
                f"{self.min_rest_time:g} s of rest after each move; record for longer, or lower 'min_rest_time'"
            )
        return list(zip(begins.tolist(), ends.tolist(), strict=True))

    def _curve(self, segment: Segment, known: Mapping[str, str], units: dict[str, str]) -> Curve:
        y, r = (segment.channels[name].ravel() for name in (self.output, self.reference))
        time = segment.sample_time * np.arange(y.size, dtype=np.float64)
        columns: dict[str, NDArray[np.float64]] = {"time": time, "position": y, "reference": r, "error": r - y}
        columns |= {"target": self._targets(r, segment.sample_time), "band": np.full(y.size, self.settling_window)}
        all_units = {"time": "s", **units} | dict.fromkeys(("error", "target", "band"), units["position"])
        if self.input in segment.channels:
            columns["thrust"], all_units["thrust"] = segment.channels[self.input].ravel(), known[self.input]
        return Curve("positioning", columns, all_units)

    def _targets(self, r: NDArray[np.float64], sample_time: float) -> NDArray[np.float64]:
        """Return the target of the move that each sample belongs to, shape (n,)."""
        bounds = self._bounds(r, sample_time)
        lengths = np.diff([0, *(begin for begin, _ in bounds[1:]), r.size])
        return np.repeat([r[end] for _, end in bounds], lengths)


@dataclass(frozen=True)
class _Move:
    """Metrics of one move, in the units of the channels and seconds."""

    is_tested: bool
    """Whether it begins outside the settling window around its target."""
    overshoot: float
    first_entry: float
    """Time until the position enters the window; NaN if it never does."""
    settling_time: float
    """Time until the position stays in the window; NaN if it is outside at the end."""
    departures: int
    """How often the position leaves the window again."""
    vibration: float
    frequency: float
    steady_state_error: float
    peak_thrust: float

    @classmethod
    def from_signals(
        cls,
        deviation: NDArray[np.float64],
        move_samples: int,
        distance: float,
        u: NDArray[np.float64],
        window: float,
        min_swing: float,
        segment: Segment,
    ) -> "_Move":
        """Return the metrics of a deviation from the target during whose first samples the reference moves."""
        is_outside = np.abs(deviation) > window
        inside, outside = np.flatnonzero(~is_outside), np.flatnonzero(is_outside)
        settled = inside.size and not is_outside[-1]
        vibration, frequency = _vibration(deviation[move_samples:], segment.sample_time, min_swing)
        return cls(
            is_tested=abs(distance) > window,
            overshoot=max(float(np.max(np.sign(distance) * deviation)), 0.0),
            first_entry=float(inside[0]) * segment.sample_time if inside.size else np.nan,
            settling_time=float(outside[-1] + 1 if outside.size else 0) * segment.sample_time if settled else np.nan,
            departures=int(np.count_nonzero(np.diff(is_outside.astype(int)) == 1)),
            vibration=vibration,
            frequency=frequency,
            steady_state_error=float(
                np.mean(deviation[-max(deviation.size - move_samples, STEADY_STATE_DIVISOR) // STEADY_STATE_DIVISOR :])
            ),
            peak_thrust=float(np.abs(u).max()),
        )


def _count_text(count: int) -> str:
    return "1 move" if count == 1 else f"{count} moves"


def _turning_points(values: NDArray[np.float64], min_swing: float) -> NDArray[np.int64]:
    """Return the indices of the extremes between which the values rise and fall by more than `min_swing`, ascending."""
    indices: list[int] = []
    low = high = 0
    rising = 0
    for i, value in enumerate(values.tolist()):
        low, high = (i if value < values[low] else low), (i if value > values[high] else high)
        if rising >= 0 and values[high] - value > min_swing:
            indices += [high] if rising else []
            rising, low = -1, i
        elif rising <= 0 and value - values[low] > min_swing:
            indices += [low] if rising else []
            rising, high = 1, i
    return np.array(indices, dtype=int)


def _vibration(deviation: NDArray[np.float64], sample_time: float, min_swing: float) -> tuple[float, float]:
    """Return half of the greatest swing between two extremes and the frequency [Hz]; 0 and NaN without swings."""
    turns = _turning_points(deviation, min_swing)
    if turns.size < 2:
        return 0.0, np.nan
    swings, times = np.abs(np.diff(deviation[turns])), np.diff(turns) * sample_time
    is_great = swings >= swings.max() / 2
    return float(swings.max() / 2), float(1 / (2 * np.mean(times[is_great])))


def _worst_metrics(moves: Sequence[_Move], signals: Signals, names: PositioningMetrics) -> Iterator[Metric]:
    length = signals.unit(names.output)
    ringing = max(moves, key=lambda move: move.vibration)
    tested = [move for move in moves if move.is_tested]
    yield Metric("overshoot", max(move.overshoot for move in moves), length)
    yield Metric("first entry", float(np.max([move.first_entry for move in tested] or [np.nan])), "s")
    yield Metric("settling time", float(np.max([move.settling_time for move in tested] or [np.nan])), "s")
    if names.input in signals.units:
        yield Metric("peak thrust", max(move.peak_thrust for move in moves), signals.unit(names.input))
    yield Metric("departures", float(max(move.departures for move in moves)), "1")
    yield Metric("residual vibration", ringing.vibration, length)
    yield Metric("vibration frequency", ringing.frequency, "Hz")
    yield Metric("steady-state error", max((move.steady_state_error for move in moves), key=abs), length)
