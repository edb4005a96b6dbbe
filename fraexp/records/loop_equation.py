"""The equation of a loop, u = w - C y, in a record whose excitation w and controller C are known, and what breaks it.

It holds sample by sample whatever the plant and its friction are, so that no prediction of the motion is needed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
