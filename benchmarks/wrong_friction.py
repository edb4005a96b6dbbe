"""Count how often the band of the proposed method holds the plant if its friction model is wrong.

The paper's machine has an encoder of 0.1 µm. Drawn sweeps have all laws, any amplitudes, frequencies and encoders, and
models that are off as their prior says, the dead time of every second one too. A point is *wrong* if it is ok, off by
more than twice the accuracy, and not in its 99.9 % band.

The width of a band is compared with that of an ideal posterior: of the scales of friction, with their prior, from the
harmonics of the true motion on which P is known, and what the encoder hides of that, by the published equations of the
laws (`reference_laws`). The same tells where a model that is known has to be ok.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from drawn_machines import TOLERANCE, DrawnMachine, drawn_machine
from friction_bands import within_limits
from harness import Bench, run
from numba import njit
from paper_machine import PAPER, REGISTRY, decibel, machine_of, response_of, simulated
from reference_laws import COULOMB, mean_force
from scipy.interpolate import CubicSpline

from fraexp.analysis.confidence import BandReach, confidence_limits
from fraexp.components.kinds import Estimator
from fraexp.components.registry import create
from fraexp.data.results import FrequencyResponse
from fraexp.data.signals import Segment, Signals
from fraexp.simulation.machine import Machine
from fraexp.study.accuracy import Accuracy

SWEEPS = {
    "12 N, 8 points 5…50 Hz": (12.0, 5, 50, 8),
    "12 N, 5 points 1…10 Hz": (12.0, 1, 10, 5),
    **{f"{amplitude} N, 30 points 1…200 Hz": (amplitude, 1, 200, 30) for amplitude in (3, 5, 7, 12)},
    "40 N, 5 points 1…10 Hz": (40.0, 1, 10, 5),
}
SCALES = (1.0, 1.05, 1.2)
HELD, OFF, ATTAINED = 0.93, 0.05, 0.9
"""Share of the points whose band holds the plant, at least; of those that are ok and off by more than the accuracy, at
most; and of those that are ok, with a model that is known, where the encoder allows it."""
WIDTH, TELLING_DB = 1.3, 3.0
"""Width of a band over that of the ideal posterior, at most; where the latter is no wider than this, either side."""
PRIOR_STD, DEAD_TIME_STD, STEP, FINER, DRAWS = 0.1, 12**-0.5, 1e-3, 8, 16
"""Of both scales of friction; their step for derivatives; points of a motion in each sample; motions that are drawn."""
CERTAIN = {"force_std": 0.0, "displacement_std": 0.0, "dead_time_std": 0.0}
WIDER = 3.29 / 1.96  # a band of 99.9 % over one of 95 %
ACCURACY = Accuracy()


class Points(NamedTuple):
    """Of a sweep's settled points: the error of the magnitude [dB], and what is so, shape (n,) each."""

    error: np.ndarray
    is_off: np.ndarray
    is_held: np.ndarray
    is_ok: np.ndarray
    is_wrong: np.ndarray


def points_of(response: FrequencyResponse, machine: Machine) -> Points:
    """Return what a response says."""
    truth = machine.response(2 * np.pi * response.frequency)
    ratio, model = truth / response.response, response.model_covariance
    error, turn = np.abs(decibel(ratio)), np.abs(np.angle(ratio))
    wide = replace(
        response,
        covariance=WIDER**2 * response.covariance,
        model_covariance=None if model is None else WIDER**2 * model,
    )
    is_held, is_near = (within_limits(each, truth, 1e-4).all(axis=0) for each in (response, wide))
    is_ok = BandReach.of(response).is_within()
    is_off, is_far = ((error > part * ACCURACY.magnitude) | (turn > part * ACCURACY.phase) for part in (1, 2))
    columns = (error, is_off, is_held, is_ok, is_ok & is_far & ~is_near)
    return Points(*(column[response.settled] for column in columns))


