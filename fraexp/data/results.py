"""What is learnt from signals: frequency responses with covariance, metrics, curves, and the outcome."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.findings import Finding, message_of, remarks

HARMONICS = 7
"""Highest harmonic of the output that is kept with each frequency."""

EFFORT = ("stroke", "peak force", "measuring time")
"""Names of the metrics that tell what an experiment takes on a machine: every simulated one has them."""


class Outcome(Enum):
    """How a computation ended; the value is the remedy."""

    OK = ""
    NOT_SETTLED = "raise excitation.settling_timeout, or loosen excitation.settling_tolerance"
    INACCURATE = "do what the message advises; if it lists frequencies, the others are valid"
    NO_MOTION = (
        "raise excitation.amplitude, or use an encoder of finer resolution; of a record, state excited frequencies only"
    )
    DIVERGED = (
        "the loop is unstable, or moves beyond loop.divergence_limit; lower the controller gain, the dead time, the "
        "amplitude, or the distance"
    )
    ERROR = "see the message, and the log that fraexp show prints"
    DAMAGED = (
        "what the database has stored of it is damaged: fraexp delete it and run its study again, or restore a copy; "
        "fraexp merge saves all that is sound into a new database"
    )

    @property
    def words(self) -> str:
        """The name as people read it, such as ``not settled``."""
        return self.name.lower().replace("_", " ")


UNUSABLE_OUTCOMES = (Outcome.NO_MOTION, Outcome.DIVERGED, Outcome.ERROR, Outcome.DAMAGED)
"""Outcomes of sweeps from which nothing can be learnt."""
EXTREMUM_CURVES = {"resonances": 1.0, "antiresonances": -1.0}
"""Names of the curves that list extrema of a fitted plant, and their sign in what is drawn of them."""
DISTORTION_CURVE, PARITIES = "distortion levels", ("odd", "even")
"""Name of the curve with the levels of distortions in the output of one realisation, and its columns."""


@dataclass(frozen=True)
class FrequencyResponse:
    """A complex response from one channel to another, with its covariance, frequency by frequency."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (n,)."""
    response: NDArray[np.complex128]
    """Complex response [unit], shape (n,)."""
    covariance: NDArray[np.float64]
    """Covariance of (real, imaginary) part [unit²], shape (n, 2, 2); NaN where unknown."""
    unit: str
    """Unit of the response, such as ``m/N``."""
    input: str
    """Name of the input, such as ``u`` or ``u_e``."""
    output: str
    """Name of the output, such as ``y``."""
    input_amplitude: NDArray[np.float64]
    """Amplitude of the input [its unit], shape (n,)."""
    output_amplitude: NDArray[np.float64]
    """Amplitude of the output [its unit], shape (n,)."""
    settled: NDArray[np.bool_]
    """Whether successive periods agreed, shape (n,) of bool."""
    settling_time: NDArray[np.float64]
    """Time until they did [s], shape (n,); NaN for a record that does not tell."""
    residual: NDArray[np.float64]
    """Relative difference of the last two periods compared, shape (n,); NaN where unknown."""
    harmonics: NDArray[np.complex128]
    """Harmonics 2…7 of the output relative to its fundamental, complex, shape (n, 6)."""
    freedom: NDArray[np.float64] | None = None
    """Degrees of freedom of the covariance, such as 2(P - 1) for P periods, shape (n,); None for a known one."""
    noise_variance: NDArray[np.float64] | None = None
    """Variance E|dG|² of the response by noise alone [unit²], shape (n,); None where it is not told apart."""
    nonlinear_variance: NDArray[np.float64] | None = None
    """Variance of one realisation by stochastic nonlinear distortions [unit²], shape (n,); None if not told apart."""
    coherence: NDArray[np.float64] | None = None
    """Squared coherence of input and output, shape (n,); None where it is not known."""
    model_covariance: NDArray[np.float64] | None = None
    """Covariance of (real, imaginary) part of 1/response by the friction model's errors [1/unit²], (n, 2, 2)."""
    numerical_error: NDArray[np.float64] | None = None
    """Estimated relative error of the response by the computation itself, shape (n,); None if it is not estimated."""

    @property
    def standard_deviation(self) -> NDArray[np.float64]:
        """Standard deviation of the complex response [unit], shape (n,); NaN where unknown."""
        return np.sqrt(self.covariance[:, 0, 0] + self.covariance[:, 1, 1])

    def ascending(self) -> "FrequencyResponse":
        """Return its points in the order of their frequencies."""
        order = np.argsort(self.frequency, kind="stable")
        if np.array_equal(order, np.arange(order.size)):
            return self
        parts: dict[str, Any] = {name: part[order] for name, part in vars(self).items() if isinstance(part, np.ndarray)}
        return replace(self, **parts)

    @property
    def distortion(self) -> NDArray[np.float64]:
        """Total harmonic distortion of the output over the known harmonics 2…7, shape (n,); NaN where none is known."""
        known = np.isfinite(self.harmonics)
        total = np.sum(np.where(known, np.abs(self.harmonics), 0.0) ** 2, axis=1)
        return np.where(known.any(axis=1), np.sqrt(total), np.nan)


