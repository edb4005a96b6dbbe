"""What a play asks of the simulated machine, from rest until it is still again, wherever it is stopped."""

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import chain, pairwise

import numpy as np

from fraexp.components.machine_session import PlayRequest
from fraexp.components.periods import Period, Schedule
from fraexp.data.signals import Segment
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, Setup
from fraexp.simulation.motion_limits import Demand

EARLY_STOPS, LATE_STOPS = 9, 11
"""Moments before it has settled at which a play is stopped, and phases of its last period. An odd number of phases is
not the same in both halves of a sine: it has the effect of twice as many."""
CLOSE_EARLY_STOPS, MAX_CLOSE_LATE_STOPS, CLOSE_ROUNDS = 24, 64, 3
"""Of a play that is looked at closely: the same, with LATE_STOPS for each period of its highest line up to the maximum,
and how many times the stops beside the greatest demands are simulated as well."""
CLOSE_SAMPLES = 500_000
"""Samples that evenly spaced stops of a play may take together when it is looked at closely: a play of up to about 700
samples is stopped at each of them. What follows a stop within a transient differs from one to the next."""
WATCHED_S = 4.0
"""Time after a play in which a motion is awaited that goes further: an integrator that winds up against friction."""
STILL_RATIO, STILL_RESERVE = 1e-3, 1.25
"""Growth of the stroke that no longer counts, and factor on the time after which it does not grow by more."""
REST_RATIO, REST_SHARE = 0.02, 3
"""Part of the stroke by which a machine at rest moves at most in the last third of the time after a play: if it moves
on, it is watched twice as long. The time is that of the ramp out at least: in a few samples nothing moves."""
SAMPLES_AT_ONCE = 1_000_000
"""Samples of all plays that are simulated side by side: they are kept until they have been looked at."""
Report = Callable[[float], None]
"""Takes the part of a simulation that is done, from 0 to 1."""