def estimated(
    machine: Machine, sections: dict[str, Any], signals: Signals, late: float = 0.0, **scales: float
) -> FrequencyResponse:
    """Return P̂ if the model is off by these factors, and its dead time `late` [s] too long."""
    paths = ("dead_time", "time_constants", "resolution", "noise")
    given = {key: value for key, value in sections["loop"].items() if key.endswith(paths)}
    given["input_dead_time"] = max(given.get("input_dead_time", 0.0) + late, 0.0)
    own = {"name": "effective_input", "friction": sections["friction"], **given, **scales}
    return response_of(create(REGISTRY, Estimator, own).estimate(signals))


def paper(bench: Bench) -> None:
    """Points that are ok, and the greatest error [dB]."""
    sections = {**PAPER, "loop": {**PAPER["loop"], "resolution": 1e-7}}
    machine = machine_of(sections)
    for name, (amplitude, low, high, count) in SWEEPS.items():
        sine = {"name": "stepped_sine", "amplitude": amplitude, "frequencies": tuple(np.geomspace(low, high, count))}
        signals = simulated(machine, sine)
        for scale in SCALES:
            found = points_of(estimated(machine, sections, signals, force_scale=scale), machine)
            text = f"{found.is_ok.sum():2d} of {found.is_ok.size} ok, held {found.is_held.mean():4.0%}"
            worst = found.error[found.is_ok].max(initial=0.0)
            text += f", off by {found.error.max():6.2f} dB, where ok {worst:5.2f} dB"
            bench.row(f"{name}, force × {scale:g}", text, worst <= 2 * ACCURACY.magnitude)


class Sweep(NamedTuple):
    """A drawn machine and its record, and an estimator's sections whose model is off by factors and late by a time."""

    drawn: DrawnMachine
    machine: Machine
    sections: dict[str, Any]
    signals: Signals
    late: float
    scales: dict[str, float]


def sweeps(bench: Bench) -> Iterator[Sweep]:
    """Yield as many drawn sweeps as the options say."""
    for number in range(bench.options.sweeps):
        random, machine = bench.generator(number), drawn_machine(number, bench.seed)
        sections = machine.sections()
        encoder = {"resolution": random.choice([0.0, 1e-8, 1e-7, 1e-6]), "noise": random.choice([0.0, 1e-8, 1e-7])}
        sections["loop"] |= {**encoder, "seed": number}
        low, high = np.sort(np.exp(random.uniform(np.log(1.0), np.log(machine.frequencies[-1]), 2)))
        points = tuple(np.geomspace(low, max(high, 1.5 * low), random.integers(3, 61)).tolist())
        amplitude = machine.amplitude / machine.relative_amplitude * np.exp(random.uniform(np.log(0.2), np.log(5)))
        sine = {"name": "stepped_sine", "amplitude": amplitude, "frequencies": points}
        sine["recorded_periods"] = int(random.choice([1, 2, 8]))
        force, width = 1 + PRIOR_STD * random.standard_normal(2)
        built = machine_of(sections, sections["numerics"])
        late = number % 2 * DEAD_TIME_STD * sections["loop"]["sample_time"] * random.standard_normal()
        scales = {"force_scale": float(force), "displacement_scale": float(width)}
        yield Sweep(machine, built, sections, simulated(built, sine), late, scales)
        if number % 20 == 19:
            print(f"  {number + 1} of {bench.options.sweeps} sweeps", file=sys.stderr, flush=True)


def drawn(bench: Bench) -> None:
    """Shares over all points, with the sweep as the unit of scatter."""
    found = [points_of(estimated(*each[1:5], **each.scales), each.machine) for each in sweeps(bench)]
    every = Points(*(np.concatenate(column) for column in zip(*found, strict=True)))
    scatter = np.std([each.is_held.mean() for each in found if each.is_held.size]) / np.sqrt(len(found))
    held, off = every.is_held.mean(), every.is_off[every.is_ok].mean() if every.is_ok.any() else 0.0
    apart = [every.is_held[each].mean() if each.any() else 1.0 for each in (every.is_ok, ~every.is_ok)]
    bench.row("points whose band holds the plant", f"{held:.1%} ± {2 * scatter:.1%}", held >= HELD)
    bench.row("of those that are ok, and of the others", "{:.1%}, {:.1%}".format(*apart))
    bench.row("of points that are ok, off by more than the accuracy", f"{off:.1%} of {every.is_ok.sum()}", off <= OFF)
    bench.row("points that are ok and wrong", f"{every.is_wrong.sum()}", not every.is_wrong.any())


