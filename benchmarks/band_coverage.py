"""Measure the coverage of the stored 95 % bands: Monte Carlo on a linear plant with known noise.

    python benchmarks/band_coverage.py                 1000 experiments for each estimator
    python benchmarks/band_coverage.py --reduced       150 experiments
    python benchmarks/band_coverage.py --only joint    those whose name contains a word

A circle around the response, the limits of its magnitude and those of its phase must each cover the true value at
95 ± 2 % of all frequencies and experiments. The loop is discrete: what the estimators are compared with is exact. The
noise is coloured, continues from period to period and is fed back. Rows with a cubic input nonlinearity are compared
with its best linear approximation. The last rows have no noise: median errors.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from harness import Bench, run
from scipy.signal import cont2discrete, lfilter

from fraexp.analysis.confidence import circle_factor, confidence_limits, degrees_of_freedom
from fraexp.components.kinds import Estimator
from fraexp.components.registry import create, discover
from fraexp.data.results import FrequencyResponse
from fraexp.data.signals import Segment, Signals

SAMPLE_TIME_S = 1e-3
PERIOD = 512
"""Samples per period."""
UNITS = {"u": "N", "y": "m", "excitation": "N"}
CONTROLLER = np.array([1.5, -1.2])
"""Of position, in ascending powers of z⁻¹ [N/m]."""
COLOUR = np.array([1.0, -0.6])
"""Poles of the noise."""
CUBIC = 0.05
"""Coefficient of the cubic input nonlinearity [1/N²]."""
REGISTRY = discover()
LEVEL, TOLERANCE = 0.95, 0.02
WARM_UP = 1024
"""Samples after which noise in the loop is stationary."""

LOWEST, HIGHEST = 5, 151
GRID = np.arange(LOWEST, HIGHEST + 1, 2)
Recorded = Iterator[Signals]


Polynomials = tuple[np.ndarray, np.ndarray]
"""Numerator and denominator in powers of z⁻¹."""


def held(numerator: list[float] | np.ndarray, denominator: list[float] | np.ndarray) -> Polynomials:
    """Return a continuous plant behind a hold."""
    discrete, poles, _ = cont2discrete((numerator, denominator), SAMPLE_TIME_S, method="zoh")
    return discrete.ravel(), poles


PLANT = held([(2 * np.pi * 100.0) ** 2], [1, 0.6 * 2 * np.pi * 100.0, (2 * np.pi * 100.0) ** 2])
"""A resonance of 100 Hz with a damping ratio of 0.3."""
NUMERATOR, DENOMINATOR = PLANT
CLOSED = np.polyadd(np.append(DENOMINATOR, 0.0), np.convolve(CONTROLLER, NUMERATOR))
"""Characteristic polynomial of the loop."""


def gain(plant: Polynomials, cycles: np.ndarray) -> np.ndarray:
    """Return a plant's response at frequencies in cycles per sample."""
    numerator, denominator = (np.polynomial.polynomial.polyval(np.exp(-2j * np.pi * cycles), each) for each in plant)
    return numerator / denominator


