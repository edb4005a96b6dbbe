"""The friction loop of an unknown axis: a slow sine that grows until the axis slides, or comes near a limit."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.quantisation import grid_step
from fraexp.components.machine_session import PlayRequest
from fraexp.components.periods import Period
from fraexp.data.findings import Quantity
from fraexp.data.sample_file import SampleWriter
from fraexp.errors import MachineError
from fraexp.measurement.measured_points import store_chunk
from fraexp.measurement.motion_guard import LimitExceededError
from fraexp.measurement.unknown_axis import UnknownAxis
from fraexp.measurement.watched_machine import WatchedMachine

LOOP_HZ = 2.0
"""Frequency of the slow sine."""
CYCLES, START_RATIO = 48, 1e-3
"""Cycles in which the sine grows to the limit of the force, and its part of that at the start: it grows by 16 % in a
cycle, and by little until a limit that comes near has stopped it."""
GROWTH_CYCLES, MAX_GROWTH = 4, 1.1
"""Cycles over which friction and peak force are compared, and their growth up to which they have reached their end."""
CLOSED_RATIO, SLIDING_RATIO = 0.5, 0.5
"""Friction over the peak force that a loop reaches before it slides, and below which it falls when it slides."""
MIN_DRY_RATIO = 0.1
"""Dry part of the friction force below which it is not told from the rest: then no cycle has slid."""
MIN_MOTION, STANDSTILL = 30.0, 8.0
"""Motion over noise from which a loop is looked at, and up to which an axis stands: noise itself has a range."""
FREE_RATIO = 1 / 6
"""Greatest amplitude that is taken for friction where no loop closes, over that at which a limit came near."""


@dataclass(frozen=True)
class FrictionLoop:
    """What the slow sine shows."""

    force: float
    """Friction force in sliding [N] without its viscous part; where no loop closes, the amplitude in its place."""
    has_closed: bool
    """Whether the axis slides against friction."""
    noise: float
    """Standard deviation of the position at rest [m]."""
    resolution: float
    """Least step of the recorded position [m]; 0 if it has none."""
    amplitude: float
    """Amplitude that was reached [N]."""

    @property
    def position_noise(self) -> float:
        """Standard deviation of the position in motion [m]: at rest an encoder may stay at one of its steps."""
        return float(np.hypot(self.noise, self.resolution / np.sqrt(12)))


def measure_friction_loop(
    axis: UnknownAxis, machine: WatchedMachine, writer: SampleWriter, period: Period
) -> FrictionLoop:
    """Play a slow sine from nothing on until the friction loop has closed; all of it is stored first.

    Raises MachineError where the axis does not move at all within its limits, or moves by itself.
    """
    rest = machine.rest
    noise = float(np.std(rest))
    force_limit = axis.limits.force
    assert force_limit is not None
    watch = _LoopWatch(period.waveform.size, max(noise, grid_step(rest)))
    wave = axis.share * force_limit * growing_wave(period.waveform)
    motion = _record_play(machine, writer, PlayRequest(1, wave, 1, ramp_out=axis.ramp_out), watch)
    return watch.loop(noise, grid_step(motion[0]))  # at rest an encoder may show one of its steps alone


def growing_wave(cycle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return repetitions of a cycle that grow by the same factor in equal times, to the size of the given one."""
    growth = np.linspace(np.log(START_RATIO), 0.0, CYCLES * cycle.size)
    return np.tile(cycle, CYCLES) * np.exp(growth)


