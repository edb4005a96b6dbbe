"""One point on a machine: played, watched until it has settled, stored, and stopped as soon as it is good enough."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.confidence import confidence_limits
from fraexp.analysis.fourier import phasors
from fraexp.analysis.quantisation import moves_visibly
from fraexp.analysis.response import response_result
from fraexp.components.machine_session import Chunk
from fraexp.data.findings import Quantity
from fraexp.data.results import FrequencyResponse
from fraexp.data.sample_file import SampleWriter
from fraexp.data.signals import Segment, Signals
from fraexp.errors import ConnectionLostError, LimitError, MachineError
from fraexp.measurement.measured_points import PLAY_COLUMN, MeasuredPoint, store_chunk
from fraexp.measurement.measurement_plan import PlannedPoint
from fraexp.measurement.motion_guard import LimitExceededError, RunawayError
from fraexp.measurement.watched_machine import WatchedMachine
from fraexp.records.loop_equation import FaultKind, LoopController, fault_finding, judge_play
from fraexp.simulation.experiments import ExperimentPlan
from fraexp.simulation.motion_limits import Demand

MAX_DECAY_RATIO = 0.98
"""Greatest ratio of successive differences that the extrapolation uses: a slower decay looks like noise."""
MAX_DRIFT = 0.03
"""Change of the mean position between windows, over the motion, that is no lack of a steady state where it may drift: a
feedback without integral action holds an axis with friction by a weak spring, and takes many seconds."""
MAX_PHASOR_STDS = 3.0
"""Difference of two windows' phasors, in standard deviations by encoder and noise, that is no drift."""


class SettlingMonitor:
    """Compares windows of the position as they become complete; `fraexp.kernels.settling` explains the rule."""

    def __init__(self, counts: ExperimentPlan, may_drift: bool = False) -> None:
        self._max_drift = MAX_DRIFT if may_drift else 0.0
        self._counts, self._windows, self._excess = counts, 0, np.inf
        lines = counts.experiment.period.lines
        self._cycles = int(lines[0]) if lines.size == 1 else 0
        self.residual = float("nan")
        """Relative difference of the last two windows."""
        self.is_settled = counts.window == 0
        self.record_start: int | None = 0 if counts.window == 0 else None
        """First sample of the record; None while it is not known."""

    def look(self, position: NDArray[np.float64]) -> None:
        """Compare the windows that have become complete; `position` are all samples since rest [m], shape (n,)."""
        counts = self._counts
        while self.record_start is None:
            end = counts.ramp + (self._windows + 1) * counts.window
            if end > position.size:
                return
            self._windows += 1
            self.is_settled = self._windows >= 2 and self._has_settled(position[:end])
            if self.is_settled or end >= counts.settling_limit:
                self.record_start = end - counts.record if counts.record <= counts.window else end

    def _has_settled(self, position: NDArray[np.float64]) -> bool:
        counts = self._counts
        last, before = position[-counts.window :], position[-2 * counts.window : -counts.window]
        difference, motion = last - before, float(np.std(last))
        if abs(np.mean(difference)) <= self._max_drift * motion:
            difference = difference - np.mean(difference)
        change = float(np.sqrt(np.mean(difference**2)))
        floor = max(counts.noise_floor, self._scatter(difference))
        if motion == 0.0:
            return change == 0.0
        self.residual = change / motion
        previous, self._excess = self._excess, max(change - floor, 0.0) / motion
        if sum_to_come(self._excess, previous) > counts.experiment.schedule.settling_tolerance:
            return False
        return floor == 0.0 or self._cycles == 0 or not self._drifts(position, floor)

    def _scatter(self, difference: NDArray[np.float64]) -> float:
        """Return the part of two windows' difference [m] that changes from sample to sample, as noise and encoder do.

        Motions change smoothly, but for a sine of few samples a period: the excited line is no part of it. Nobody has
        to state such noise, which at rest an encoder may hide in one of its steps.
        """
        if self._cycles == 0:
            return 0.0
        window = self._counts.window
        angle = 2 * np.pi * self._cycles * np.arange(window) / self._counts.experiment.period.waveform.size
        line = np.exp(1j * angle)
        left = difference - np.real(2 / window * (difference @ line.conj()) * line)
        return float(np.sqrt(np.mean(np.diff(left) ** 2) / 2)) * (1 + 3 / np.sqrt(2 * window))

    def _drifts(self, position: NDArray[np.float64], floor: float) -> bool:
        """Return whether the phasor goes on changing, too slowly for successive windows to show it."""
        counts, lag = self._counts, (self._windows - 1) // 2
        if lag == 0:
            return False
        last, middle, first = (self._phasor(position, k * lag * counts.window) for k in range(3))
        explained = MAX_PHASOR_STDS * floor * np.sqrt(2.0 / counts.window)
        difference, before = max(abs(last - middle) - explained, 0.0), abs(middle - first)
        return sum_to_come(difference, before) > counts.experiment.schedule.settling_tolerance * abs(last)

    def _phasor(self, position: NDArray[np.float64], back: int) -> complex:
        """Return the phasor [m] over the window that ends `back` samples before the last one."""
        counts, end = self._counts, position.size - back
        window = position[end - counts.window : end]
        angle = -2j * np.pi * self._cycles / counts.experiment.period.waveform.size
        return complex(2.0 / counts.window * (window @ np.exp(angle * np.arange(counts.window))))


