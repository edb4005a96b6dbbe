"""Response-controlled stepped sine: the displacement amplitude is the same at all frequencies."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from fraexp.api import Period, Segment, param
from fraexp_plugins.excitations.sampling import coherent, sine
from fraexp_plugins.excitations.stepped import SteppedExcitation

Pairs = tuple[tuple[float, float], ...]
"""Amplitudes of force [N] and response [m]."""
FIRST = 0.1
"""Force tried first, over the highest one."""
STEEPEST, FLATTEST = 5.0, 0.7
"""Slopes of response over force, both logarithmic, between which an extrapolation is trusted."""
FURTHEST = 10.0
"""Factor by which the force changes at most without a bracket."""
INSIDE = 0.05
"""Share of the bracket that a step keeps away from its ends."""


@dataclass(frozen=True)
class Attempt(Period):
    """A period whose force follows from what earlier ones gave."""

    earlier: Pairs = ()


class ResponseControlled(SteppedExcitation, name="response_controlled", version=2):
    """u_sin = F(f) sin(2πft), with F such that the response has the amplitude Y at each frequency.

    T. Karaağaçlı and H. N. Özgüven, Mechanical Systems and Signal Processing 146, 2021, 107023,
    doi:10.1016/j.ymssp.2020.107023; the same, Vibration 3(3), 2020, doi:10.3390/vibration3030019. Friction is then
    the same at each frequency, N(Y), and the response quasi-linear, y/u = 1/(1/P + N(Y) + jωDv): methods for linear
    machines apply, and N(Y) can be subtracted. Each frequency is run again, from rest, with a force found by false
    position on logarithmic axes, until the amplitude is met within `accuracy`; 2 to 7 times on the paper's machine.

    F never exceeds `highest_force`; where that does not suffice, or where the response jumps over Y, what was reached
    is taken, and the result's message says so. The controller's part of u comes on top of F. Not to be used for
    amplitudes near the scale's resolution, nor at frequencies so low that the motion is far from a sine (below some
    10 Hz at presliding amplitudes): N(Y) is a describing function. While searching the response may exceed Y.
    """

    rounds: ClassVar[int] = 5

    displacement: float = param("m", "amplitude Y of the response", above=0)
    highest_force: float = param("N", "highest amplitude of the force", above=0)
    channel: Literal["y", "displacement"] = param("", "channel whose amplitude is held: y or displacement", "y")
    accuracy: float = param("1", "relative error of the amplitude that is accepted", 0.01, at_least=1e-4, at_most=0.5)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return what is tried first: one block of whole periods per frequency."""
        pairs = [coherent(frequency * sample_time) for frequency in self.grid]
        return tuple(Attempt(FIRST * self.highest_force * sine(*pair), np.array([pair[0]])) for pair in pairs)

    def revise(self, period: Period, segment: Segment) -> Period | None:
        """Return the period with a better force, or None if the amplitude is met or cannot be."""
        force = _amplitude(period.waveform, period.lines[0])
        response = self._reached(segment)
        tried = (*(period.earlier if isinstance(period, Attempt) else ()), (force, response))
        wanted = next_force(tried, self.displacement, self.highest_force, self.accuracy)
        if wanted is None:
            return None
        return Attempt(period.waveform * (wanted / force), period.lines, period.reference, tried)

    def greatest(self) -> tuple[float | None, float | None]:
        """Return the highest force [N], and the stroke [m] of the amplitude that is aimed at."""
        return self.highest_force, 2 * self.displacement

    def remark(self, segments: Sequence[Segment]) -> str:
        """Say at how many frequencies the amplitude was missed, and why."""
        missed = [(self._reached(segment), self._is_at_highest(segment)) for segment in segments]
        missed = [pair for pair in missed if abs(pair[0] / self.displacement - 1) > self.accuracy]
        reasons = {
            True: f"at highest_force, {self.highest_force:g} N, they reach",
            False: "the response jumps over it, or the search ended before; they reach",
        }
        remarks = []
        for at_highest, reason in reasons.items():
            reached = [response for response, highest in missed if highest == at_highest]
            if reached:
                aim = f"{len(reached)} of {len(segments)} frequencies miss {_micrometres(self.displacement)}"
                remarks.append(f"{aim}: {reason} {_micrometres(min(reached), max(reached))}")
        return "; ".join(remarks)

    def _reached(self, segment: Segment) -> float:
        """Return the amplitude of the response [m]."""
        return _amplitude(segment.channels[self.channel].mean(axis=0), segment.lines[0])

    def _is_at_highest(self, segment: Segment) -> bool:
        force = _amplitude(segment.channels["excitation"].mean(axis=0), segment.lines[0])
        return force >= self.highest_force * (1 - self.accuracy / 10)


def next_force(tried: Pairs, target: float, highest: float, accuracy: float) -> float | None:
    """Return the force to be tried next, or None if the last one will do.

    Between a force too small and one too large: false position on logarithmic axes, and their geometric mean when the
    last two attempts fell on the same side. Without a bracket: along the last two attempts, or in proportion.
    """
    force, response = tried[-1]
    if abs(response / target - 1) <= accuracy:
        return None
    below = max((pair for pair in tried if pair[1] < target), default=None)
    above = min((pair for pair in tried if pair[1] >= target), default=None)
    if below and above and below[0] < above[0]:
        if above[0] / below[0] - 1 <= accuracy / 10:
            return None  # a jump: no force gives the amplitude
        return _between(below, above, tried, target)
    if below and below[0] >= highest * (1 - accuracy / 10):
        return None if force == below[0] else below[0]
    slope = min(max(_slope(tried), FLATTEST), STEEPEST)
    factor = (target / response) ** (1 / slope) if response > 0 else FURTHEST
    return min(force * min(max(factor, 1 / FURTHEST), FURTHEST), highest)


def _between(below: tuple[float, float], above: tuple[float, float], tried: Pairs, target: float) -> float:
    same_side = len(tried) > 2 and len({response < target for _, response in tried[-2:]}) == 1
    share = 0.5
    if not same_side and below[1] > 0:
        share = np.log(target / below[1]) / np.log(above[1] / below[1])
    share = min(max(float(share), INSIDE), 1 - INSIDE)
    return float(below[0] ** (1 - share) * above[0] ** share)


def _slope(tried: Pairs) -> float:
    """Return d ln(response)/d ln(force) of the last two attempts; 1 for the first one."""
    if len(tried) < 2 or min(tried[-1][1], tried[-2][1]) <= 0:
        return 1.0
    (force, response), (before, answer) = tried[-1], tried[-2]
    return float(np.log(response / answer) / np.log(force / before)) if force != before else 1.0


def _micrometres(*lengths: float) -> str:
    """Return a length [m], or a range of them, in words."""
    return " to ".join(dict.fromkeys(f"{1e6 * length:.4g}" for length in lengths)) + " µm"


def _amplitude(wave: np.ndarray, line: int) -> float:
    """Return the amplitude of a harmonic."""
    return float(2 / wave.size * np.abs(np.fft.rfft(wave)[line]))