@dataclass(frozen=True)
class Metric:
    """One named number with its unit."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True)
class Curve:
    """Named columns of equal length, such as a hysteresis loop; the first one is the abscissa."""

    name: str
    columns: dict[str, NDArray[np.float64]]
    units: dict[str, str]


@dataclass(frozen=True)
class Fit:
    """A component identified from signals: ready to be used, with the covariance of what was identified."""

    kind: str
    """Kind of the component, such as ``plant`` or ``friction``."""
    component: Mapping[str, Any]
    """The component as a study names it: name, version and parameters."""
    parameters: tuple[str, ...]
    """Names of the p parameters that were identified, such as ``gain`` or ``frequencies.0``."""
    units: tuple[str, ...]
    """Their units."""
    values: NDArray[np.float64]
    """Their values [their units], shape (p,)."""
    covariance: NDArray[np.float64]
    """Covariance of the values [products of their units], shape (p, p); NaN where unknown, 0 where held."""

    @property
    def standard_deviation(self) -> NDArray[np.float64]:
        """Standard deviation of each value [its unit], shape (p,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Result:
    """All that one sweep has taught."""

    outcome: Outcome
    findings: tuple[Finding, ...] = ()
    """Doubts about it, and causes of its outcome; empty when all is well."""
    response: FrequencyResponse | None = None
    metrics: tuple[Metric, ...] = ()
    curves: tuple[Curve, ...] = ()
    fits: tuple[Fit, ...] = ()
    numerics: str = ""
    """How the signals were simulated, such as ``5 steps per sample, 8 lanes``; empty for measured ones."""
    elapsed: float = field(default=0.0, compare=False)
    """Computing time [s] of this sweep (its share, where sweeps share an experiment)."""

    @property
    def message(self) -> str:
        """What exactly happened, in one line; empty when all is well."""
        return message_of(self.findings)

    def with_findings(self, *found: Finding | str | None, is_doubt: bool = False) -> "Result":
        """Return a result with further findings, of which a text is a remark; with one that is a doubt it is not ok."""
        more = remarks(*found)
        doubted = is_doubt and bool(more) and self.outcome is Outcome.OK
        outcome = Outcome.INACCURATE if doubted else self.outcome
        return replace(self, outcome=outcome, findings=(*self.findings, *more))

    @property
    def parity_levels(self) -> dict[str, NDArray[np.float64]]:
        """Odd and even distortions with noise, by name, over the output, at the frequencies of the response [1], (n,).

        Empty if they are not told apart, which needs detection lines.
        """
        found = [curve.columns for curve in self.curves if curve.name == DISTORTION_CURVE]
        needed = ("frequency", "output", *PARITIES)
        if self.response is None or not found or not all(set(needed) <= set(columns) for columns in found):
            return {}
        joined = {name: np.concatenate([columns[name] for columns in found]) for name in needed}
        if not np.array_equal(joined["frequency"], self.response.frequency):
            return {}
        with np.errstate(divide="ignore", invalid="ignore"):
            return {name: joined[name] / joined["output"] for name in PARITIES}
