"""The equation of a loop, u = w - C y, in a record whose excitation w and controller C are known, and what breaks it.

It holds sample by sample whatever the plant and its friction are, so that no prediction of the motion is needed. Each
thing that may have happened to a column is a hypothesis with at most one unknown, which least squares give. An F test
tells whether one explains what is left of the equation; if none does, the record contradicts its own loop.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import fourier_sums
from fraexp.analysis.quantisation import grid_step
from fraexp.analysis.tolerances import SIGNIFICANCE
from fraexp.data.findings import Finding
from fraexp.data.signals import Segment
from fraexp.records.cutting import Cut

TOLERANCE = 0.01
"""Standard deviation of each term, relative to it: gains of converters, and numbers that were rounded."""
MAX_MISFIT = 3.0
"""Residual in standard deviations up to which the equation holds: a gain is off at all lines alike, so that more of
them do not narrow it."""
NUMERICAL_MISFIT = 1e-3
"""Misfit that Fourier sums and decimal numbers leave: explanations that leave less are equally good."""
MAX_SHIFT, MAX_BEGIN = 20, 3
"""Samples by which a channel may be late or early, as buffers hold it back, and by which a record may begin so."""
MAX_USUAL_GAIN = 1.4
"""Gain of the excitation's path, either way, that does no harm: a response is that of u and y, whatever was played."""


class FaultKind(Enum):
    """What a record's columns have to do with what was to be recorded."""

    ALONE = auto()
    """u is the excitation, without the feedback."""
    FEEDBACK = auto()
    """u is the feedback, without the excitation."""
    INPUT_FACTOR = auto()
    OUTPUT_FACTOR = auto()
    INPUT_SHIFT = auto()
    OUTPUT_SHIFT = auto()
    INPUT_LAG = auto()
    OUTPUT_LAG = auto()
    EXCITATION_FACTOR = auto()
    SWAPPED = auto()
    BEGUN_LATE = auto()
    LOST_ROWS = auto()
    CLOCK = auto()
    UNEVEN = auto()
    """The excitation is whole, and its time neither stands nor runs evenly."""
    COMPENSATION = auto()
    """u has a force that follows the direction of motion, too."""
    UNKNOWN = auto()
    """Nothing of these: another controller."""


SCALES = {FaultKind.OUTPUT_FACTOR: "feedback", FaultKind.INPUT_FACTOR: "input"}
SHIFTS = {
    FaultKind.BEGUN_LATE: "excitation", FaultKind.OUTPUT_SHIFT: "feedback", FaultKind.INPUT_SHIFT: "input",
}  # fmt: skip
LAGS = {FaultKind.OUTPUT_LAG: "feedback", FaultKind.INPUT_LAG: "input"}
"""Terms that have a factor, are early where something is late, or are filtered."""


class LoopFault(NamedTuple):
    """What breaks the equation."""

    kind: FaultKind
    factor: float = 1.0
    """Column, or the record's sample time, over what it should be; of a compensation its force [N]."""
    samples: float = 0.0
    """Samples by which it is late, rows that are lost, or T of the low-pass 1/(1 + T (1 - z⁻¹)) that it has passed."""
    error: float = 0.0
    """Relative error of the response that it causes at most; 0 if that is not known."""


@dataclass(frozen=True)
class LoopTerm:
    """One term of the equation."""

    values: NDArray[np.complex128]
    """At the excited lines of each period, or sample by sample [N], shape (n,)."""
    noise: NDArray[np.float64] | float = 0.0
    """Its standard deviation by scatter and rounding [N], shape (n,)."""

    def __mul__(self, factor: "float | NDArray[np.complex128]") -> "LoopTerm":
        return LoopTerm(self.values * factor, self.noise * np.abs(factor))


