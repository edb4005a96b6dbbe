"""A machine's motion, watched from the first sample to the last: its limits, its rest, and a loop that runs away.

Three laws hold for a sound axis. It stays within its limits; without an excitation it comes to rest; and its feedback
does no more work than the excitation. A loop that breaks the second or the third law moves by itself. It goes on when
the excitation has ended: its drive must be switched off.
"""

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.quantisation import grid_step
from fraexp.components.machine_session import Chunk
from fraexp.data.findings import Quantity
from fraexp.errors import LimitError, MachineError
from fraexp.simulation.motion_limits import DEMAND_UNITS, NO_DEMAND, Demand, MotionLimits

DIFFERENCE_TIME_S = 1e-3
"""Time over which the position is differenced: the encoder's steps then count little."""
MAX_CYCLES = 0.4
"""Cycles of the highest frequency in that time at most: with half a cycle a sine differenced would show nothing."""
OVERRUN_RATIO = 1.1
"""Motion over a limit that follows a stop at most: what goes on beyond that is no consequence of the excitation."""
LOOKED_AHEAD = ("stroke", "velocity")
"""What goes on growing while an excitation is stopped: a motion does, near a resonance for long."""
REST_RATIO = 1e-3
"""Part of the stroke limit by which an axis at rest may move: it creeps, and what stands beside it shakes it."""
MIN_REST_SAMPLES, REST_PARTS = 60, 4
"""Samples from which the rest is judged, and parts of it whose means show a drift."""
RUNAWAY_GROWTH, DRIFT_GROWTH, STEADY_GROWTH = 1.5, 1.1, 0.95
"""Motion of the later half over that of the earlier one, above which an axis runs away at once; above which a drift,
and an oscillation, do not end however long they are awaited."""
NOISE_RANGE, DRIFT_STEPS, DRIFT_STDS = 8.0, 2.0, 5.0
"""Range of noise in its standard deviations; and drift that is visible, in steps of the encoder and in standard
deviations of a mean."""
FEEDBACK_RATIO, GIVEN_RATIO, SLOW_HZ = 3.0, 0.75, 5.0
"""Work of the feedback, and up to a frequency [Hz] energy that an axis seems to give, both over the work that
excitation and axis exchange. Dead times explain as much: the recorded control input acts later."""
MEMORY_S = 0.5
"""Time in which earlier work is forgotten."""
HARMLESS_WORK = 1e-4
"""Work, over that of the greatest force along the whole stroke, that means nothing: an axis creeps."""
SIGN_REMEDY = "check the signs of encoder and drive"
GAIN_REMEDY = "check the controller: its sign, its gain, and a friction compensation beside it"


class LimitExceededError(MachineError):
    """A limit was exceeded by an excitation, which was stopped."""

    def __init__(self, *parts: object, reached: float) -> None:
        super().__init__(*parts)
        self.reached = reached
        """Part of the limit that was reached."""


class NotFiniteError(MachineError):
    """Samples are no numbers: nobody knows what the machine does."""


class RunawayError(LimitError):
    """The loop moves by itself, and does not end with the excitation."""


def _work(force: NDArray[np.float64], motion: NDArray[np.float64]) -> float:
    """Return the work [J] of a force, shape (n,), along motions between its samples, shape (n - 1,)."""
    return float((force[1:] + force[:-1]) @ motion) / 2


