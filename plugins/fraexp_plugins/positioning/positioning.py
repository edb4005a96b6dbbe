"""What became of a positioning motion: overshoot, settling, residual vibration, thrust."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fraexp.api import Curve, Estimator, Metric, RecordError, Result, Segment, Signals, param

STILL = 1e-9
"""Change of the reference per sample, relative to its range, up to which it rests."""
STEADY = 10
"""The last part of the rest, one in so many, tells the steady-state error."""
COMPENSATION = ", as with wrong friction compensation or plant gain"


class Positioning(Estimator, name="positioning", version=2):
    """Overshoot, settling time into ± `band` and residual vibration of each move (paper, Fig 8); the worst of all.

    A move begins where the reference begins to move, and lasts until the next one; its target is where the reference
    then rests. Settling time is the time until the position stays within the band, which is more than the time to the
    first entry where it is left again. Residual vibration is what goes up and down once the reference is at rest: half
    of the greatest swing from one extreme to the next one, and the frequency of those swings that are at least half as
    great; what the scale's resolution and noise explain does not count (N. C. Singer and W. P. Seering, J. Dynamic
    Systems, Measurement, and Control 112(1), 1990, doi:10.1115/1.2894142, on residual vibration).

    Where the position is outside the band when the next move begins, or the record ends, there is no settling time
    (NaN) and the message says so. A move that is no longer than the band begins inside of it and tests nothing: it has
    no settling time that counts. Not to be used with a reference that never rests.
    """

    output: str = param("", "channel of the position", "y")
    reference: str = param("", "channel of the position reference, as it is to be measured", "reference")
    input: str = param("", "channel of the thrust; not needed", "u")
    band: float = param("m", "half width of the band around the target", 4e-6, above=0)
    resolution: float = param("m", "resolution of the scale", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the scale's noise", 0.0, at_least=0, inherit="loop.noise")
    rest: float = param("s", "time for which the reference rests at a target at least", 0.02, above=0)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses signals without a moving reference, with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return the metrics of the worst move, and time, position, reference, error, target, band and thrust."""
        units = {"position": signals.unit(self.output), "reference": signals.unit(self.reference)}
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        moves = [move for segment in signals.segments for move in self._moves(segment)]
        curves = tuple(self._curve(segment, signals.units, units) for segment in signals.segments)
        message = signals.message or "; ".join(self._remarks(moves, units["position"]))
        return Result(signals.outcome, message, metrics=tuple(_worst(moves, signals, self)), curves=curves)

    def _remarks(self, moves: Sequence["_Move"], unit: str) -> Iterator[str]:
        """Yield what is to be said of moves that test nothing, and of those after which the position is outside."""
        band, short = f"±{_length(self.band, unit)}", sum(not move.tested for move in moves)
        if short:
            yield (
                f"{short} of {_moves(len(moves))} {'is' if short == 1 else 'are'} no longer than the band of {band}, "
                "which tests nothing: lower 'band', or move farther"
            )
        away = [move for move in moves if move.tested and np.isnan(move.settling_time)]
        if away:
            of = f"{len(away)} of {_moves(len(moves))}"
            yield f"after {of} the position is not within {band}: {self._why(away, unit)}"

    def _why(self, away: Sequence["_Move"], unit: str) -> str:
        """Return why the position may be outside of the band, and what may help."""
        if self.band < self.resolution + 3 * self.noise:
            known = (("resolution", self.resolution), ("noise", self.noise))
            scale = " and a ".join(f"{name} of {_length(value, unit)}" for name, value in known if value)
            return f"the scale has a {scale}; take a wider band, or a better scale"
        off = max((move.steady_state_error for move in away), key=abs)
        ringing = max(away, key=lambda move: move.vibration)
        stays = f"it stays {_length(abs(off), unit)} off" if abs(off) > self.band else ""
        swing = f"{_length(ringing.vibration, unit)} at {ringing.frequency:.3g} Hz"
        vibrates = f"it vibrates by {swing}" if ringing.vibration > self.band else ""
        models = "improve the friction model or the design model, or allow a longer hold or a wider band"
        cause = "" if stays and vibrates else ", as with wrong modes" if vibrates else COMPENSATION if stays else ""
        seen = " and ".join(filter(None, (stays, vibrates)))
        return f"{seen}{cause}; {models}" if seen else models

    def _moves(self, segment: Segment) -> list["_Move"]:
        y, r = (segment.channels[name].ravel() for name in (self.output, self.reference))
        u = segment.channels[self.input].ravel() if self.input in segment.channels else np.full(y.size, np.nan)
        bounds = self._bounds(r, segment.sample_time)
        least = 2 * self.resolution + 6 * self.noise
        nexts = [begin for begin, _ in bounds[1:]] + [y.size]
        return [
            _Move.of(y[begin:last] - r[end], end - begin, r[end] - r[begin], u[begin:last], self.band, least, segment)
            for (begin, end), last in zip(bounds, nexts, strict=True)
        ]

    def _bounds(self, r: np.ndarray, sample_time: float) -> list[tuple[int, int]]:
        """Return the last sample before and the first sample after each move of the reference."""
        changes = np.flatnonzero(np.abs(np.diff(r)) > STILL * np.ptp(r))
        if not changes.size:
            raise RecordError(f"{self.reference} does not move: positioning needs a motion, such as point_to_point")
        rest = max(round(self.rest / sample_time), 1)
        gaps = np.flatnonzero(np.diff(changes) > rest)
        begins, ends = changes[np.append(0, gaps + 1)], changes[np.append(gaps, changes.size - 1)] + 1
        if r.size - ends[-1] < rest:
            raise RecordError(
                f"{self.reference} moves until the record ends: positioning needs {self.rest:g} s of rest after each "
                "move; record for longer, or lower 'rest'"
            )
        return list(zip(begins.tolist(), ends.tolist(), strict=True))

    def _curve(self, segment: Segment, known: Mapping[str, str], units: dict[str, str]) -> Curve:
        y, r = (segment.channels[name].ravel() for name in (self.output, self.reference))
        columns = {"time": np.arange(y.size) * segment.sample_time, "position": y, "reference": r, "error": r - y}
        columns |= {"target": self._targets(r, segment.sample_time), "band": np.full(y.size, self.band)}
        all_units = {"time": "s", **units} | dict.fromkeys(("error", "target", "band"), units["position"])
        if self.input in segment.channels:
            columns["thrust"], all_units["thrust"] = segment.channels[self.input].ravel(), known[self.input]
        return Curve("positioning", columns, all_units)

    def _targets(self, r: np.ndarray, sample_time: float) -> np.ndarray:
        """Return the target of the move that each sample belongs to, shape (n,)."""
        bounds = self._bounds(r, sample_time)
        lengths = np.diff([0, *(begin for begin, _ in bounds[1:]), r.size])
        return np.repeat([r[end] for _, end in bounds], lengths)