@dataclass(frozen=True)
class LoopTerms:
    """The terms of the equation, each of shape (n,)."""

    input: LoopTerm
    """Control input u."""
    excitation: LoopTerm
    """What was to be played, w."""
    feedback: LoopTerm
    """What the controller makes of the position, C y."""
    angle: NDArray[np.float64] | float = 0.0
    """Phase that a sample of delay takes [rad]; 0 if no delay is looked for."""

    @property
    def misfit(self) -> float:
        """Root mean square of the residual in standard deviations."""
        return self._size(self._residual)

    @property
    def shows_feedback(self) -> bool:
        """Whether a position that is not there, or has the opposite sign, would break the equation."""
        return self._size(self.feedback.values) > MAX_MISFIT

    def scaled(self, name: str, factor: "float | NDArray[np.complex128]") -> "LoopTerms":
        """Return the terms with one of them multiplied."""
        return replace(self, **{name: getattr(self, name) * factor})

    def advanced(self, name: str, samples: float) -> "LoopTerms":
        """Return the terms with one of them earlier."""
        return self.scaled(name, np.exp(1j * np.asarray(self.angle) * samples))

    def unknown(self, name: str, change: "float | NDArray[np.complex128]" = 1.0) -> float:
        """Return the real x of a factor 1 + x `change` on a term that leaves least of the equation; 0 if none helps."""
        of = change * getattr(self, name).values / self._deviation
        energy = float(np.sum(np.abs(of) ** 2))
        agreement = float(np.sum(np.real(np.conj(of) * self._residual / self._deviation)))
        return (agreement if name == "excitation" else -agreement) / energy if energy else 0.0

    def delay(self, name: str, most: int) -> float:
        """Return the samples, up to about as many, by which a term is late to the others."""
        whole = range(-most, most + 1)
        found = float(min(whole, key=lambda samples: self.advanced(name, samples).misfit))
        for _ in range(NEWTON_STEPS):
            found += self.advanced(name, found).unknown(name, 1j * np.asarray(self.angle))
        return float(np.clip(found, -most - 0.5, most + 0.5))

    @property
    def _residual(self) -> NDArray[np.complex128]:
        return self.input.values - self.excitation.values + self.feedback.values

    @property
    def _deviation(self) -> NDArray[np.float64]:
        """Standard deviation of the residual [N]."""
        squares = [
            (TOLERANCE * np.abs(of.values)) ** 2 + of.noise**2 for of in (self.input, self.excitation, self.feedback)
        ]
        return np.asarray(np.maximum(np.sqrt(sum(squares)), np.finfo(float).tiny))

    def _size(self, residual: NDArray[np.complex128]) -> float:
        return float(np.sqrt(np.mean(np.abs(residual / self._deviation) ** 2)))


NEWTON_STEPS = 4
"""Steps from whole samples to the best delay: each doubles its digits."""


def find_fault(terms: LoopTerms, swapped: LoopTerms | None = None) -> LoopFault | None:
    """Return what breaks the equation; None if it holds, or if what has happened does no harm.

    `swapped` are the terms of the record with u and y exchanged. A hypothesis explains if the equation holds with it,
    and fits significantly better than without: where the feedback is weak the equation nearly holds whatever y is. Of
    those that explain equally well, the most usual counts.
    """
    from scipy.special import fdtri  # a fifth of a second, and only records of known loops need it

    before, free = terms.misfit, max(2 * terms.input.values.size - 1, 1)
    found = [(max(of.misfit, NUMERICAL_MISFIT), fault) for fault, of in _hypotheses(terms, swapped)]
    best = min(misfit for misfit, _ in found)
    chance = 1 - SIGNIFICANCE / len(found)
    explains = (before / best) ** 2 - 1 > fdtri(1, free, chance) / free and best <= MAX_MISFIT
    if not explains:
        return LoopFault(FaultKind.UNKNOWN) if before > MAX_MISFIT else None
    alike = best * np.sqrt(fdtri(free, free, chance))
    fault = next(fault for misfit, fault in found if misfit <= min(alike, MAX_MISFIT))
    if fault.kind in (FaultKind.BEGUN_LATE, FaultKind.EXCITATION_FACTOR) and is_usual(fault.factor):
        return None  # the response of u and y is right all the same
    return fault._replace(error=_response_error(fault, terms))


def _response_error(fault: LoopFault, terms: LoopTerms) -> float:
    if fault.kind in SCALES:
        return abs(fault.factor - 1)
    return abs(fault.samples) * float(np.max(terms.angle)) if fault.kind in (*SHIFTS, *LAGS) else 0.0


