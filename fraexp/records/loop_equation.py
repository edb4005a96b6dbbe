"""The equation of a loop, u = w - C y, in a record whose excitation w and controller C are known, and what breaks it.

It holds sample by sample whatever the plant and its friction are, so that no prediction of the motion is needed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import fourier_sums
from fraexp.analysis.quantisation import grid_step
from fraexp.data.signals import Segment

TOLERANCE = 0.01
"""Relative error of each term that counts as exact: gains of converters, and numbers that were rounded."""
MAX_MISFIT = 3.0
"""Residual over what tolerance and noise allow, above which the equation does not hold."""
ALIKE_RATIO, ALIKE_MISFIT, ALIKE_SHARE = 3.0, 0.01, 0.03
"""Misfit over the least one, misfit, and part of that without an explanation, up to which explanations are as good as
each other."""
NAMED_SHARE = 0.2
"""Part of the misfit that an explanation leaves at most: noise leaves as much of any."""
EXACT_SHARE, EXACT_MISFIT, MIN_EXACT_LINES = 0.1, 0.02, 3
"""The same where the equation nearly holds, the misfit that this takes, and the number of lines."""
MAX_GAIN_ERROR = 0.05
"""Relative error of a channel's gain that is no other unit."""
OUTLIER_SHARE = 0.1
"""Share of the lines that may have any residual: a record may be wrong somewhere and right elsewhere."""
MAX_SHIFT = 3
"""Samples by which a channel may be late or early: more is no fault of sampling order."""
USUAL_GAINS = (1 / 1.4, 1.4)
"""Gain of the excitation's path that does no harm: a response is that of u and y, whatever was played."""


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
    EXCITATION_FACTOR = auto()
    SWAPPED = auto()
    BEGUN_LATE = auto()
    COMPENSATION = auto()
    """u has a force that follows the direction of motion, too."""
    UNKNOWN = auto()
    """Nothing of these: another controller."""


SHIFTED = {
    FaultKind.BEGUN_LATE: "excitation", FaultKind.OUTPUT_SHIFT: "feedback", FaultKind.INPUT_SHIFT: "input",
}  # fmt: skip
"""Terms that are early where something is late."""


class LoopFault(NamedTuple):
    """What breaks the equation."""

    kind: FaultKind
    factor: float = 1.0
    """Column over what it should be; of a compensation its force [N]."""
    samples: int = 0
    """Samples by which it is late."""


@dataclass(frozen=True)
class LoopTerm:
    """One term of the equation."""

    values: NDArray[np.complex128]
    """At the excited lines of all segments, or sample by sample [N], shape (n,)."""
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
        """Root mean square of the residual over what is no contradiction, without the lines where it is greatest."""
        return self._misfit(self.input.values - self.excitation.values + self.feedback.values)

    @property
    def shows_feedback(self) -> bool:
        """Whether a position that is not there, or has the opposite sign, would break the equation."""
        return self._misfit(self.feedback.values) > MAX_MISFIT

    def scaled(self, name: str, factor: "float | NDArray[np.complex128]") -> "LoopTerms":
        """Return the terms with one of them multiplied."""
        return replace(self, **{name: getattr(self, name) * factor})

    def advanced(self, name: str, samples: int) -> "LoopTerms":
        """Return the terms with one of them earlier."""
        return self.scaled(name, np.exp(1j * np.asarray(self.angle) * samples))

    def factor(self, name: str) -> float:
        """Return the real factor on a term with which the others agree best; 0 if it has none."""
        of, to, floor = getattr(self, name).values, self._rest_of(name), self._floor
        energy = float(np.sum(np.abs(of / floor) ** 2))
        return float(np.sum(np.real(np.conj(of) * to) / floor**2)) / energy if energy else 0.0

    def _rest_of(self, name: str) -> NDArray[np.complex128]:
        """Return what a term would be by the others."""
        u, w, fed = self.input.values, self.excitation.values, self.feedback.values
        return {"input": w - fed, "excitation": u + fed, "feedback": w - u}[name]

    @property
    def _floor(self) -> NDArray[np.float64]:
        """Residual that is no contradiction [N]."""
        squares = [
            (TOLERANCE * np.abs(of.values)) ** 2 + of.noise**2 for of in (self.input, self.excitation, self.feedback)
        ]
        return np.asarray(np.maximum(np.sqrt(sum(squares)), np.finfo(float).tiny))

    def _misfit(self, residual: NDArray[np.complex128]) -> float:
        squares = np.sort(np.abs(residual / self._floor) ** 2)
        return float(np.sqrt(np.mean(squares[: squares.size - int(OUTLIER_SHARE * squares.size)])))