class SimulatedPlay:
    """A play on the simulated machine, and what it asks for where it is stopped."""

    def __init__(
        self, setup: Setup, request: PlayRequest, lines: Collection[int], settling: int, noise: Demand
    ) -> None:
        """Take what is played, its excited lines, the samples after which it is periodic, and what noise may add."""
        self._setup, self._request, self._settling, self._noise = setup, request, settling, noise
        self._highest_line = max(lines)
        self._rest = self._longest_rest = max(settling, int(WATCHED_S / setup.sample_time))
        self._found: dict[int, Demand] = {}
        """By the sample at which it is stopped."""

    @property
    def demand(self) -> Demand:
        """The greatest of what has been found, with what noise may add."""
        return Demand(*(np.max(list(self._found.values()), axis=0) + self._noise).tolist())

    @property
    def end(self) -> list[int]:
        """The sample at which it ends by itself."""
        return [self._request.full_samples]

    @property
    def stops(self) -> list[int]:
        """Samples all over the play at which it may be stopped."""
        return [*self._early_stops(EARLY_STOPS), *self._late_stops(LATE_STOPS)]

    @property
    def close_stops(self) -> list[int]:
        """More of them, enough for the fastest line of the excitation, and each sample of a short play."""
        late = min(LATE_STOPS * self._highest_line, MAX_CLOSE_LATE_STOPS)
        end = self._request.full_samples
        stride = end * (end // 2 + self._request.ramp_out + self._rest) // CLOSE_SAMPLES + 1
        return [*range(1, end, stride), *self._early_stops(CLOSE_EARLY_STOPS), *self._late_stops(max(late, LATE_STOPS))]

    @property
    def halfway_stops(self) -> list[int]:
        """Samples halfway from the stop of each greatest demand to the stops beside it."""
        known = sorted(self._found)
        greatest = set(np.argmax([self._found[stop] for stop in known], axis=0).tolist())
        return [(a + b) // 2 for k, (a, b) in enumerate(pairwise(known)) if greatest & {k, k + 1}]

    def _early_stops(self, count: int) -> list[int]:
        return [max(self._settling * k * k // (count - 1) ** 2, 1) for k in range(count)]

    def _late_stops(self, count: int) -> list[int]:
        """Return the samples at which it is stopped in its last period.

        What follows depends on the phase, because a force ends and a momentum stays: the peaks of both are among them.
        """
        wave, first = self._request.waveform, (self._request.repetitions - 1) * self._request.waveform.size
        momentum = np.cumsum(wave - wave.mean())
        force_peak, momentum_peak = (int(np.argmax(np.abs(each))) + 1 for each in (wave, momentum - momentum.mean()))
        phases = [momentum_peak + k * wave.size // count for k in range(count)]
        return sorted({first + phase % wave.size for phase in (force_peak, *phases)} - {0})

    def unknown(self, stops: Collection[int]) -> list[int]:
        """Return the stops that have not been simulated."""
        return sorted(set(stops) - self._found.keys())

    def experiment(self, stop: int) -> Experiment:
        """Return the play, stopped at a sample, and the rest after it, as one period that is recorded.

        Its number is the stop, which gives each another noise of the encoder: what all stops have in common, such as a
        fast rise, is then not judged by a single noise, which may have made it smaller.
        """
        request = self._request
        moved = request.excitation(0, stop + request.ramp_out, stop)
        period = Period(np.append(moved, np.zeros(self._rest)), np.array([1]), recorded_periods=1)
        return Experiment(self._setup, period, Schedule(settling_timeout=0.0), stop)

    def note(self, stop: int, segment: Segment | None) -> None:
        """Keep what a simulated play asks for, at the contact that moves most; NaN if it diverges.

        It is not kept, and is unknown still, if the machine has not come to rest and can be watched for longer.
        """
        if segment is None:
            self._found[stop] = Demand(*[float("nan")] * len(Demand._fields))
            return
        moved = [y[0] for name, y in segment.channels.items() if name.partition(".")[0] == "displacement"]
        rest = moved[0].size - stop - self._request.ramp_out
        if rest < self._longest_rest and not all(self._is_at_rest(y, rest) for y in moved):
            self._rest = min(max(self._rest, 2 * rest), self._longest_rest)
            return
        pairs = zip(moved, self._setup.discrete.sample_compliance, strict=True)
        u, sample_time = segment.channels["u"][0], segment.sample_time
        demands = [Demand.of_samples(y, u, sample_time, compliance) for y, compliance in pairs]
        self._found[stop] = Demand(*map(max, zip(*demands, strict=True)))
        if [stop] == self.end:
            still = max(map(_still_after, moved)) - stop - self._request.ramp_out
            self._rest = max(self._settling, self._request.ramp_out, int(STILL_RESERVE * still))

    def _is_at_rest(self, displacement: np.ndarray, rest: int) -> bool:
        """Return whether a machine hardly moves at the end of the rest after a play."""
        return bool(
            np.ptp(displacement[-rest // REST_SHARE :]) <= REST_RATIO * np.ptp(displacement) + self._noise.stroke
        )


def _still_after(displacement: np.ndarray) -> int:
    """Return the sample after which the stroke hardly grows."""
    stroke = np.maximum.accumulate(displacement) - np.minimum.accumulate(displacement)
    return int(np.searchsorted(stroke, (1 - STILL_RATIO) * stroke[-1]))


def simulate_demands(
    plays: Sequence[SimulatedPlay], *, closely: bool = False, report: Report = lambda _: None
) -> list[Demand]:
    """Return what plays on one machine ask for, wherever they are stopped; looked at closely, some percent nearer.

    `report` is told how far the stops all over the plays are, which take nearly all of the time.
    """
    _simulate(plays, lambda play: play.end)
    _simulate(plays, lambda play: play.close_stops if closely else play.stops, report)
    for _ in range(CLOSE_ROUNDS if closely else 0):
        _simulate(plays, lambda play: play.halfway_stops)
    return [play.demand for play in plays]


def _simulate(
    plays: Sequence[SimulatedPlay], chosen: Callable[[SimulatedPlay], list[int]], report: Report = lambda _: None
) -> None:
    """Simulate plays, each with the stops that are chosen for it, until all of them are known."""
    asked = [(play, play.unknown(chosen(play))) for play in plays]
    known, total = 0, sum(len(stops) for _, stops in asked)
    while stopped := [(play, stop) for play, stops in asked for stop in play.unknown(stops)]:
        segments = chain.from_iterable(run_experiments(group, lambda _: None) for group in _groups(stopped))
        for (play, stop), segment in zip(stopped, segments, strict=True):
            play.note(stop, segment)
            known += not play.unknown([stop])  # it is simulated once more if it was not at rest
            report(known / total)


def _groups(stopped: Sequence[tuple[SimulatedPlay, int]]) -> Iterator[list[Experiment]]:
    """Yield the experiments in turn, as many at once as have SAMPLES_AT_ONCE."""
    group, samples = [], 0
    for play, stop in stopped:
        group.append(play.experiment(stop))
        samples += group[-1].period.waveform.size
        if samples >= SAMPLES_AT_ONCE:
            yield group
            group, samples = [], 0
    if group:
        yield group
