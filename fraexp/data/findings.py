"""Findings: doubts about a result and causes of its outcome, as data. Views render their words last of all."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.texts import frequency_text
from fraexp.data.units import with_powers

REMARK = "remark"
"""Kind of a finding that says in free text what no other kind does."""


class Kind(NamedTuple):
    """What findings of one kind have in common."""

    words: str
    """What was found, as it begins a message."""
    meaning: str
    """What that means, or its usual cause."""
    remedy: str
    """What helps; empty where nothing has to be done."""


KINDS: Mapping[str, Kind] = {
    "no motion": Kind(
        "input or output does not move",
        "the motion is below the encoder's resolution or its noise, or dry friction holds the position",
        "raise the amplitude, or use a finer encoder; of a record, state excited frequencies only",
    ),
    "held by friction": Kind("friction holds it still", "dry friction holds a position", "raise the amplitude"),
    "not periodic": Kind(
        "not yet periodic",
        "a lightly damped mode, a law that creeps (Dahl, LuGre), or a noisy feedback",
        "raise settling_timeout, loosen settling_tolerance, or ignore the marked points",
    ),
    "still settling": Kind(
        "the machine was still settling",
        "the first periods of the record contain a transient",
        "leave the first periods out (skip_periods, --skip-periods), or wait before each frequency",
    ),
    "from rest": Kind(
        "recorded from rest: the transient is in the response", "a mean over periods does not take a transient off", ""
    ),
    "steady motion": Kind(
        "it moves on in each period, which a mean over periods takes for a part of the response",
        "the axis drifts, or turns, while it is measured",
        "take local_polynomial (--estimator), which removes a steady motion, or subtract it before the import",
    ),
    "diverged": Kind(
        "the displacement left ±loop.divergence_limit",
        "the loop is unstable, or the move is longer than the limit",
        "lower gain, dead time or amplitude",
    ),
    "inexact computation": Kind(
        "the computation falsifies the result",
        "steps too long, or a sampled motion that does not show all of the friction force",
        "raise the amplitude, or numerics.steps_per_sample (0 chooses it)",
    ),
    "band by friction": Kind(
        "the band is too wide by the friction model, or the delays",
        "friction model or delays are known too little, or harmonics of the motion contradict them",
        "raise the amplitude, or identify friction and state how well it and the delays are known (deviations, "
        "force_std, displacement_std, dead_time_std)",
    ),
    "no harmonics": Kind(
        "no harmonic of a sine tells how wrong the friction model or a delay is",
        "a record of sines tells it where their harmonics lie between two frequencies at most 1.5 times apart",
        "measure sines at frequencies at most 1.5 times apart, raise the amplitude, or identify friction and state how "
        "well it and the delays are known (deviations, force_std, displacement_std, dead_time_std)",
    ),
    "band by noise": Kind(
        "the band is too wide by noise and rounding",
        "the encoder is coarse or noisy for this motion, or few periods were recorded",
        "raise the amplitude, use a finer encoder, or record more periods",
    ),
    "band by distortion": Kind(
        "the band is too wide by nonlinear distortion",
        "friction, or a friction model that is wrong, makes the response depend on phases and amplitudes",
        "identify friction again and take it off (effective_input), or measure more realisations",
    ),
    "unknown band": Kind(
        "nothing tells how far the response may be off",
        "one period without a stated noise, or a response without its coherence",
        "record two periods or more, state the noise of the encoder or the coherence of a response, or fit a plant "
        "(modal_fit), whose residuals tell",
    ),
    "hidden by standstill": Kind(
        "the motion does not show the friction force at standstill and reversal",
        "friction sticks: at standstill its force is unknown",
        "raise the amplitude, or keep the axis moving (excitation moving_sine, estimator moving_axis)",
    ),
    "leakage": Kind(
        "the windows leak, as windows of another length show; the confidence band includes it",
        "a window is short beside the machine's response",
        "use a longer window, local_polynomial, or a periodic excitation",
    ),
    "undetermined": Kind(
        "the record does not determine the response",
        "the confidence band is as wide as the response",
        "excite more there, or record for longer",
    ),
    "misfit": Kind(
        "the model does not explain what was measured",
        "a wrong law, gain, sign or dead time, or friction that depends on what the model does not contain",
        "check the channels and the delays, or take another model",
    ),
    "not identifiable": Kind(
        "not identifiable from this record",
        "the motion does not tell the parameter apart from others",
        "vary amplitude and speed, from presliding to sliding",
    ),
    "outside its window": Kind(
        "outside the settling window at the end of the dwell time",
        "wrong friction compensation, plant gain or modes, or a window that the encoder does not resolve",
        "improve the friction model or the design model, or allow a longer dwell time or a wider settling window",
    ),
    "no longer than its window": Kind(
        "no longer than the settling window, which tests nothing",
        "a move within its own window is settled before it begins",
        "lower 'settling_window', or move farther",
    ),
    "spikes": Kind(
        "it leaps away and back, which no machine can",
        "lost or wrong samples of a sensor",
        "interpolate them before the import, or leave them out (--start-time, --end-time)",
    ),
    "clipped": Kind(
        "it stops at an end of its range and moves fast just before, as if it were clipped",
        "a sensor or a converter at its limit",
        "record with a larger range or a smaller excitation",
    ),
    "held samples": Kind(
        "it changes at every so many samples only",
        "the drive refreshes the position more slowly than it is recorded, which delays it",
        "record at the rate at which it is refreshed",
    ),
    "lost signal": Kind(
        "it stays at one value and moves fast just before or after",
        "a sensor or a connection that was interrupted",
        "leave it out (--start-time, --end-time) or record again",
    ),
    "wraps": Kind(
        "it jumps by nearly its whole range, as an angle or counter that wraps",
        "an encoder within a turn, or a counter",
        "unwrap the column before the import",
    ),
    "implausible unit": Kind(
        "no machine has such values",
        "a wrong unit, gain or scale of a column",
        "correct unit and gain in record.channels",
    ),
    "doubtful lines": Kind(
        "far weaker in the input than the lines beside them, as friction and feedback make them",
        "a controller's input also contains what friction has made",
        "give the injected signal as channel 'reference' or 'excitation', or give harmonics, or min_frequency and "
        "max_frequency",
    ),
    "wrong column": Kind(
        "a column is not what it is said to be",
        "another unit, gain or sign, a delay, swapped columns, or another controller than the study's",
        "correct record.channels or record.controller",
    ),
    "not verified": Kind(
        "nothing shows that the columns are what they are said to be",
        "the record states a part of its loop: the controller, or the excitation of its segments",
        "state the machine's controller in record.controller, the excitation in record.segments, u in N or N m, and y "
        "in m or rad",
    ),
    REMARK: Kind("", "what is particular to an estimator or a record", "as the message says"),
}
"""All kinds of findings by their names; `docs/troubleshooting.md` lists them."""


LENGTH_SCALES = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (1e-7, 1e6, "µ"), (1e-12, 1e9, "n"))
"""Least length [m], factor and prefix of the units in which lengths are readable."""


@dataclass(frozen=True)
class Quantity:
    """A number with its unit, as a part of a finding or of an error."""

    value: float
    """Infinite where it has no bound."""
    unit: str
    name: str = ""
    frequency: float | None = None
    """Where it was found [Hz]; None if it belongs to no frequency."""

    def __str__(self) -> str:
        """Return its words: ``error of the response 0.3 dB at 5 Hz``."""
        factor, prefix = self._scale
        number = (
            f"{factor * self.value:.4g} {prefix}{with_powers(self.unit)}".removesuffix(" 1").replace(" °", "°").rstrip()
        )
        number = "without bound" if math.isinf(self.value) else number
        where = "" if self.frequency is None else f"at {self.frequency:.4g} Hz"
        return " ".join(filter(None, (self.name, number, where)))

    @property
    def _scale(self) -> tuple[float, str]:
        """Factor and prefix with which a length or an angle is readable."""
        if self.unit not in ("m", "rad") or not self.value:
            return 1.0, ""
        known = ((factor, prefix) for least, factor, prefix in LENGTH_SCALES if abs(self.value) >= least)
        return next(known, (1.0, ""))  # of what is not a number, or no length that is readable


@dataclass(frozen=True)
class Finding:
    """A doubt about a result, or the cause of its outcome."""

    kind: str
    """Name of its kind, such as ``still settling``."""
    quantities: tuple[Quantity, ...] = ()
    frequencies: tuple[float, ...] = ()
    """Frequencies that it concerns [Hz]; empty if it belongs to none."""
    examined: int = 0
    """Number of frequencies that were examined; 0 if that does not matter."""
    place: str = ""
    """Channel, contact, segment or record that it concerns; empty for all of them."""
    text: str = ""
    """What was found, where it is more than the words of the kind."""
    remedy: str = ""
    """What helps here, where that is more than the remedy of the kind."""
    error: float = 0.0
    """Relative error that it stands for, which no band contains: the accuracy of a study may allow it."""

    def __str__(self) -> str:
        """Return its words in one line."""
        kind = KINDS.get(self.kind, Kind(f"finding '{self.kind}' of another version of fraexp", "", ""))
        found = f"{self.place}: " * bool(self.place) + (self.text or kind.words) + self._frequency_words()
        quantities = ", ".join(map(str, self.quantities))
        remedy = self.remedy or kind.remedy * (self.kind != REMARK)
        return "; ".join(filter(None, (": ".join(filter(None, (found, quantities))), remedy)))

    def _frequency_words(self) -> str:
        if not self.frequencies:
            return ""
        count, span = len(self.frequencies), frequency_text(self.frequencies)
        return f" at {count} of {self.examined} frequencies ({span})" if self.examined else f" at {span}"

    def plain(self) -> dict[str, Any]:
        """Return plain data from which `from_plain` builds it again; what it does not say is left out."""
        data = {of.name: getattr(self, of.name) for of in fields(self) if getattr(self, of.name) != of.default}
        if self.quantities:
            data["quantities"] = [
                [of.value if math.isfinite(of.value) else None, of.unit, of.name, of.frequency]
                for of in self.quantities
            ]
        return data | ({"frequencies": list(self.frequencies)} if self.frequencies else {})

    @classmethod
    def from_plain(cls, data: Mapping[str, Any]) -> "Finding":
        """Return a finding from plain data, of whatever kind; TypeError or ValueError if they are not that of one."""
        known = {of.name: data[of.name] for of in fields(cls) if of.name in data}
        quantities = tuple(
            Quantity(math.inf if value is None else float(value), str(unit), str(name), at)
            for value, unit, name, at in data.get("quantities", ())
        )
        frequencies = tuple(map(float, data.get("frequencies", ())))
        return cls(**{**known, "quantities": quantities, "frequencies": frequencies})


def remarks(*items: Finding | str | None) -> tuple[Finding, ...]:
    """Return findings as they are, and texts as remarks; without what is empty or None."""
    return tuple(Finding(REMARK, text=of) if isinstance(of, str) else of for of in items if of)


def message_of(findings: Iterable[Finding]) -> str:
    """Return the words of findings in one line; empty without any."""
    return "; ".join(map(str, findings))


def at_worst(
    kind: str,
    frequency: NDArray[np.float64],
    where: NDArray[np.bool_],
    error: NDArray[np.float64] | NDArray[np.complex128],
    name: str = "error",
    **more: Any,
) -> Finding:
    """Return a finding at some of the frequencies [Hz], with the greatest of the relative errors there in dB, (n,).

    Complex errors are known; of others only the size is. `more` are other fields of the finding.
    """
    worst = int(np.argmax(np.where(where, np.nan_to_num(np.abs(error), nan=0.0, posinf=np.inf), -1.0)))
    level = Quantity(_decibels(error[worst].item()), "dB", name, float(frequency[worst]))
    others = more.pop("quantities", ())
    return Finding(kind, (level, *others), tuple(map(float, frequency[where])), where.size, **more)


def _decibels(error: complex | float) -> float:
    """Return the change of a level by a relative error [dB]; the greatest one, by 1 - e, if only its size is known."""
    left = abs(1 + error) if isinstance(error, complex) else max(1 - error, 0.0)
    return abs(20 * math.log10(left)) if left else math.inf