def find_fault(terms: LoopTerms, swapped: LoopTerms | None = None) -> LoopFault | None:
    """Return what breaks the equation; None if it holds, or if what has happened does no harm.

    `swapped` are the terms of the record with u and y exchanged. Where the feedback is weak the equation nearly holds
    whatever y is: then a fault counts if it makes the equation exact.
    """
    before, found = terms.misfit, [(of.misfit, fault) for fault, of in _explanations(terms, swapped)]
    alike = max(ALIKE_RATIO * min(misfit for misfit, _ in found), min(ALIKE_MISFIT, ALIKE_SHARE * before))
    misfit, fault = next(one for one in found if one[0] <= alike)
    if before > MAX_MISFIT:
        return LoopFault(FaultKind.UNKNOWN) if misfit > NAMED_SHARE * before else _harmful(fault)
    is_exact = before > EXACT_MISFIT and misfit < EXACT_SHARE * before and terms.input.values.size >= MIN_EXACT_LINES
    return _harmful(fault) if is_exact else None


def _harmful(fault: LoopFault) -> LoopFault | None:
    """Return a fault, or None if the response of u and y is right all the same."""
    if fault.kind is FaultKind.BEGUN_LATE or (fault.kind is FaultKind.EXCITATION_FACTOR and is_usual(fault.factor)):
        return None
    has_factor = fault.kind in (FaultKind.INPUT_FACTOR, FaultKind.OUTPUT_FACTOR)
    return None if has_factor and abs(fault.factor - 1) < MAX_GAIN_ERROR else fault


def _explanations(terms: LoopTerms, swapped: LoopTerms | None) -> Iterator[tuple[LoopFault, LoopTerms]]:
    """Yield what may have happened, with the terms as they were before it; of equally good ones the first counts."""
    gain = terms.factor("excitation")
    played = LoopFault(FaultKind.EXCITATION_FACTOR, gain), terms.scaled("excitation", gain)
    if is_usual(gain):
        yield played
    yield LoopFault(FaultKind.ALONE), terms.scaled("feedback", 0.0)
    yield LoopFault(FaultKind.FEEDBACK), terms.scaled("excitation", 0.0)
    if np.any(terms.angle):
        for samples in (sign * size for size in range(1, MAX_SHIFT + 1) for sign in (1, -1)):
            for kind, name in SHIFTED.items():
                yield LoopFault(kind, samples=samples), terms.advanced(name, samples)
    for kind, name in ((FaultKind.OUTPUT_FACTOR, "feedback"), (FaultKind.INPUT_FACTOR, "input")):
        if share := terms.factor(name):
            yield LoopFault(kind, 1 / share), terms.scaled(name, share)
    if swapped is not None:
        yield LoopFault(FaultKind.SWAPPED), swapped
    if not is_usual(gain):
        yield played


def is_usual(gain: float) -> bool:
    """Return whether so much of an excitation does no harm if it is played in place of it."""
    return USUAL_GAINS[0] <= gain <= USUAL_GAINS[1]


CLEAR_SPEED = 0.5
"""Speed relative to the greatest one from which the direction is clear, also if the force is a few samples late."""
SPEED_SPAN = 1 / 16
"""Part of the shortest period over which a speed is taken: encoders are coarse."""
MAX_LEFT, MIN_LEFT = 0.1, 0.05
"""What such a force leaves of a residual at most, and what a force in proportion to the speed leaves at least."""
MIN_GAIN = 3.0
"""Factor by which the former leaves less than the latter: another controller's answer is in proportion to motion."""


def direction_force(residual: NDArray[np.float64], position: NDArray[np.float64], shortest: float) -> float:
    """Return the force [N] with which a residual [N] follows the direction of motion; 0 if it does not.

    Both are sample by sample, shape (n,), and `shortest` is the shortest period in them [samples].
    """
    span = max(round(SPEED_SPAN * shortest), 1)
    speed = position[span:] - position[:-span]
    if not speed.any():
        return 0.0
    sums = np.cumsum(residual)
    force = (sums[span:] - sums[:-span]) / span
    clear = np.abs(speed) > CLEAR_SPEED * np.abs(speed).max()
    speed, force = speed[clear], force[clear]
    terms = np.array([np.sign(speed), speed, np.ones(speed.size)])
    size = float(np.sqrt(np.mean(force**2)))
    found, left = _fit(terms, force)
    _, left_by_speed = _fit(terms[1:], force)
    follows = left < MAX_LEFT * size and MIN_LEFT * size < left_by_speed and MIN_GAIN * left < left_by_speed
    return max(float(found[0]), 0.0) if follows else 0.0