class _LoopWatch:
    """Looks at each whole cycle of the growing sine."""

    def __init__(self, size: int, noise: float) -> None:
        self._size, self._noise = size, noise
        self.forces: list[float] = []
        """Friction force of each cycle, by the energy that it takes [N]."""
        self.swings: list[float] = []
        """Stroke of each cycle [m]."""
        self.peaks: list[float] = []
        """Peak control input of each cycle [N]."""
        self.works: list[float] = []
        """Mean product of control input and position of each cycle [N m]: above 0 if springs take the input, below 0 if
        mass does."""

    def look(self, position: NDArray[np.float64], force: NDArray[np.float64]) -> bool:
        """Take note of complete cycles; return whether the loop has closed."""
        while (len(self.peaks) + 1) * self._size <= position.size:
            part = slice(len(self.peaks) * self._size, (len(self.peaks) + 1) * self._size)
            y, u = position[part], force[part]
            swing = float(np.ptp(y))
            energy = abs(float(np.sum(0.5 * (u[1:] + u[:-1]) * np.diff(y))))
            self.forces.append(energy / (2 * swing) if swing > MIN_MOTION * self._noise else 0.0)
            self.swings.append(swing)
            self.peaks.append(float(np.abs(u).max()))
            self.works.append(float(np.mean((u - u.mean()) * (y - y.mean()))))
        return self.has_closed

    @property
    def ratios(self) -> NDArray[np.float64]:
        """Friction over peak force of each cycle, shape (n,)."""
        return np.array(self.forces) / np.maximum(self.peaks, 1e-300)

    @property
    def has_closed(self) -> bool:
        """Whether friction took most of the force in some cycle, and now takes less than half of it, or grows no more.

        It grows no more, although the excitation does, where the feedback takes the rest of the excitation. Mass or
        feedback has to take the rest: springs do where a part of the bristles or elements has slipped alone.
        """
        ratios = self.ratios
        if ratios.size <= GROWTH_CYCLES or ratios.max() <= CLOSED_RATIO:
            return False
        before, now = self.forces[-1 - GROWTH_CYCLES], self.forces[-1]
        is_moved, is_held = self.works[-1] < 0, self.peaks[-1] < MAX_GROWTH * self.peaks[-1 - GROWTH_CYCLES]
        slides = is_moved and 0 < ratios[-1] < SLIDING_RATIO
        return bool(slides or ((is_moved or is_held) and 0 < now < MAX_GROWTH * before))

    def dry_force(self) -> float:
        """Return the friction force of the last cycle [N] without the part that grows with the stroke: the viscous one.

        The viscous force of a sine is proportional to its stroke, so that a line through two cycles separates both.
        """
        last, now = self.swings[-1], self.forces[-1]
        earlier, before = (self.swings[-2], self.forces[-2]) if len(self.swings) > 1 else (last, now)
        dry = (before * last - now * earlier) / (last - earlier) if last > earlier else now
        return min(dry, now)

    def _standstill(self) -> MachineError:
        """Return what a record without a loop shows; only an axis that stands lets a limit be raised."""
        swing, peak = max(self.swings, default=0.0), max(self.peaks, default=0.0)
        if not self.swings:
            return MachineError(
                "a limit was reached within the first cycle: compare limits, and units of y and u, with the axis"
            )
        greatest = Quantity(peak, "N")
        if swing > STANDSTILL * self._noise:
            beside = (", which is too little beside the noise of ", Quantity(self._noise, "m"))
            remedy = " to show its friction: a finer encoder is needed"
            return MachineError("the axis moves by ", Quantity(swing, "m"), " up to ", greatest, *beside, remedy)
        return MachineError(
            "the axis does not move within its limits: nothing but noise was recorded up to ",
            greatest,
            "; enable the drive, release the brake, check the encoder, or raise limits.force",
        )

    def loop(self, noise: float, resolution: float) -> FrictionLoop:
        """Return what all cycles show."""
        if not self.peaks or not any(self.forces):
            raise self._standstill()
        dry, now, free = self.dry_force(), self.forces[-1], FREE_RATIO * self.peaks[-1]
        took_most = bool(self.ratios.max() > CLOSED_RATIO)
        slides = took_most or dry > free  # of a heavy axis mass takes the most, and bristles may still bend
        force = dry if took_most and dry > MIN_DRY_RATIO * now else now
        return FrictionLoop(force if slides else free, slides, noise, resolution, self.peaks[-1])


def _record_play(
    machine: WatchedMachine, writer: SampleWriter, request: PlayRequest, watch: _LoopWatch
) -> NDArray[np.float64]:
    """Return position and control input of a play, shape (2, n), which ends when the watch is content or at a limit."""
    found, play, is_over = np.empty((2, 0)), writer.last_play() + 1, False
    with suppress(LimitExceededError):  # it was stopped, and shows friction up to there
        for chunk in machine.play(request, LOOP_HZ):
            store_chunk(writer, play, chunk)
            found = np.hstack([found, [chunk.channels["y"], chunk.channels["u"]]])
            is_over = is_over or machine.fault is not None
            if not is_over and watch.look(*found):
                machine.stop()
                is_over = True
    machine.await_rest()
    return found