def _hypotheses(terms: LoopTerms, swapped: LoopTerms | None) -> Iterator[tuple[LoopFault, LoopTerms]]:
    """Yield what may have happened, with the terms as they were before it; the most usual comes first."""
    gain, change = 1 + terms.unknown("excitation"), np.asarray(1 - np.exp(-1j * np.asarray(terms.angle)), dtype=complex)
    played = LoopFault(FaultKind.EXCITATION_FACTOR, gain), terms.scaled("excitation", gain)
    if is_usual(gain):
        yield played
    yield LoopFault(FaultKind.ALONE), terms.scaled("feedback", 0.0)
    yield LoopFault(FaultKind.FEEDBACK), terms.scaled("excitation", 0.0)
    for kind, name in SCALES.items():
        if share := 1 + terms.unknown(name):
            yield LoopFault(kind, 1 / share), terms.scaled(name, share)
    if np.any(terms.angle):
        for kind, name in SHIFTS.items():
            samples = terms.delay(name, MAX_BEGIN if kind is FaultKind.BEGUN_LATE else MAX_SHIFT)
            yield LoopFault(kind, samples=samples), terms.advanced(name, samples)
        for kind, name in LAGS.items():
            samples = max(terms.unknown(name, change), 0.0)
            yield LoopFault(kind, samples=samples), terms.scaled(name, np.asarray(1 + change * samples, dtype=complex))
    if swapped is not None:
        yield LoopFault(FaultKind.SWAPPED), swapped
    if not is_usual(gain):
        yield played


def is_usual(gain: float) -> bool:
    """Return whether so much of an excitation does no harm if it is played in place of it."""
    return 1 / MAX_USUAL_GAIN <= gain <= MAX_USUAL_GAIN


CLEAR_SPEED = 0.5
"""Speed relative to the greatest one from which the direction is clear, also if the force is a few samples late."""
SPEED_SPAN = 1 / 16
"""Part of the shortest period over which a speed is taken: encoders are coarse."""


def direction_force(
    residual: NDArray[np.float64], position: NDArray[np.float64], shortest: float, deviation: float
) -> float:
    """Return the force [N] with which a residual [N] follows the direction of motion; 0 if it does not.

    Both are sample by sample, shape (n,), `shortest` is the shortest period in them [samples], and `deviation` the
    standard deviation of the residual [N]. A force in proportion to the speed is another controller's answer.
    """
    span = max(round(SPEED_SPAN * shortest), 1)
    speed = position[span:] - position[:-span]
    if not speed.any():
        return 0.0
    sums = np.cumsum(residual)
    force = (sums[span:] - sums[:-span]) / span
    clear = np.abs(speed) > CLEAR_SPEED * np.abs(speed).max()
    speed, force = speed[clear] / np.abs(speed).max(), force[clear]
    terms = np.array([np.sign(speed), speed, np.ones(speed.size)]).T
    factors = np.linalg.lstsq(terms, force, rcond=None)[0]
    by_speed = terms[:, 1:] @ np.linalg.lstsq(terms[:, 1:], force, rcond=None)[0]
    left, left_by_speed = (float(np.sqrt(np.mean((force - of) ** 2))) for of in (terms @ factors, by_speed))
    follows = left < MAX_MISFIT * deviation < left_by_speed
    return max(float(factors[0]), 0.0) if follows else 0.0


MAX_LATE_S = 20.0
"""Greatest time by which the beginning of a record is looked for."""
MAX_LATE_LINES = 60
"""Lines by which it is looked for: more of them take time alone."""
ALIKE_AGREEMENT = 1e-4
"""Difference of the mean cosine of phases up to which delays are as good as each other."""
MAX_ROWS, MAX_LOSSES, MAX_CLOCK_ERROR, MAX_PHASES = 1000, 5, 1e-2, 500
"""Rows that may be lost in one place, places, difference of clocks, and the phases by which they are looked for."""
STEADY_SHARE = 0.75
"""Part of the phases that must agree: those of the period with the loss do not, nor do those of a ramp."""
HARMLESS_SHARE = 0.01
"""Part of a record by which it may begin late or early: the rest of it is as periodic."""
UNTIMELY = (FaultKind.UNKNOWN, FaultKind.EXCITATION_FACTOR, FaultKind.FEEDBACK, FaultKind.SWAPPED)
"""Faults of which a record is cleared that shows the excitation whole, at another time: periods then scatter, so that
anything explains them."""
WRONG_NUMBERS = (FaultKind.INPUT_FACTOR, FaultKind.OUTPUT_FACTOR, FaultKind.EXCITATION_FACTOR)
PLAIN_FACTOR = 2.0
"""Faults for which a motion is beyond a limit, or does not settle, that would not otherwise, and the factor, either
way, from which one is not taken for another controller's gain."""