def sum_to_come(difference: float, before: float) -> float:
    """Return the sum of all differences to come, as a geometric series from the last two; at least the last one."""
    ratio = min(difference / before, MAX_DECAY_RATIO) if before > 0.0 else 0.0
    return difference * max(1.0, ratio / (1.0 - ratio))


MIN_BAND_PERIODS = 4
"""Least number of periods whose scatter is taken for a band."""
BAND_GROWTH = 1.25
"""Factor between two numbers of periods at which the band is looked at: each look is a chance to stop too early."""
HOPELESS_RATIO = 1.5
"""Band at the end of the longest record, as projected, over the one asked for, from which a record is given up."""

VISIBLE_RATIO = 5.0
"""Predicted stroke, over the range of a position that shows nothing but noise, from which the axis stands."""
LEAST_MOTION = 1e-12
"""Motion [m or rad] below which an axis stands: no encoder shows it, and a simulation's rounding does."""


MIN_JUDGED_SAMPLES = 20
"""Samples from which a play shows what its channels are."""
CHANNEL_REMEDY = "correct what the machine records, or state its units in measurement.machine"
COMPENSATION_REMEDY = "switch it off while the machine is measured, or raise excitation.settling_tolerance"


class UnsettledError(MachineError):
    """A play was too short: the machine settles more slowly than was predicted."""


@dataclass(frozen=True)
class PointProgress:
    """How far a point has come that is being played."""

    point: PlannedPoint
    seconds: float
    """Machine time of the play so far [s]."""
    is_settled: bool
    periods: int
    """Periods recorded so far."""
    band: float | None
    """Half-width of the 95 % band by the scatter of the periods [dB]; None as long as it is not known."""
    used: float
    """Greatest part of a limit that has been reached."""
    demand: Demand
    """The greatest motion and force of the play so far."""


class RecordAim(NamedTuple):
    """When the record of a point is long enough."""

    band: float | None
    """Half-width of the 95 % band [dB] that is asked for; None for a record of stated length."""
    shortest: int
    """Samples that are recorded at least."""
    longest: int
    """Samples that are recorded at most."""
    is_patient: bool
    """Whether it goes on although the band will not be reached in that time."""