def multisine(generator: np.random.Generator, shape: tuple[int, ...], lines: np.ndarray) -> np.ndarray:
    """Return periods of random-phase multisines with a root mean square of 1 N, shape (..., samples)."""
    bins = np.zeros((*shape, PERIOD // 2 + 1), dtype=complex)
    bins[..., lines] = np.exp(2j * np.pi * generator.random((*shape, lines.size)))
    return np.fft.irfft(bins * PERIOD / np.sqrt(2 * lines.size))


def coloured(generator: np.random.Generator, shape: tuple[int, ...], deviation: float) -> np.ndarray:
    """Return stationary noise."""
    white = generator.standard_normal((*shape[:-1], shape[-1] + WARM_UP)) * deviation
    return lfilter([1.0], COLOUR, white)[..., WARM_UP:]


def closed_loop(r: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return control input u = r - C y and output y = G u + v from rest, filtered along the last axis."""
    # (1 + GC)⁻¹ = DENOMINATOR/CLOSED, G (1 + GC)⁻¹ = NUMERATOR/CLOSED
    y = lfilter(NUMERATOR, CLOSED, r) + lfilter(DENOMINATOR, CLOSED, v)
    return r - lfilter(CONTROLLER, [1.0], y), y


@dataclass(frozen=True)
class Periodic:
    """Multisines in closed loop: realisations of periods, recorded from rest or once settled."""

    realisations: int = 1
    periods: int = 6
    omitted: int = 0
    """One of so many lines is left out."""
    from_rest: bool = False
    cubic: float = 0.0
    """Where it is not 0 the loop is open and the plant's input is u + cubic u³."""
    noise: float = 0.02

    def lines(self, generator: np.random.Generator) -> np.ndarray:
        """Return the excited lines."""
        if not self.omitted:
            return GRID
        groups = GRID.size // self.omitted
        return np.delete(GRID, self.omitted * np.arange(groups) + generator.integers(self.omitted, size=groups))

    def __call__(self, generator: np.random.Generator, count: int) -> Recorded:
        """Yield the signals of so many experiments."""
        lines = self.lines(generator)
        shape = (count, self.realisations)
        r = multisine(generator, shape, lines)
        before = 0 if self.from_rest else 4
        whole = np.tile(r, self.periods + before)
        v = coloured(generator, whole.shape, self.noise)
        if self.cubic:
            u, y = whole, lfilter(NUMERATOR, DENOMINATOR, whole + self.cubic * whole**3) + v
        else:
            u, y = closed_loop(whole, v)
        folded = (*shape, self.periods, PERIOD)
        cut = {name: x[..., before * PERIOD :].reshape(folded) for name, x in (("u", u), ("y", y))}
        cut["excitation"] = np.broadcast_to(r[:, :, None], folded)
        for number in range(count):
            yield Signals(
                tuple(
                    Segment(SAMPLE_TIME_S, {name: x[number, m] for name, x in cut.items()}, lines)
                    for m in range(self.realisations)
                ),
                UNITS,
            )

    def truth(self, frequency: np.ndarray) -> np.ndarray:
        """Return the plant, or its best linear approximation: 1 + α(3σ² - ¾A²) for random phases and equal lines."""
        excited = self.lines(np.random.default_rng()).size
        best = 1 + self.cubic * (3 - 0.75 * 2 / excited)
        return gain(PLANT, frequency * SAMPLE_TIME_S) * best


def antiresonance(zero: float, zero_damping: float, pole: float, pole_damping: float) -> Polynomials:
    """Return a plant with an antiresonance, a resonance [Hz] and a low-pass of 250 Hz."""
    pairs = ((2 * np.pi * zero, zero_damping), (2 * np.pi * pole, pole_damping))
    zeros, poles = ([1 / omega**2, 2 * zeta / omega, 1] for omega, zeta in pairs)
    return held(np.array(zeros), np.polymul(poles, [1 / (2 * np.pi * 250), 1]))


UNITY: Polynomials = (np.ones(1), np.ones(1))
DIP = antiresonance(80, 0.02, 140, 0.03)


@dataclass(frozen=True)
class Sandwich:
    """A plant, u + cubic u³ and another plant in open loop (Wiener-Hammerstein), periodic, with noise at the output."""

    before: Polynomials = UNITY
    after: Polynomials = UNITY
    cubic: float = 0.0
    noise: float = 0.02
    periods: int = 1

    def __call__(self, generator: np.random.Generator, count: int) -> Recorded:
        """Yield the signals of so many experiments."""
        for _ in range(count):
            lines = Periodic(omitted=4).lines(generator)
            u = multisine(generator, (), lines)
            x = self.periodic(self.before, u)
            y = self.periodic(self.after, x + self.cubic * x**3)
            v = coloured(generator, (self.periods * PERIOD,), self.noise).reshape(self.periods, PERIOD)
            blocks = np.tile(u, (self.periods, 1))
            yield Signals((Segment(SAMPLE_TIME_S, {"u": blocks, "y": y + v, "excitation": blocks}, lines),), UNITS)

    def periodic(self, plant: Polynomials, u: np.ndarray) -> np.ndarray:
        """Return the periodic response to a period."""
        return np.fft.irfft(np.fft.rfft(u) * gain(plant, np.arange(PERIOD // 2 + 1) / PERIOD), PERIOD)

    def truth(self, frequency: np.ndarray) -> np.ndarray:
        """Return the best linear approximation: G_1 G_2 (1 + α(3σ² - ¾A²)) with the line's amplitude A before u³."""
        first, second = (gain(plant, frequency * SAMPLE_TIME_S) for plant in (self.before, self.after))
        squares = np.abs(first) ** 2 / frequency.size
        return first * second * (1 + self.cubic * (3 * squares.sum() - 1.5 * squares))


@dataclass(frozen=True)
class Random:
    """One long record with random excitation, its noise at output, input or both, in open or closed loop."""

    noisy: str = "y"
    closed: bool = False
    windows: int = 32
    noise: float = 0.3

    def __call__(self, generator: np.random.Generator, count: int) -> Recorded:
        """Yield the signals of so many experiments."""
        length = self.windows * PERIOD
        lines = np.arange(LOWEST, HIGHEST + 1)
        for _ in range(count):
            r = generator.standard_normal(length + WARM_UP)
            if self.closed:
                u, y = closed_loop(r, coloured(generator, r.shape, self.noise))
            else:
                u, y = r, lfilter(NUMERATOR, DENOMINATOR, r)
                if self.noisy in ("u", "both"):
                    u = u + self.noise * generator.standard_normal(r.size)
                if self.noisy in ("y", "both"):  # as noisy for its size as the input, at each frequency
                    y = y + self.noise * lfilter(NUMERATOR, DENOMINATOR, generator.standard_normal(r.size))
            channels = {"u": u, "y": y, "excitation": r}
            cut = {name: x[WARM_UP:].reshape(self.windows, PERIOD) for name, x in channels.items()}
            yield Signals((Segment(SAMPLE_TIME_S, cut, lines),), UNITS)

    def truth(self, frequency: np.ndarray) -> np.ndarray:
        """Return the plant."""
        return gain(PLANT, frequency * SAMPLE_TIME_S)


@dataclass(frozen=True)
class Case:
    """An estimator and what it is given."""

    what: str
    source: Periodic | Random | Sandwich
    spec: dict[str, Any] = field(default_factory=dict)


WINDOW = PERIOD * SAMPLE_TIME_S
FRICTIONLESS: dict[str, Any] = {"name": "effective_input", "friction": {"name": "none"}, "zero_order_hold": False}
BEST, FAST = {"name": "best_linear_approximation"}, {"name": "fast_best_linear_approximation"}
JOINT = {"name": "joint_input_output"}
CASES = (
    Case("conventional, 2 periods", Periodic(periods=2, noise=0.01), {"name": "conventional"}),
    Case("conventional, 6 periods", Periodic(), {"name": "conventional"}),
    Case("effective_input, frictionless, 6 periods", Periodic(), FRICTIONLESS),
    Case("best_linear_approximation, 1 x 6 periods", Periodic(), BEST),
    Case("best_linear_approximation, 6 x 2 periods", Periodic(6, 2), BEST),
    Case("best_linear_approximation, 7 x 2, cubic", Periodic(7, 2, cubic=CUBIC), BEST),
    Case("best_linear_approximation in effective_input", Periodic(6, 2), {**FRICTIONLESS, "method": BEST}),
    Case("fast_best_linear_approximation, 6 periods", Periodic(omitted=4), FAST),
    Case("fast_best_linear_approximation, cubic", Periodic(omitted=4, cubic=CUBIC), FAST),
    Case("fast_best_linear_approximation, 4 realisations, cubic", Periodic(4, 2, omitted=4, cubic=CUBIC), FAST),
    Case("fast_best_linear_approximation, 1 period, dip", Sandwich(after=DIP), FAST),
    Case("fast_best_linear_approximation, 4 periods, dip", Sandwich(after=DIP, periods=4), FAST),
    Case("fast_best_linear_approximation, cubic, dip", Sandwich(after=DIP, cubic=CUBIC), FAST),
    Case(
        "fast_best_linear_approximation, sandwich",
        Sandwich(antiresonance(70, 0.05, 120, 0.1), PLANT, cubic=0.004, noise=0.002),
        FAST,
    ),
    Case("joint_input_output, 6 periods", Periodic(), JOINT),
    Case("joint_input_output, 6 x 2 periods", Periodic(6, 2), JOINT),
    Case("joint_input_output, windows", Random(closed=True, noise=0.2), {**JOINT, "window": WINDOW}),
    Case("h1_h2_hv, h1, noisy output", Random("y"), {"name": "h1_h2_hv"}),
    Case("h1_h2_hv, h1, few windows", Random("y", windows=8), {"name": "h1_h2_hv"}),
    Case("h1_h2_hv, h2, noisy input", Random("u"), {"name": "h1_h2_hv", "variant": "h2"}),
    Case("h1_h2_hv, hv, both noisy", Random("both"), {"name": "h1_h2_hv", "variant": "hv"}),
    Case("local_polynomial, from rest", Periodic(from_rest=True), {"name": "local_polynomial"}),
    Case("local_polynomial, 6 x 2, from rest", Periodic(6, 2, from_rest=True), {"name": "local_polynomial"}),
    Case(
        "local_polynomial, random, closed",
        Random(closed=True, noise=0.04),
        {"name": "local_polynomial", "variant": "arbitrary"},
    ),
    Case("local_rational, from rest", Periodic(from_rest=True), {"name": "local_rational"}),
    Case(
        "local_rational, random, closed",
        Random(closed=True, noise=0.04),
        {"name": "local_rational", "variant": "arbitrary"},
    ),
)

EXACT = (
    (Case("conventional, settled", Periodic(noise=0.0), {"name": "conventional"}), 1e-8),
    (Case("best_linear_approximation, settled", Periodic(4, 2, noise=0.0), BEST), 1e-8),
    (Case("joint_input_output, settled", Periodic(4, 2, noise=0.0), JOINT), 1e-8),
    (Case("local_polynomial, from rest", Periodic(from_rest=True, noise=0.0), {"name": "local_polynomial"}), 1e-9),
    (Case("local_rational, from rest", Periodic(from_rest=True, noise=0.0), {"name": "local_rational"}), 1e-9),
)
"""Without noise: a case and the greatest median error."""


def hits(response: FrequencyResponse, truth: np.ndarray) -> np.ndarray:
    """Return whether circle, magnitude limits and phase limits cover the true value, shape (3, n) of bool."""
    ratio = truth / response.response
    radius = response.standard_deviation * circle_factor(degrees_of_freedom(response))
    magnitude, phase = confidence_limits(response)
    return np.array([
        np.abs(response.response - truth) <= radius,
        (magnitude[0] <= np.abs(ratio)) & (np.abs(ratio) <= magnitude[1]),
        (phase[0] <= np.angle(ratio)) & (np.angle(ratio) <= phase[1]),
    ])  # fmt: skip


def estimated(case: Case, bench: Bench, experiments: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frequencies, whether each of the three bands covers, and relative errors: (n,), (3, n), (n,)."""
    estimator, generator = create(REGISTRY, Estimator, case.spec), bench.generator()
    inside, errors, frequencies = [], [], []
    for begin in range(0, experiments, 50):
        for signals in case.source(generator, min(50, experiments - begin)):
            response = estimator.estimate(signals).response
            if response is None:
                raise SystemExit(f"{case.what}: no response")
            truth = case.source.truth(response.frequency)
            inside.append(hits(response, truth))
            errors.append(np.abs(response.response / truth - 1))
            frequencies.append(response.frequency)
    return np.concatenate(frequencies), np.hstack(inside), np.concatenate(errors)


def noisy(bench: Bench) -> None:
    """Coverage [%] of circle, magnitude and phase; of the circle at its worst line; median error."""
    for case in CASES:
        if bench.options.only not in case.what:
            continue
        frequency, inside, errors = estimated(case, bench, bench.options.experiments)
        shares = inside.mean(axis=1)
        at, place = np.unique(np.round(frequency, 6), return_inverse=True)
        lines = np.bincount(place, inside[0]) / np.bincount(place)
        text = " ".join(f"{100 * share:6.2f}" for share in shares)
        text += f"   {100 * lines.min():5.1f} at {at[np.argmin(lines)]:5.1f} Hz   {np.median(errors):.2%}"
        is_met = bool(np.all(np.abs(shares - LEVEL) <= TOLERANCE))
        bench.row(case.what, text, is_met, **dict(zip(("circle", "magnitude", "phase"), shares.tolist(), strict=True)))


def exact(bench: Bench) -> None:
    """Median error without noise."""
    for case, bound in EXACT:
        if bench.options.only in case.what:
            bench.bounded(case.what, float(np.median(estimated(case, bench, 3)[2])), bound)


if __name__ == "__main__":
    run(__doc__, noisy, exact, experiments=(1000, 150), only="")