class LoopController(NamedTuple):
    """C(z), from position to control input, in ascending powers of z⁻¹."""

    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]

    def applied(self, samples: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return samples filtered by a polynomial of it, shape (n,), as if the last ones came before the first."""
        order = part.size - 1
        return np.convolve(np.concatenate([samples[samples.size - order :], samples]), part, mode="valid")

    def answer(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what it makes of a position from rest on, shape (n,)."""
        from scipy.signal import lfilter  # a third of a second, and only what went wrong needs it

        return np.asarray(lfilter(self.numerator, self.denominator, position - position[0]))

    def gain(self, angle: NDArray[Any]) -> NDArray[np.complex128]:
        """Return C at angular frequencies [rad per sample], shape (n,)."""
        turn = np.exp(-1j * angle)
        return np.asarray(np.polynomial.Polynomial(self.numerator)(turn) / self._poles(turn))

    def _poles(self, turn: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(np.polynomial.Polynomial(self.denominator)(turn))

    def sums(
        self, samples: NDArray[np.float64], part: NDArray[np.float64], size: int, lines: NDArray[np.int64]
    ) -> NDArray[np.complex128]:
        """Return Fourier sums of samples times a polynomial of it over its poles, of all whole periods to their end.

        C y is B y over A with C = B/A, and u is A u over A: both are exact whether or not the motion repeats itself.
        """
        filtered = self.applied(samples, part)
        whole = filtered[filtered.size % size :].reshape(-1, size)
        return fourier_sums(whole, lines) / self._poles(np.exp(-2j * np.pi / size * lines))


@dataclass(frozen=True)
class _SegmentLoop:
    """A segment of a record with what was to be played in it."""

    segment: Segment
    played: NDArray[np.complex128]
    """At its lines [N], shape (lines,)."""
    start: int
    """Its first sample in the record."""
    controller: LoopController

    @property
    def angle(self) -> NDArray[np.float64]:
        """Phase of a sample at each line [rad]."""
        return np.asarray(2 * np.pi * self.segment.lines / self.segment.samples)

    def sums(self, force: str = "u", position: str = "y") -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the sums of u and C y [N] of all periods from rest on, each of shape (periods, lines)."""
        segment, (zeros, poles) = self.segment, self.controller
        samples = [
            np.concatenate([segment.lead_in.get(name, np.empty(0)), segment.channels[name].ravel()])
            for name in (force, position)
        ]
        of = segment.samples, segment.lines
        return self.controller.sums(samples[0], poles, *of), self.controller.sums(samples[1], zeros, *of)

    def terms(self, force: str = "u", position: str = "y") -> LoopTerms:
        """Return the terms of the recorded periods, one after another, with their scatter and rounding as noise."""
        count = len(self.segment.channels[force])
        gains = np.ones(self.angle.size), np.abs(self.controller.gain(self.angle))
        found = []
        for sums, name, gain in zip(self.sums(force, position), (force, position), gains, strict=True):
            periods = sums[-count:]
            scatter = periods.std(axis=0, ddof=1) if count > 1 else 0.0
            noise = np.hypot(scatter, grid_step(self.segment.channels[name]) / 2 * gain)
            found.append(LoopTerm(periods.ravel(), np.tile(noise, count)))
        return LoopTerms(found[0], LoopTerm(np.tile(self.played, count)), found[1], np.tile(self.angle, count))

    def direction_force(self) -> float:
        """Return the force [N] with which what is left of the equation follows the direction of motion, or 0.

        It is looked for in the mean period, as the excitation before that is not known, and without its mean.
        """
        segment, size = self.segment, self.segment.samples
        force, moved = (np.fft.rfft(segment.channels[name].mean(axis=0)) for name in ("u", "y"))
        angle = 2 * np.pi / size * np.arange(1, force.size)
        residual = np.append(0.0, force[1:] + self.controller.gain(angle) * moved[1:])
        residual[segment.lines] -= self.played * size / 2
        deviation = TOLERANCE * float(np.sqrt(np.sum(np.abs(self.played) ** 2)))
        shortest = size / segment.lines.max()
        return direction_force(np.fft.irfft(residual, size), np.fft.irfft(moved, size), shortest, deviation)


class PlayVerdict(NamedTuple):
    """What the columns of a record are."""

    fault: LoopFault | None
    is_shown: bool
    """Whether the position is known to be the one that the controller sees."""


def judge_columns(segments: Sequence[Segment], cuts: Sequence[Cut], controller: LoopController) -> PlayVerdict:
    """Return whether 'u' is the excitation minus what the controller makes of 'y', and what it is otherwise.

    Segments without a known excitation are left out.
    """
    loops = [
        _SegmentLoop(segment, _phasors(cut.excitation), cut.start, controller)
        for segment, cut in zip(segments, cuts, strict=True)
        if cut.excitation and {"u", "y"} <= segment.channels.keys()
    ]
    if not loops:
        return PlayVerdict(None, False)
    terms = _joined([loop.terms() for loop in loops])
    if find_fault(terms) is None:
        return PlayVerdict(None, terms.shows_feedback)
    followed = [loop.direction_force() for loop in loops]
    if 2 * np.count_nonzero(followed) > len(followed):
        return PlayVerdict(LoopFault(FaultKind.COMPENSATION, float(np.median(followed))), False)
    fault = find_fault(terms, _joined([loop.terms("y", "u") for loop in loops]))
    if fault is not None and fault.kind in UNTIMELY:
        late = _find_beginning(loops)
        if late is not None and abs(late.samples) > MAX_BEGIN:
            shortest = min(loop.segment.channels["u"].size for loop in loops)
            is_harmless = abs(late.samples) <= HARMLESS_SHARE * shortest and is_usual(late.factor)
            return PlayVerdict(None if is_harmless else late, False)
    if fault is not None and fault.kind in (*UNTIMELY, FaultKind.INPUT_SHIFT):
        fault = _find_break(loops) or fault
    return PlayVerdict(fault, False)


def judge_play(
    force: NDArray[np.float64],
    position: NDArray[np.float64],
    excitation: NDArray[np.float64],
    controller: LoopController,
    shortest: float,
) -> LoopFault | None:
    """Return what the columns of a play are instead, sample by sample from rest on, each of shape (n,).

    None if they are right, if it is not known, or if the numbers of the motion are right all the same. `shortest` is
    the shortest period of the excitation [samples].
    """
    terms, swapped = (
        LoopTerms(_play_term(acting), _play_term(excitation), _play_term(controller.answer(moved)))
        for acting, moved in ((force, position), (position, force))
    )
    fault = find_fault(terms, swapped)
    if fault is None:
        return None
    deviation = TOLERANCE * float(np.std(excitation))
    residual = force - excitation + controller.answer(position)
    if followed := direction_force(residual, position, shortest, deviation):
        return LoopFault(FaultKind.COMPENSATION, followed)
    if fault.kind in WRONG_NUMBERS and 1 / PLAIN_FACTOR <= fault.factor <= PLAIN_FACTOR:
        return None
    return fault if fault.kind in (*WRONG_NUMBERS, FaultKind.SWAPPED) else None


def _play_term(samples: NDArray[np.float64]) -> LoopTerm:
    change = samples - samples[0]
    return LoopTerm(change.astype(complex), TOLERANCE * float(np.sqrt(np.mean(change**2))))


def _phasors(excitation: Sequence[Sequence[float]]) -> NDArray[np.complex128]:
    amplitude, phase = np.array(excitation, dtype=float).T
    return np.asarray(amplitude * np.exp(1j * np.deg2rad(phase)))


def _joined(terms: Sequence[LoopTerms]) -> LoopTerms:
    """Return the terms of all segments, one after another."""
    u, w, fed = (
        LoopTerm(
            np.concatenate([getattr(one, name).values for one in terms]),
            np.concatenate([np.broadcast_to(getattr(one, name).noise, one.input.values.size) for one in terms]),
        )
        for name in ("input", "excitation", "feedback")
    )
    return LoopTerms(u, w, fed, np.concatenate([np.asarray(one.angle) for one in terms]))


def _find_beginning(loops: Sequence[_SegmentLoop]) -> LoopFault | None:
    """Return how late a record begins by the excitation u + C y that it shows; None if no delay explains that.

    Of each line the median of all periods from rest on counts: single ones belong to a ramp, or to another segment.
    """
    ratios = [sum(loop.sums()) / loop.played for loop in loops]
    steady = np.concatenate([np.median(of.real, axis=0) + 1j * np.median(of.imag, axis=0) for of in ratios])
    usual = float(np.median(np.abs(steady)))
    if not usual:
        return None
    angle, turn = np.concatenate([loop.angle for loop in loops]), steady / usual
    longest = round(MAX_LATE_S / loops[0].segment.sample_time)
    delays = np.arange(-longest, longest + 1)
    agreement, some = np.zeros(delays.size), slice(None, None, angle.size // MAX_LATE_LINES + 1)
    for of, phasor in zip(angle[some], turn[some], strict=True):
        agreement += np.real(np.conj(phasor) * np.exp(1j * of * delays))
    alike = delays[agreement >= agreement.max() - ALIKE_AGREEMENT * turn[some].size]
    best = int(alike[np.argmin(np.abs(alike))])  # frequencies may have a common period
    misfit = float(np.sqrt(np.mean(np.abs(turn - np.exp(1j * angle * best)) ** 2)))
    is_chance = delays.size * misfit**angle.size > SIGNIFICANCE  # phases that have nothing to do with a delay
    return None if is_chance or misfit > MAX_MISFIT * TOLERANCE else LoopFault(FaultKind.BEGUN_LATE, usual, best)


def _find_break(loops: Sequence[_SegmentLoop]) -> LoopFault | None:
    """Return the rows that are lost, or the clock of the record, by the excitation that it shows; None if neither is.

    Its phases are those of what was to be played until rows are lost, or move on in proportion to the time. Where they
    do neither, and change from period to period while the excitation keeps its size, time runs unevenly.
    """
    parts = []
    for loop in loops:
        size, turn = loop.segment.samples, sum(loop.sums()) / loop.played
        end = loop.start + loop.segment.channels["u"].size
        middle = end - size * (np.arange(len(turn))[::-1, None] + 0.5)
        change = np.diff(turn, axis=0, prepend=turn[:1])
        parts.append([of.ravel() for of in np.broadcast_arrays(middle, loop.angle, turn, change)])
    time, angle, turn, change = (np.concatenate(part) for part in zip(*parts, strict=True))
    some = np.argsort(time, kind="stable")[:: time.size // MAX_PHASES + 1]
    usual = max(float(np.median(np.abs(turn))), np.finfo(float).tiny)
    time, angle, turn, change = time[some], angle[some], turn[some] / usual, change[some] / usual

    def is_alike(expected: NDArray[Any], trials: float, share: float = STEADY_SHARE) -> bool:
        """Return whether most phases are as expected, and not by chance."""
        left = float(np.quantile(np.abs(turn - expected), share))
        return left <= MAX_MISFIT * TOLERANCE and trials * left**time.size <= SIGNIFICANCE

    if is_alike(np.sign(np.median(turn.real)) * np.ones_like(turn), 1.0):
        return None
    slip, trials = np.zeros(turn.size), 1.0
    for losses in range(MAX_LOSSES):
        lost, tried = _lost_rows(angle, turn * np.exp(-1j * angle * slip))
        slip, trials = slip + lost, trials * tried
        if is_alike(np.exp(1j * angle * slip), trials):
            stands = losses == 0 and slip[0] == slip[-1]
            return None if stands else LoopFault(FaultKind.LOST_ROWS, samples=float(slip[-1]))
    error, tried = _clock_error(time, angle, turn)
    if is_alike(np.exp(1j * angle * time * error), tried):
        return LoopFault(FaultKind.CLOCK, 1 + error)
    is_moving = float(np.median(np.abs(change))) > MAX_MISFIT * TOLERANCE
    is_whole = is_moving and is_usual(usual) and is_alike(turn / np.abs(turn), 1.0, share=0.5)
    return LoopFault(FaultKind.UNEVEN) if is_whole else None


def _lost_rows(angle: NDArray[np.float64], turn: NDArray[np.complex128]) -> tuple[NDArray[np.float64], int]:
    """Return the slip [samples] of phases in the order of time, (n,), by rows lost once or before, and the trials."""
    rows = np.arange(-MAX_ROWS, MAX_ROWS + 1)
    until = np.cumsum(np.real(np.conj(turn) * np.exp(1j * np.outer(rows, angle))), axis=1)
    until = np.concatenate([np.zeros((rows.size, 1)), until], axis=1)
    agreement = until[MAX_ROWS] + until[:, -1:] - until  # of so many rows that are lost before each phase
    alike = rows[agreement.max(axis=1) >= agreement.max() - ALIKE_AGREEMENT * turn.size]
    lost = int(alike[np.argmin(np.abs(alike))])
    first = int(np.argmax(agreement[MAX_ROWS + lost]))
    return np.where(np.arange(turn.size) >= first, float(lost), 0.0), agreement.size


def _clock_error(
    time: NDArray[np.float64], angle: NDArray[np.float64], turn: NDArray[np.complex128]
) -> tuple[float, int]:
    """Return the relative error of the clock with which phases, (n,), move on, and the number of trials."""
    phase = angle * time
    errors = np.arange(-MAX_CLOCK_ERROR, MAX_CLOCK_ERROR, 0.5 / float(np.max(phase)))
    error = float(errors[np.argmax([np.sum(np.real(np.conj(turn) * np.exp(1j * phase * of))) for of in errors])])
    error += float(np.sum(phase * np.imag(turn * np.exp(-1j * phase * error)))) / float(np.sum(phase**2))
    return error, errors.size


WRONG = "wrong column"
"""Kind of all findings of this module."""
EXACT_RATIO = 1.05
"""Ratio to a unit, either way, up to which it is named: what the controller answers shows it exactly."""
LIKELY_GAINS = (0.5, 2.0)
"""Factors on the position that are more likely another gain of the controller."""


def fault_finding(fault: LoopFault, units: Mapping[str, str]) -> Finding:
    """Return what was found in the columns of a record, and the remedy."""
    if fault.kind in FACTORED:
        name, right = FACTORED[fault.kind]
        unit = _unit(fault, units)
        as_unit = f", as if its column were in {unit}" if unit else ""
        is_times = "has the opposite sign of" if _is_opposite(fault) else f"is {fault.factor:,.4g} times"
        text = f"'{name}' {is_times} {right}{as_unit}"
    elif fault.kind in DELAYED:
        size, time = f"{round(abs(fault.samples), 1):,g}", "late" if fault.samples > 0 else "early"
        text = f"{DELAYED[fault.kind]} {size} sample{'' if size == '1' else 's'} {time}"
    else:
        text = TEXTS[fault.kind][0].format(factor=fault.factor, samples=fault.samples, unit=units["u"])
    return Finding(WRONG, text=text, remedy=_remedy(fault, units), error=fault.error)


def _remedy(fault: LoopFault, units: Mapping[str, str]) -> str:
    if fault.kind in FACTORED:
        name, _ = FACTORED[fault.kind]
        unit = _unit(fault, units)
        column = f"{name} [{unit}]" if unit else f"{name} * {1 / fault.factor:.4g} [{units[name]}]"
        stated = f'state record.channels.{name} = "{column}"'
        if name == "y" and not _is_opposite(fault):  # a controller of another gain answers as much
            gain = f"correct record.controller if its gain is {1 / fault.factor:.4g} times as great"
            is_likely = LIKELY_GAINS[0] <= fault.factor <= LIKELY_GAINS[1]
            return f"{gain}; if 'y' is wrong, {stated}" if is_likely else f"{stated}, or {gain}"
        return stated
    if fault.kind is FaultKind.BEGUN_LATE:
        change = "lower" if fault.samples > 0 else "raise"
        return f"begin it with the excitation, or {change} start and rest of record.segments by {abs(fault.samples):g}"
    if fault.kind in DELAYED:
        delay = ", or state a delay of the controller in record.controller"
        is_slow = fault.kind is FaultKind.OUTPUT_SHIFT and fault.samples < 0
        return f"record 'y' as the controller reads it, and 'u' of the same cycle{delay if is_slow else ''}"
    return TEXTS[fault.kind][1]


def _is_opposite(fault: LoopFault) -> bool:
    return fault.factor < 0 and abs(np.log(-fault.factor)) < np.log(EXACT_RATIO)


def _unit(fault: LoopFault, units: Mapping[str, str]) -> str:
    """Return the unit that explains a factor; empty if none does."""
    known = FACTORS[units[FACTORED[fault.kind][0]]].items()
    near = (of for factor, of in known if fault.factor > 0 and abs(np.log(fault.factor / factor)) < np.log(EXACT_RATIO))
    return next(near, "")


FACTORED = {
    FaultKind.INPUT_FACTOR: ("u", "the excitation minus what the controller makes of 'y'"),
    FaultKind.OUTPUT_FACTOR: ("y", "the position that the controller answers in 'u'"),
}
"""Channels that may be in another unit, and what they are to be."""
DELAYED = {
    FaultKind.INPUT_SHIFT: "'u' is recorded",
    FaultKind.OUTPUT_SHIFT: "beside the controller's answer in 'u', 'y' is recorded",
    FaultKind.BEGUN_LATE: "the record begins",
}
"""What may be late."""
TEXTS = {
    FaultKind.ALONE: (
        "'u' is the excitation alone, without what the controller makes of 'y'",
        "record the controller's whole output; if the machine has no feedback, state that with record.controller = "
        '{name = "transfer_function", numerator = [0], denominator = [1]}',
    ),
    FaultKind.FEEDBACK: ("'u' is what the controller makes of 'y', without the excitation", "record the sum of both"),
    FaultKind.EXCITATION_FACTOR: (
        "'u' has {factor:,.4g} times the excitation that was written",
        "correct gain and sign of the output that plays it; if it is meant, state what is played in record.segments",
    ),
    FaultKind.SWAPPED: (
        "'u' and 'y' are swapped, as 'y' is the excitation minus what the controller makes of 'u'",
        "exchange their columns in record.channels",
    ),
    FaultKind.COMPENSATION: (
        "'u' has {factor:.3g} {unit} in the direction of motion beside the excitation minus what the controller makes "
        "of 'y', as by a friction compensation of the machine",
        "switch it off while the machine is measured",
    ),
    FaultKind.INPUT_LAG: (
        "'u' lags as if filtered with a time constant of {samples:.3g} samples",
        "record 'u' unfiltered",
    ),
    FaultKind.OUTPUT_LAG: (
        "'y' lags behind the position that the controller answers in 'u', as if filtered with a time constant of "
        "{samples:.3g} samples",
        "record 'y' as the controller reads it, or state the filter in record.controller",
    ),
    FaultKind.LOST_ROWS: (
        "within the record rows are lost or written twice: it comes to be {samples:.0f} samples before the excitation",
        "record again, or leave out of record.segments what comes after the loss",
    ),
    FaultKind.CLOCK: (
        "a sample of the record takes {factor:.6g} times as long as one of the excitation",
        "record with the clock that plays the excitation",
    ),
    FaultKind.UNEVEN: (
        "the record shows the whole excitation, and not in time: rows are lost or written twice in several places, or "
        "its clock changes",
        "record each sample once, with the clock that plays the excitation",
    ),
    FaultKind.UNKNOWN: (
        "'u' is not the excitation minus what the controller makes of 'y', and no factor, delay or filter explains it",
        "state the machine's own numbers in record.controller; if they are right, correct column, sign and unit of 'u' "
        "and 'y' in record.channels, sample_rate, or the start of record.segments",
    ),
}
"""What else was found, and the remedy."""
FACTORS = {"N": {1e-3: "kN", 1e3: "mN"}, "m": {1e3: "mm", 1e6: "um", 100.0: "cm", 1e9: "nm"}}
FACTORS |= {"N m": {1e-3: "kN m", 1e3: "mN m"}, "rad": {1e3: "mrad", 180 / np.pi: "deg"}}
"""Units by the ratio that they make of one that was meant to be SI."""