class PointMeasurement:
    """A play of a point; iterate over it for its progress, then read `result`."""

    def __init__(
        self,
        point: PlannedPoint,
        machine: WatchedMachine,
        writer: SampleWriter,
        aim: "RecordAim",
        play: int,
        reserve: float,
    ) -> None:
        self._point, self._machine, self._writer, self._guard = point, machine, writer, machine.guard
        self._goal, self._record, self._longest, self._is_patient = aim
        self._play, self.is_hopeless = play, False
        self._is_live = machine.description.is_live
        expected = point.expected_request(self._record, reserve)
        self._request = point.request(self._longest) if self._is_live else expected
        self._monitor = SettlingMonitor(point.counts, point.may_drift)
        self._channels = [name for name in writer.header.units if name != PLAY_COLUMN]
        self._samples = np.empty((len(self._channels), self._request.samples))
        self._count, self._periods, self._next_look = 0, 0, 0
        self._rest = writer.rows
        self._is_enough = False
        self.band: float | None = None
        """Half-width of the 95 % band by the scatter of the periods [dB]."""
        self.notes: list[str] = []

    @property
    def seconds(self) -> float:
        """Machine time of the play [s]."""
        return self._count * self._point.sample_time

    def __iter__(self) -> Iterator[PointProgress]:
        """Play; LimitExceededError, UnsettledError or ConnectionLostError if it was of no use."""
        period, count, is_over = self._point.period, 0, False
        highest = period.lines[-1] / (period.waveform.size * self._point.sample_time)
        try:
            for chunk in self._machine.play(self._request, float(highest), self._point.demand):
                self._store(chunk)
                if is_over:
                    continue
                count = self._count  # before the ramp out
                if self._machine.fault is None:
                    self._evaluate()
                    yield self._progress()
                is_over = self._is_enough or self._machine.fault is not None
                if self._is_enough and self._is_live:
                    self._machine.stop()
        except MachineError as error:
            if isinstance(error, ConnectionLostError):
                raise
            raise self._explained(error, self._wrong_channels(count)) from None
        is_complete = self._monitor.record_start is not None and self._periods > 0
        if self._stands(is_complete):
            raise self.standstill_error()
        if not is_complete:
            raise self._unsettled_error()

    def _explained(self, error: MachineError, wrong: str) -> MachineError:
        """Return an error of the play with its place, and with what its channels were instead of u and y."""
        parts = (f"at {self._point.frequency}: ", *error.args)
        if isinstance(error, RunawayError):
            return RunawayError(*parts, f"; {wrong}" if wrong else "")
        if not isinstance(error, LimitExceededError):
            return type(error)(*parts)
        stopped = (*error.args, f" at {self._point.frequency}; the machine was stopped")
        return LimitError(*stopped, f": {wrong}") if wrong else LimitExceededError(*stopped, reached=error.reached)

    def _unsettled_error(self) -> MachineError:
        unsettled = f"in the {self.seconds:.3g} s that were played it did not settle in time for a record"
        wrong = self._wrong_channels(self._count)
        if wrong:
            return MachineError(f"{self._point.frequency}: {unsettled}: {wrong}")
        return UnsettledError(unsettled)

    @property
    def hides_motion(self) -> bool:
        """Whether the record shows nothing but noise, although the predicted motion is far above it."""
        record = self.segment()
        is_visible = self._point.demand.stroke > VISIBLE_RATIO * float(np.ptp(record.channels["y"]))
        return is_visible and not moves_visibly([record], "y")

    def _stands(self, is_complete: bool) -> bool:
        """Return whether the position is as good as constant, or all that a play without a record shows is noise."""
        position = self._samples[self._channels.index("y"), : min(self._count, self._request.full_samples)]
        size, ramp = self._point.period.waveform.size, self._point.counts.ramp
        periods = (position.size - ramp) // size
        if periods > 0 and np.ptp(position) < LEAST_MOTION:
            return True
        if is_complete or periods < 2:  # of a record the estimators say what it shows
            return False
        block = position[ramp : ramp + periods * size].reshape(periods, size)
        return not moves_visibly([Segment(self._point.sample_time, {"y": block}, self._point.period.lines)], "y")

    def standstill_error(self) -> MachineError:
        """Return the error that the axis does not move."""
        return MachineError(
            f"at {self._point.frequency} the axis does not move: its position shows nothing but the noise and the "
            "steps of its encoder, while the control input reaches ",
            Quantity(self._guard.of_play.force, "N"),
            "; release the brake, enable the drive, check the encoder, or raise excitation.amplitude",
        )

    def _wrong_channels(self, count: int) -> str:
        """Return what the channels are instead of u and y in so many samples, and the remedy; empty if they are right,
        or not known.
        """
        setup, count = self._point.counts.experiment.setup, min(count, self._request.full_samples)
        controller = LoopController(setup.discrete.numerator[0], setup.discrete.denominator[0])
        u, y = (self._samples[self._channels.index(name), :count] for name in ("u", "y"))
        if count < MIN_JUDGED_SAMPLES or not np.isfinite(u + y).all():
            return ""
        if setup.compensation or not controller.numerator.any():
            return ""
        period = self._point.period
        shortest = period.waveform.size / period.lines[-1]
        fault = judge_play(u, y, self._request.excitation(0, count), controller, shortest)
        rotary = self._writer.header.units["y"] == "rad"
        units = {"u": "N m", "y": "rad"} if rotary else {"u": "N", "y": "m"}
        if fault is None:
            return ""
        remedy = COMPENSATION_REMEDY if fault.kind is FaultKind.COMPENSATION else CHANNEL_REMEDY
        return str(replace(fault_finding(fault, units), remedy=remedy))

    def _progress(self) -> PointProgress:
        guard, settled = self._guard, self._monitor.is_settled
        return PointProgress(
            self._point, self.seconds, settled, self._periods, self.band, guard.nearest(), guard.of_play
        )

    def _store(self, chunk: Chunk) -> None:
        """Store a chunk before it is used."""
        rows = store_chunk(self._writer, self._play, chunk)
        if chunk.note:
            self.notes.append(chunk.note)
        end = min(self._count + chunk.size, self._samples.shape[1])
        self._samples[:, self._count : end] = rows[:, : end - self._count]
        self._count += chunk.size

    def _evaluate(self) -> None:
        """Look whether it has settled, how many periods there are, and whether they are enough."""
        monitor, size = self._monitor, self._point.period.waveform.size
        # the ramp out is no part of the record
        whole = min(self._count, self._request.full_samples)
        monitor.look(self._samples[self._channels.index("y"), :whole])
        if monitor.record_start is None:
            return
        self._periods = max(whole - monitor.record_start, 0) // size
        fewest = max(self._record // size, 1)
        if self._goal is None:
            self._periods = min(self._periods, fewest)
            self._is_enough = self._periods == fewest
            if self._is_enough and fewest > 1:
                self.band = scatter_band(self.segment())
            return
        self._periods = min(self._periods, max(self._longest // size, fewest))
        if self._periods >= max(self._next_look, MIN_BAND_PERIODS, fewest):
            self.band = scatter_band(self.segment())
            self._next_look = int(np.ceil(BAND_GROWTH * self._periods))
            projected = self.band * np.sqrt((self._periods * size) / self._longest)
            self.is_hopeless = projected > HOPELESS_RATIO * self._goal
            is_long = (self._periods + 1) * size > self._longest
            self._is_enough = self.band <= self._goal or is_long or (self.is_hopeless and not self._is_patient)

    def segment(self) -> Segment:
        """Return the recorded periods."""
        start, size = self._monitor.record_start or 0, self._point.period.waveform.size
        blocks = self._samples[:, start : start + self._periods * size].reshape(len(self._channels), -1, size)
        channels = {name: block.copy() for name, block in zip(self._channels, blocks, strict=True)}
        return Segment(self._point.sample_time, channels, self._point.period.lines)

    def result(self, machine_time: float, repeats: tuple[str, ...]) -> MeasuredPoint:
        """Return the point; `machine_time` [s] and `repeats` are those of plays in vain before."""
        monitor, period = self._monitor, self._point.period
        residual = float(monitor.residual)
        return MeasuredPoint(
            number=self._point.number,
            frequency=self._point.frequency,
            amplitude=self._point.amplitude,
            rest=self._rest,
            start=self._rest + (monitor.record_start or 0),
            periods=self._periods,
            samples=period.waveform.size,
            harmonics=tuple(int(line) for line in period.lines),
            settled=monitor.is_settled,
            residual=residual if np.isfinite(residual) else None,
            machine_time=machine_time + self.seconds,
            repeats=(*repeats, *self.notes),
            band=self.band,
            used=self._guard.nearest(),
            expected=self._point.expected_amplitudes,
            excitation=self._point.excitation_at(monitor.record_start or 0),
        )


def scatter_band(segment: Segment) -> float:
    """Return the half-width [dB] of the 95 % band of y/u by the scatter of its periods, at the widest line."""
    signals = Signals((segment,), {"u": "N", "y": "m"})
    sums = [[phasors(segment, name)] for name in ("u", "y")]
    found = response_result(signals, *sums, names=("u", "y"), units=("N", "m")).response
    band = None if found is None else noise_band(found)
    return float("inf") if band is None else band


def noise_band(response: FrequencyResponse) -> float | None:
    """Return the half-width [dB] of a response's 95 % band by noise alone, at the frequency where it is widest.

    It is infinite where noise hides the response, and None if the band is not known, as from one period.
    """
    by_noise = replace(response, model_covariance=None, numerical_error=None)
    if np.isnan(by_noise.covariance).any():
        return None
    return half_width(np.asarray(confidence_limits(by_noise).magnitude))


def half_width(magnitude: NDArray[np.float64]) -> float:
    """Return the half-width [dB] of the widest of limits relative to their magnitudes, shape (2, n)."""
    low, high = magnitude
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low > 0).all()):
        return float("inf")
    return float(np.max(10 * np.log10(high / low)))