def _fit(terms: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the factors of terms, shape (m, n), that make a force, shape (n,), and the rms that they leave of it."""
    scale = np.maximum(np.abs(terms).max(axis=1), np.finfo(float).tiny)
    factors = np.linalg.lstsq((terms / scale[:, None]).T, force, rcond=None)[0] / scale
    return factors, float(np.sqrt(np.mean((force - factors @ terms) ** 2)))


MAX_LATE_S = 20.0
"""Greatest time by which the beginning of a record is looked for."""
STEADY_TOLERANCE = 0.05
"""Relative difference of an excitation's amplitude from the usual one up to which a period is no part of a ramp."""
MAX_CHANCE = 0.01
"""Chance at which phases are those of some delay although they have nothing to do with one: few lines often are."""
MAX_LATE_LINES = 60
"""Lines by which it is looked for: more of them take time alone."""
MAX_LATE_MISFIT = 0.03
"""Root mean square of what a late beginning leaves of the excitation, relative to it."""
ALIKE_AGREEMENT = 1e-4
"""Difference of the mean cosine of phases up to which delays are as good as each other."""
HARMLESS_SHARE = 0.01
"""Part of a record by which it may begin late or early: the rest of it is as periodic."""


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


class LoopSums(NamedTuple):
    """Fourier sums of one segment, of all whole periods from rest to its end, each of shape (periods, lines) [N].

    They are of A u and B y over A, with C = B/A, so that what is left of the equation is exact whether or not the
    motion repeats itself.
    """

    input: NDArray[np.complex128]
    feedback: NDArray[np.complex128]
    recorded: int
    """Number of periods of the record, the last ones."""
    input_rounding: float
    feedback_rounding: NDArray[np.float64]
    angle: NDArray[np.float64]
    """Phase of a sample at each line [rad]."""

    def term(self, name: str) -> LoopTerm:
        """Return the mean over the record, with its noise."""
        sums, rounding = (getattr(self, part) for part in (name, f"{name}_rounding"))
        periods = sums[-self.recorded :]
        scatter = (
            periods.std(axis=0, ddof=1) / np.sqrt(self.recorded) if self.recorded > 1 else np.zeros(len(self.angle))
        )
        return LoopTerm(periods.mean(axis=0), np.hypot(scatter, rounding))


class PlayVerdict(NamedTuple):
    """What the columns of a record are."""

    fault: LoopFault | None
    is_shown: bool
    """Whether the position is known to be the one that the controller sees."""


def judge_columns(
    segments: Sequence[Segment], excitations: Sequence[Sequence[Sequence[float]]], controller: LoopController
) -> PlayVerdict:
    """Return whether 'u' is the excitation minus what the controller makes of 'y', and what it is otherwise.

    `excitations` has amplitude [N] and phase [deg] of what was to be played at each line, from the first sample of each
    segment on; segments without any are left out.
    """
    pairs = [(segment, _phasors(of)) for segment, of in zip(segments, excitations, strict=True) if of]
    pairs = [(segment, played) for segment, played in pairs if {"u", "y"} <= segment.channels.keys()]
    if not pairs:
        return PlayVerdict(None, False)
    sums = [_loop_sums(segment, controller, "u", "y") for segment, _ in pairs]
    played = [phasors for _, phasors in pairs]
    terms = _terms(sums, played)
    if find_fault(terms) is None:
        return PlayVerdict(None, terms.shows_feedback)
    followed = [_direction_force(*pair, controller) for pair in pairs]
    if 2 * np.count_nonzero(followed) > len(followed):
        return PlayVerdict(LoopFault(FaultKind.COMPENSATION, float(np.median(followed))), False)
    swapped = _terms([_loop_sums(segment, controller, "y", "u") for segment, _ in pairs], played)
    fault = find_fault(terms, swapped)
    if fault is not None and fault.kind in (FaultKind.UNKNOWN, FaultKind.EXCITATION_FACTOR):
        shortest = min(of[0].samples * len(of[0].channels["u"]) for of in pairs)
        late = _find_beginning(sums, played, round(MAX_LATE_S / pairs[0][0].sample_time))
        if late is not None and abs(late.samples) > MAX_SHIFT:
            is_harmless = abs(late.samples) <= HARMLESS_SHARE * shortest and is_usual(late.factor)
            fault = None if is_harmless else late
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
    if followed := direction_force(force - excitation + controller.answer(position), position, shortest):
        return LoopFault(FaultKind.COMPENSATION, followed)
    if fault.kind in WRONG_NUMBERS and 1 / PLAIN_FACTOR <= fault.factor <= PLAIN_FACTOR:
        return None
    return fault if fault.kind in (*WRONG_NUMBERS, FaultKind.SWAPPED) else None


def _play_term(samples: NDArray[np.float64]) -> LoopTerm:
    change = samples - samples[0]
    return LoopTerm(change.astype(complex), TOLERANCE * float(np.sqrt(np.mean(change**2))))


def _direction_force(segment: Segment, played: NDArray[np.complex128], controller: LoopController) -> float:
    """Return the force [N] with which what is left of the equation follows the direction of motion; 0 if it does not.

    It is looked for in the mean period, as the excitation before that is not known, and without its mean.
    """
    size = segment.samples
    force, moved = (np.fft.rfft(segment.channels[name].mean(axis=0)) for name in ("u", "y"))
    turn = np.exp(-2j * np.pi / size * np.arange(1, force.size))
    gain = np.polynomial.Polynomial(controller.numerator)(turn) / np.polynomial.Polynomial(controller.denominator)(turn)
    residual = np.concatenate([[0.0], force[1:] + gain * moved[1:]])
    residual[segment.lines] -= played * size / 2
    return direction_force(np.fft.irfft(residual, size), np.fft.irfft(moved, size), size / segment.lines.max())


def _phasors(excitation: Sequence[Sequence[float]]) -> NDArray[np.complex128]:
    amplitude, phase = np.array(excitation, dtype=float).T
    return np.asarray(amplitude * np.exp(1j * np.deg2rad(phase)))


def _loop_sums(segment: Segment, controller: LoopController, force: str, position: str) -> LoopSums:
    lines, size = segment.lines, segment.samples
    angle = 2 * np.pi * lines / size
    powers = np.exp(-1j * np.outer(angle, np.arange(max(map(len, controller)))))
    numerator, denominator = (powers[:, : len(part)] @ part for part in controller)
    found = []
    for name, part in ((force, controller.denominator), (position, controller.numerator)):
        samples = np.concatenate([segment.lead_in.get(name, np.empty(0)), segment.channels[name].ravel()])
        filtered = controller.applied(samples, part)
        whole = filtered[filtered.size % size :].reshape(-1, size)
        found.append(fourier_sums(whole, lines) / denominator)
    steps = [grid_step(segment.channels[name]) / 2 for name in (force, position)]
    recorded, gain = len(segment.channels[force]), np.abs(numerator / denominator)
    return LoopSums(found[0], found[1], recorded, steps[0], steps[1] * gain, angle)


def _terms(sums: Sequence[LoopSums], played: Sequence[NDArray[np.complex128]]) -> LoopTerms:
    """Return the terms of all segments, one after another."""
    terms = [[of.term(name) for of in sums] for name in ("input", "feedback")]
    joined = [
        LoopTerm(np.concatenate([one.values for one in of]), np.concatenate([np.asarray(one.noise) for one in of]))
        for of in terms
    ]
    return LoopTerms(joined[0], LoopTerm(np.concatenate(played)), joined[1], np.concatenate([of.angle for of in sums]))


def _find_beginning(
    sums: Sequence[LoopSums], played: Sequence[NDArray[np.complex128]], longest: int
) -> LoopFault | None:
    """Return how late a record begins by the excitation u + C y that it shows; None if no delay explains that."""
    ratios = [(of.input + of.feedback) / excitation for of, excitation in zip(sums, played, strict=True)]
    usual = float(np.median(np.concatenate([np.abs(of).ravel() for of in ratios])))
    found = []
    for of, ratio in zip(sums, ratios, strict=True):
        steady = ratio[np.all(np.abs(np.abs(ratio) - usual) < STEADY_TOLERANCE * usual, axis=1)]
        if len(steady):
            found.append((of.angle, steady.mean(axis=0) / usual))
    if not found or 2 * len(found) < len(sums):
        return None
    angle, turn = (np.concatenate(part) for part in zip(*found, strict=True))
    delays = np.arange(-longest, longest + 1)
    agreement, some = np.zeros(delays.size), slice(None, None, angle.size // MAX_LATE_LINES + 1)
    for of, phasor in zip(angle[some], turn[some], strict=True):
        agreement += np.real(np.conj(phasor) * np.exp(1j * of * delays))
    alike = delays[agreement >= agreement.max() - ALIKE_AGREEMENT * turn[some].size]
    best = int(alike[np.argmin(np.abs(alike))])  # frequencies may have a common period
    misfit = float(np.sqrt(np.mean(np.abs(turn - np.exp(1j * angle * best)) ** 2)))
    is_chance = delays.size * misfit**angle.size > MAX_CHANCE
    return None if is_chance or misfit > MAX_LATE_MISFIT else LoopFault(FaultKind.BEGUN_LATE, usual, best)