class MotionGuard:
    """Compares recorded motion with limits and with the work of the excitation.

    What it has seen goes on from one play to the next.
    """

    def __init__(self, limits: MotionLimits, sample_time: float, share: float = 1.0) -> None:
        self.limits, self._sample_time = limits, sample_time
        self.share = share
        """Part of each limit that may be reached."""
        self._low, self._high = self._range_before = np.inf, -np.inf
        self._was_exceeded = False
        self.rest_force = self.rest_power = 0.0
        """Control input at rest [N], which holds a load, and work of its noise in a sample, without its sign [J]."""
        self._work = np.zeros(4)  # of excitation and feedback, what excitation and axis exchange, and that of noise [J]
        self.begin(0.0)

    def begin(self, highest_frequency: float, stop_samples: int = 0, expected: Demand = NO_DEMAND) -> None:
        """Begin a play of a highest frequency [Hz], which goes on for so many samples after a stop.

        A motion that becomes greater than was `expected` may reach a limit in that time, as at a resonance that nobody
        knows: it is stopped where it would if it grew as fast as it ever did in this play.

        The range of positions goes on from those before, but for plays that exceeded a limit: played again with a lower
        amplitude, a point would exceed it at once.
        """
        if self._was_exceeded:
            self._low, self._high = self._range_before
        self._range_before, self._was_exceeded = (self._low, self._high), False
        lag = max(round(DIFFERENCE_TIME_S / self._sample_time), 1)
        if highest_frequency:
            lag = max(min(lag, int(MAX_CYCLES / (highest_frequency * self._sample_time))), 1)
        self._lag, self._is_slow = lag, highest_frequency <= SLOW_HZ
        self._correction = 1 / float(np.sinc(min(highest_frequency * lag * self._sample_time, MAX_CYCLES)))
        self._last = np.empty((2, 0))
        self._stop_samples, self._expected = stop_samples, expected
        begun = NO_DEMAND._replace(stroke=max(self._high - self._low, 0.0))
        self._course, self._growth = [(0, begun)], NO_DEMAND
        self.of_play = NO_DEMAND
        """The greatest motion and force of this play."""

    def look(self, chunk: Chunk, excitation: NDArray[np.float64] | None = None) -> MachineError | None:
        """Take note of what was recorded; return what is wrong with it, if anything.

        With an excitation [N], shape (n,), the work of the feedback is compared with its work.

        The first limit that is exceeded is an error of the excitation; when that is being stopped, and the motion goes
        on beyond the limit, it is one of the loop.
        """
        position, force = chunk.channels["y"], chunk.channels["u"]
        for name, samples in (("y", position), ("u", force)):
            if not np.isfinite(samples).all():
                return NotFiniteError(
                    f"the machine recorded values that are not finite numbers in channel {name}, and was stopped: fix "
                    "what it records"
                )
        found = self._demand(position, force)
        self.of_play = self.of_play.maximum_with(found)
        runaway = None if excitation is None else self._runaway(position, force, excitation)
        self._follow_growth(chunk.size)
        return runaway or self._exceeded(found)

    def nearest(self) -> float:
        """Return the greatest part of a limit that this play has reached."""
        return max(
            value / allowed
            for name, value in self.of_play._asdict().items()
            if (allowed := getattr(self.limits, name)) is not None
        )

    def _follow_growth(self, size: int) -> None:
        """Note by how much the greatest motion grew in the time of a stop, which a chunk delays by its own time."""
        count = self._course[-1][0] + size
        self._course.append((count, self.of_play))
        while self._course[1][0] <= count - self._stop_samples - size:
            del self._course[0]
        growth = np.subtract(self.of_play, self._course[0][1])
        self._growth = self._growth.maximum_with(Demand(*growth.tolist()))

    def _exceeded(self, found: Demand) -> MachineError | None:
        share = OVERRUN_RATIO if self._was_exceeded else self.share
        for name, value, unit in zip(Demand._fields, found, DEMAND_UNITS, strict=True):
            allowed = getattr(self.limits, name)
            is_ahead = not self._was_exceeded and name in LOOKED_AHEAD and value > getattr(self._expected, name)
            growth = getattr(self._growth, name) if is_ahead else 0.0
            if allowed is None or value + growth <= share * allowed:
                continue
            parts: tuple[object, ...] = (f"the {name.replace('_', ' ')} was ", Quantity(value, unit))
            if self._was_exceeded:
                return RunawayError(*parts, f", and rose on while the excitation was stopped: {GAIN_REMEDY}")
            self._was_exceeded = True
            if value <= share * allowed:
                parts += (", and may grow by ", Quantity(growth, unit), " until a stop has ended")
            part = "" if share == 1 else f"{share:.0%} of "
            limit = (f"; {part}limits.{name} is ", Quantity(share * allowed, unit))
            return LimitExceededError(*parts, *limit, reached=max(self.nearest(), (value + growth) / allowed))
        return None

    def _runaway(
        self, position: NDArray[np.float64], force: NDArray[np.float64], excitation: NDArray[np.float64]
    ) -> RunawayError | None:
        """Return an error if the feedback has done more work than the excitation, or the axis has given energy.

        It is the feedback then that moves the axis. If it does so against the force that is recorded, y and u have
        opposite signs; at low frequencies, where dead times shift nothing, an axis that gives energy shows it earlier.
        """
        motion = np.diff(position)
        force = force - self.rest_force
        self._work *= np.exp(-position.size * self._sample_time / MEMORY_S)
        exchanged = float(np.abs(excitation[1:]) @ np.abs(motion))
        done = [
            _work(excitation, motion),
            _work(force - excitation, motion),
            exchanged,
            self.rest_power * position.size,
        ]
        self._work += np.array(done)
        excited, fed_back, exchanged, noise = self._work.tolist()
        stroke, most = self.limits.stroke, self.limits.force
        assert stroke is not None and most is not None
        harmless = noise + HARMLESS_WORK * stroke * most
        if abs(fed_back) > FEEDBACK_RATIO * exchanged + harmless:
            remedy = SIGN_REMEDY if fed_back < 0 else GAIN_REMEDY
            return RunawayError(f"the feedback moves the axis more than the excitation does: {remedy}")
        if self._is_slow and excited + fed_back < -GIVEN_RATIO * exchanged - harmless:
            return RunawayError(f"the axis moves against the force on it: {SIGN_REMEDY}")
        return None

    def _demand(self, position: NDArray[np.float64], force: NDArray[np.float64]) -> Demand:
        both = np.hstack([self._last, [position, force]])
        self._last = both[:, -2 * self._lag :]
        self._low, self._high = min(self._low, position.min()), max(self._high, position.max())
        lag, step = self._lag, self._lag * self._sample_time
        velocity = np.abs(both[0, lag:] - both[0, :-lag]).max(initial=0.0) / step
        acceleration = (
            np.abs(both[0, 2 * lag :] - 2 * both[0, lag:-lag] + both[0, : -2 * lag]).max(initial=0.0) / step**2
        )
        rate = np.abs(np.diff(both[1])).max(initial=0.0) / self._sample_time
        return Demand(
            float(self._high - self._low),
            float(velocity * self._correction),
            float(acceleration * self._correction**2),
            float(np.abs(force).max()),
            float(rate),
        )


