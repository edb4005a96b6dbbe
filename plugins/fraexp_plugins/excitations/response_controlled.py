"""Response-controlled stepped sine: the displacement amplitude is the same at all frequencies."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Finding, Period, Quantity, Segment, param
from fraexp_plugins.excitations._shared.sampling import sine_wave
from fraexp_plugins.excitations._shared.settled_excitation import SteppedExcitation

FIRST_FORCE_RATIO = 0.1
"""Force tried first, over the maximum force."""
MAX_SLOPE, MIN_SLOPE = 5.0, 0.7
"""Slopes of response over force, both logarithmic, between which an extrapolation is trusted."""
MAX_FORCE_FACTOR = 10.0
"""Factor by which the force may change without a bracket."""
BRACKET_MARGIN = 0.05
"""Fraction of the bracket that a step keeps away from its ends."""


class ForceTrial(NamedTuple):
    """A force that was tried, and the response to it."""

    force: float
    """Amplitude of the force [N]."""
    response: float
    """Amplitude of the response [m]."""


@dataclass(frozen=True)
class _RevisedPeriod(Period):
    """A period whose force follows from earlier trials."""

    trials: tuple[ForceTrial, ...] = ()


class ResponseControlled(SteppedExcitation, name="response_controlled", version=2):
    """u_sin = F(f) sin(2πft), with F such that the response has the amplitude Y at each frequency.

    T. Karaağaçlı and H. N. Özgüven, Mechanical Systems and Signal Processing 146, 2021, 107023,
    doi:10.1016/j.ymssp.2020.107023; the same, Vibration 3(3), 2020, doi:10.3390/vibration3030019. Friction is then
    the same at each frequency, N(Y), and the response quasi-linear, y/u = 1/(1/P + N(Y) + jωDv): methods for linear
    machines apply, and N(Y) can be subtracted. Each frequency is run again, from rest, with a force found by false
    position on logarithmic axes, until the amplitude is met within `accuracy`; 2 to 7 times on the paper's machine.

    F never exceeds `max_force`; where that does not suffice, or where the response jumps over Y, the excitation keeps
    the amplitude that it reached, and the result's message says so. The controller's part of u comes on top of F. It
    does not suit amplitudes near the encoder's quantisation step, nor frequencies so low that the motion is far from
    a sine (below some 10 Hz at presliding amplitudes): N(Y) is a describing function. During the search the response
    may exceed Y.
    """

    rounds: ClassVar[int] = 5

    displacement: float = param("m", "amplitude Y of the response", above=0)
    max_force: float = param("N", "maximum amplitude of the force", above=0)
    channel: Literal["y", "displacement"] = param("", "channel whose amplitude is held: y or displacement", "y")
    accuracy: float = param("1", "relative error of the amplitude that is accepted", 0.01, at_least=1e-4, at_most=0.5)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the first trial: one block of whole periods per frequency."""
        blocks = [self.block(frequency, sample_time) for frequency in self.grid]
        first = FIRST_FORCE_RATIO * self.max_force
        return tuple(_RevisedPeriod(first * sine_wave(block), np.array([block.cycles])) for block in blocks)

    def revise(self, period: Period, segment: Segment) -> Period | None:
        """Return the period with a better force, or None if the amplitude is met or cannot be."""
        force = _amplitude(period.waveform, period.lines[0])
        earlier = period.trials if isinstance(period, _RevisedPeriod) else ()
        trials = (*earlier, ForceTrial(force, self._response(segment)))
        wanted = next_force(trials, self.displacement, self.max_force, self.accuracy)
        if wanted is None:
            return None
        return _RevisedPeriod(period.waveform * (wanted / force), period.lines, period.reference, trials=trials)

    def max_force_and_stroke(self) -> tuple[float | None, float | None]:
        """Return the maximum force [N], and the stroke [m] of the amplitude that is aimed at."""
        return self.max_force, 2 * self.displacement

    def findings(self, segments: Sequence[Segment]) -> tuple[Finding, ...]:
        """Return at how many frequencies the amplitude was missed, and why; empty if at none."""
        found = [(self._response(segment), self._is_at_max_force(segment)) for segment in segments]
        missed = [pair for pair in found if abs(pair[0] / self.displacement - 1) > self.accuracy]
        texts = {True: "limited by max_force", False: "the response jumps over it, or the search ended before"}
        remarks = []
        for at_max_force, text in texts.items():
            reached = [response for response, is_at_max in missed if is_at_max == at_max_force]
            if reached:
                lengths = (
                    Quantity(self.displacement, "m", "aim"),
                    Quantity(min(reached), "m", "reached from"),
                    Quantity(max(reached), "m", "to"),
                )
                place = f"amplitude at {len(reached)} of {len(segments)} frequencies"
                remarks.append(Finding("remark", lengths, place=place, text=text))
        return tuple(remarks)

    def _response(self, segment: Segment) -> float:
        """Return the amplitude of the response [m]."""
        return _amplitude(segment.channels[self.channel].mean(axis=0), segment.lines[0])

    def _is_at_max_force(self, segment: Segment) -> bool:
        force = _amplitude(segment.channels["excitation"].mean(axis=0), segment.lines[0])
        return force >= self.max_force * (1 - self.accuracy / 10)


def next_force(trials: Sequence[ForceTrial], target: float, max_force: float, accuracy: float) -> float | None:
    """Return the force [N] to try next, or None if the last one will do.

    Between a force too small and one too large: false position on logarithmic axes, and their geometric mean when the
    last two trials fell on the same side. Without a bracket: along the last two trials, or in proportion.
    """
    force, response = trials[-1]
    if abs(response / target - 1) <= accuracy:
        return None
    below = max((trial for trial in trials if trial.response < target), default=None)
    above = min((trial for trial in trials if trial.response >= target), default=None)
    if below and above and below.force < above.force:
        if above.force / below.force - 1 <= accuracy / 10:
            return None  # a jump: no force gives the amplitude
        return _force_between(below, above, trials, target)
    if below and below.force >= max_force * (1 - accuracy / 10):
        return None if force == below.force else below.force
    slope = min(max(_logarithmic_slope(trials), MIN_SLOPE), MAX_SLOPE)
    factor = (target / response) ** (1 / slope) if response > 0 else MAX_FORCE_FACTOR
    return min(force * min(max(factor, 1 / MAX_FORCE_FACTOR), MAX_FORCE_FACTOR), max_force)


def _force_between(below: ForceTrial, above: ForceTrial, trials: Sequence[ForceTrial], target: float) -> float:
    same_side = len(trials) > 2 and len({trial.response < target for trial in trials[-2:]}) == 1
    fraction = 0.5
    if not same_side and below.response > 0:
        fraction = np.log(target / below.response) / np.log(above.response / below.response)
    fraction = min(max(float(fraction), BRACKET_MARGIN), 1 - BRACKET_MARGIN)
    return float(below.force ** (1 - fraction) * above.force**fraction)


def _logarithmic_slope(trials: Sequence[ForceTrial]) -> float:
    """Return d ln(response)/d ln(force) of the last two trials; 1 for the first one."""
    if len(trials) < 2 or min(trials[-1].response, trials[-2].response) <= 0:
        return 1.0
    last, previous = trials[-1], trials[-2]
    if last.force == previous.force:
        return 1.0
    return float(np.log(last.response / previous.response) / np.log(last.force / previous.force))


def _amplitude(wave: NDArray[np.float64], line: int) -> float:
    """Return the amplitude of a harmonic."""
    return float(2 / wave.size * np.abs(np.fft.rfft(wave)[line]))