@njit
def path_force(kind: int, path: np.ndarray, step: float, parameters: np.ndarray, states: int) -> np.ndarray:
    """Return the mean force [N] on each step of a closed path [m], after two turns along it, shape (n,)."""
    z, following, force = np.zeros(states + 1), np.zeros(states + 1), np.empty(path.size)
    for _turn in range(3):
        for i in range(path.size):
            force[i] = mean_force(kind, z, path[(i + 1) % path.size] - path[i], step, parameters, following)
            z, following = following, z
    return force


def friction_terms(drawn: DrawnMachine, segment: Segment, true: np.ndarray, width: float = 1.0) -> np.ndarray:
    """Return the terms of friction [N] along a period [m], at a sine and its harmonics, for wider deflections."""
    own = drawn.reference
    path = np.fft.irfft(np.fft.rfft(true), true.size * FINER) * FINER / width
    step = own.sample_time / FINER
    force = path_force(own.law, path, step, np.array(own.parameters), own.states)
    line = int(segment.lines[0])
    orders = np.arange(line, true.size // 2, line)
    return np.fft.rfft(force)[orders] * np.exp(-1j * np.pi * orders / path.size) * 2 / path.size


def likely_paths(segment: Segment, encoder: float) -> np.ndarray:
    """Return periods [m] that an encoder does not tell from the true one, shape (DRAWS, n).

    Who knew the power of each term would believe a share of what was measured; that leaves the parallel of both powers.
    """
    every, random = segment.channels["displacement"], np.random.default_rng(segment.samples)
    spectrum = np.fft.rfft(every.mean(axis=0))
    power, noise = np.abs(spectrum) ** 2 + 1e-300, encoder * every.shape[1]
    unknown = np.sqrt(power * noise / (power + noise) / 2)
    errors = random.standard_normal((DRAWS, spectrum.size)) + 1j * random.standard_normal((DRAWS, spectrum.size))
    return np.asarray(np.fft.irfft(spectrum + unknown * errors, every.shape[1], axis=1))


def ideal_reach(drawn: DrawnMachine, segments: Sequence[Segment], encoder: float, known: bool = False) -> np.ndarray:
    """Return how far P may be off [dB] at each sine, shape (n,): by encoder, and by friction and dead time if unknown.

    `encoder` is its variance in a period [m²], which acts on friction too; the simulation's tolerance is added. The
    apparent mass between the sines is a cubic spline through those that follow there, whose error is known.
    """
    frequency = np.array([segment.frequency[0] for segment in segments])
    omega = 2 * np.pi * frequency
    own, spline = drawn.reference, CubicSpline(np.log(frequency), np.eye(len(frequency)))
    mass = -1 / (omega**2 * own.plant(frequency))
    slopes, motions, variances = [], [], []
    for segment in segments:
        y, line = segment.channels["displacement"], int(segment.lines[0])
        terms, less, more = (friction_terms(drawn, segment, y.mean(axis=0), of) for of in (1.0, 1 - STEP, 1 + STEP))
        by_motion = np.var([friction_terms(drawn, segment, each) for each in likely_paths(segment, encoder)], axis=0)
        motions.append(np.fft.rfft(y.mean(axis=0))[line : y.shape[1] // 2 : line] * 2 / y.shape[1])
        multiples = segment.frequency[0] * np.arange(1, len(terms) + 1)
        plant = own.plant(multiples)
        late = 2j * np.pi * multiples * (terms + motions[-1] / plant)
        slopes.append(np.stack([terms, (more - less) / (2 * STEP), late], axis=1))
        variances.append(4 * encoder / y.shape[1] / np.abs(plant) ** 2 + np.abs(TOLERANCE * terms[0]) ** 2 + by_motion)
    apparent = np.array([y[0] for y in motions]) * omega**2
    of_mass = np.array([slope[0] for slope in slopes]) / apparent[:, None]
    mass_variance = np.array([variance[0] for variance in variances]) / np.abs(apparent) ** 2
    information = np.diag(1 / np.array([PRIOR_STD, PRIOR_STD, DEAD_TIME_STD * own.sample_time]) ** 2)
    for first, slope, y, variance in zip(frequency, slopes, motions, variances, strict=True):
        harmonics = first * np.arange(2, int(frequency[-1] / first * (1 + 1e-9)) + 1)[: len(y) - 1]
        told, weights = slice(1, 1 + harmonics.size), spline(np.log(harmonics))
        true, moved = -1 / own.plant(harmonics), (2 * np.pi * harmonics) ** 2 * y[told]
        missed = np.abs(weights @ mass - true / (2 * np.pi * harmonics) ** 2)
        scatter = variance[told] + np.abs(moved) ** 2 * (weights**2 @ mass_variance + missed**2)
        lacking = slope[told] - moved[:, None] * (weights @ of_mass)
        information = information + 2 * np.real(lacking.conj().T / scatter @ lacking)
    covariance = np.linalg.inv(information)
    relative = np.real(of_mass / mass[:, None])
    by_scales = 0.0 if known else np.einsum("ni,ij,nj->n", relative, covariance, relative)
    return decibel(np.exp(1.96 * np.sqrt(by_scales + mass_variance / np.abs(mass) ** 2 / 2 + TOLERANCE**2)))


def judged(bench: Bench, known: bool = False) -> np.ndarray:
    """Return of all settled points the reach of the ideal band [dB], that of the band, and 1 where it is ok, (3, n)."""
    rows = []
    for each in sweeps(bench):
        if each.drawn.reference.law == COULOMB:
            continue  # its force at standstill does not follow from the motion
        loop = each.sections["loop"]
        response = estimated(*each[1:4], **CERTAIN) if known else estimated(*each[1:5], **each.scales)
        noise, step, periods = loop["noise"], loop["resolution"], len(each.signals.segments[0].channels["y"])
        lost = (periods - 1) / periods * np.exp(-((2 * np.pi * noise / step) ** 2)) if step else 0.0
        encoder = (noise**2 + step**2 / 12) / periods + lost * step**2 / 12  # of rounding that all periods repeat
        ideal = ideal_reach(each.drawn, each.signals.segments, encoder, known)
        low, high = confidence_limits(response)[0]
        is_ok = BandReach.of(response).is_within()
        rows.append(np.stack([ideal, decibel(high / low) / 2, is_ok])[:, response.settled])
    return np.concatenate(rows, axis=1)


def width(bench: Bench) -> None:
    """Median width of the band over that of the ideal posterior, for points that are ok and for others."""
    ideal, reach, is_ok = judged(bench)
    for name, which in (("points that are ok", is_ok > 0), ("the others", is_ok == 0)):
        ratio = (reach / ideal)[which & (ideal < TELLING_DB)]
        if ratio.size:
            at = np.quantile(ratio, [0.25, 0.5, 0.75])
            text = "{1:.2f} ({0:.2f} to {2:.2f}) of {3}".format(*at, ratio.size)
            bench.row(f"width of the band over the ideal one, {name}: median (quartiles)", text, at[1] <= WIDTH)


def matched(bench: Bench) -> None:
    """Share of the points that are ok with a model that is right and known, where the encoder allows it."""
    ideal, _, is_ok = judged(bench, known=True)
    ok = is_ok[ideal < ACCURACY.magnitude]
    bench.row("points that are ok, of those that may be", f"{ok.mean():.1%} of {ok.size}", ok.mean() >= ATTAINED)


if __name__ == "__main__":
    run(__doc__, paper, drawn, width, matched, sweeps=(500, 20))