@dataclass(frozen=True)
class _Move:
    """What became of one move; in the units of the channels and seconds."""

    tested: bool
    """Whether it begins outside of the band around its target."""
    overshoot: float
    first_entry: float
    """Time until the band is entered; NaN if it never is."""
    settling_time: float
    """Time until it is not left again; NaN if it is left at the end."""
    departures: int
    """How often the band is left again."""
    vibration: float
    frequency: float
    steady_state_error: float
    peak_thrust: float

    @classmethod
    def of(
        cls,
        deviation: np.ndarray,
        moving: int,
        distance: float,
        u: np.ndarray,
        band: float,
        least: float,
        segment: Segment,
    ) -> "_Move":
        """Return it for a deviation from the target, of which the reference moves for the first samples."""
        outside = np.abs(deviation) > band
        inside, left = np.flatnonzero(~outside), np.flatnonzero(outside)
        settled = inside.size and not outside[-1]
        vibration, frequency = _vibration(deviation[moving:], segment.sample_time, least)
        return cls(
            tested=abs(distance) > band,
            overshoot=max(float(np.max(np.sign(distance) * deviation)), 0.0),
            first_entry=float(inside[0]) * segment.sample_time if inside.size else np.nan,
            settling_time=float(left[-1] + 1 if left.size else 0) * segment.sample_time if settled else np.nan,
            departures=int(np.count_nonzero(np.diff(outside.astype(int)) == 1)),
            vibration=vibration,
            frequency=frequency,
            steady_state_error=float(np.mean(deviation[-max(deviation.size - moving, STEADY) // STEADY :])),
            peak_thrust=float(np.abs(u).max()),
        )


def _length(value: float, unit: str) -> str:
    """Return a length in a unit in which it is neither tiny nor huge; of another quantity, the value in its unit."""
    sizes = ((1.0, 1.0, "m"), (1e-3, 1e3, "mm"), (1e-7, 1e6, "µm"), (0.0, 1e9, "nm"))
    factor, shown = next((f, name) for least, f, name in sizes if value >= least) if unit == "m" else (1.0, unit)
    return f"{factor * value:.3g} {shown}"


def _moves(count: int) -> str:
    return "1 move" if count == 1 else f"{count} moves"


def _turning_points(values: np.ndarray, least: float) -> np.ndarray:
    """Return the extremes between which the values go up and down by more than `least`: their indices, ascending."""
    found: list[int] = []
    low = high = 0
    rising = 0
    for i, value in enumerate(values.tolist()):
        low, high = (i if value < values[low] else low), (i if value > values[high] else high)
        if rising >= 0 and values[high] - value > least:
            found += [high] if rising else []
            rising, low = -1, i
        elif rising <= 0 and value - values[low] > least:
            found += [low] if rising else []
            rising, high = 1, i
    return np.array(found, dtype=int)


def _vibration(deviation: np.ndarray, sample_time: float, least: float) -> tuple[float, float]:
    """Return half of the greatest swing between two extremes and the frequency [Hz]; 0 and NaN without swings."""
    at = _turning_points(deviation, least)
    if at.size < 2:
        return 0.0, np.nan
    swings, times = np.abs(np.diff(deviation[at])), np.diff(at) * sample_time
    great = swings >= swings.max() / 2
    return float(swings.max() / 2), float(1 / (2 * np.mean(times[great])))


def _worst(moves: Sequence[_Move], signals: Signals, names: Positioning) -> Iterator[Metric]:
    length = signals.unit(names.output)
    ringing = max(moves, key=lambda move: move.vibration)
    tested = [move for move in moves if move.tested]
    yield Metric("overshoot", max(move.overshoot for move in moves), length)
    yield Metric("first entry", float(np.max([move.first_entry for move in tested] or [np.nan])), "s")
    yield Metric("settling time", float(np.max([move.settling_time for move in tested] or [np.nan])), "s")
    if names.input in signals.units:
        yield Metric("peak thrust", max(move.peak_thrust for move in moves), signals.unit(names.input))
    yield Metric("departures", float(max(move.departures for move in moves)), "1")
    yield Metric("residual vibration", ringing.vibration, length)
    yield Metric("vibration frequency", ringing.frequency, "Hz")
    yield Metric("steady-state error", max((move.steady_state_error for move in moves), key=abs), length)