class RestWatch:
    """Looks whether an axis that is not excited is at rest, or comes to rest."""

    def __init__(self, limits: MotionLimits, sample_time: float, stroke_before: float = 0.0) -> None:
        """Take limits, the sample time [s] and the stroke of the play before [m]: within it an axis may ring on."""
        self._guard, self._sample_time = MotionGuard(limits, sample_time, OVERRUN_RATIO), sample_time
        self._stroke_before, self._samples = stroke_before, np.empty((2, 0))

    @property
    def position(self) -> NDArray[np.float64]:
        """All positions so far [m], shape (n,)."""
        return np.asarray(self._samples[0])

    @property
    def force(self) -> float:
        """The control input that holds the axis at the end [N]."""
        return float(np.mean(self._samples[1, -(self.position.size // 4) :]))

    @property
    def power(self) -> float:
        """Work of noise in a sample, without its sign [J]."""
        feedback = self._samples[1, -(self.position.size // 4) :] - self.force
        return float(np.mean(np.abs(feedback[1:]) * np.abs(np.diff(self.position[-feedback.size :]))))

    def look(self, chunk: Chunk) -> MachineError | None:
        """Take note of what was recorded; return an error as soon as the axis moves far, and more and more."""
        self._samples = np.hstack([self._samples, [chunk.channels["y"], chunk.channels["u"]]])
        fault = self._guard.look(chunk)
        if isinstance(fault, LimitExceededError):
            return RunawayError("the axis moves by itself: without an excitation ", *fault.args, f": {self._remedy}")
        is_judged = self.position.size >= MIN_REST_SAMPLES and np.ptp(self.position) > self._stroke_before
        return fault or (self.error() if is_judged and self._moves_far and self._growth > RUNAWAY_GROWTH else None)

    @property
    def is_at_rest(self) -> bool:
        """Whether the axis hardly moves any more."""
        return not self._drifts and not self._moves_far

    @property
    def goes_on(self) -> bool:
        """Whether the axis moves far, and does not become slower: it may creep home for long, at the same speed."""
        return self._moves_far and self._growth > (DRIFT_GROWTH if self._drift else STEADY_GROWTH)

    @property
    def _moves_far(self) -> bool:
        """Whether the later half moves by more than an axis at rest may, and than noise explains."""
        allowed, later = self._guard.limits.stroke, self.position[self.position.size // 2 :]
        assert allowed is not None
        noise = float(np.sqrt(np.mean(np.diff(later) ** 2) / 2))
        return float(np.ptp(later)) > REST_RATIO * allowed + NOISE_RANGE * noise

    @property
    def _growth(self) -> float:
        """Motion of the later half over that of the earlier one."""
        earlier, later = (float(np.ptp(part)) for part in np.array_split(self.position, 2))
        return later / earlier if earlier else np.inf

    @property
    def _drifts(self) -> bool:
        """Whether the mean position still moves visibly at the end."""
        position = self.position
        before, now = np.split(position[-2 * (position.size // 4) :], 2)
        noise = np.sqrt(np.mean(np.diff(position) ** 2) / now.size)
        return bool(abs(now.mean() - before.mean()) > DRIFT_STEPS * grid_step(position) + DRIFT_STDS * noise)

    def error(self) -> RunawayError:
        """Return the error that the axis moves by itself."""
        seconds = self.position.size * self._sample_time
        return RunawayError(
            "the axis moves by itself: ",
            Quantity(float(np.ptp(self.position)), "m"),
            f" in {seconds:.3g} s without an excitation: {self._remedy}",
        )

    @property
    def _drift(self) -> tuple[float, float] | None:
        """How far position [m] and control input [N] went, if the axis went one way."""
        samples = self._samples[:, : REST_PARTS * (self.position.size // REST_PARTS)]
        means = samples.reshape(2, REST_PARTS, -1).mean(axis=2)
        moved, pushed = (means[:, -1] - means[:, 0]).tolist()
        return (moved, pushed) if abs(moved) > np.ptp(self.position) / 2 else None

    @property
    def _remedy(self) -> str:
        is_against = self._drift is not None and self._drift[0] * self._drift[1] < 0
        return SIGN_REMEDY if is_against else GAIN_REMEDY
