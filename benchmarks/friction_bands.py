"""Measure the coverage of the 95 % bands on machines with friction, and on records whose windows leak.

    python benchmarks/friction_bands.py encoder                     500 seeds of each machine and method
    python benchmarks/friction_bands.py encoder --machine paper --method conventional --seed 8200000
    python benchmarks/friction_bands.py single-period               20 places of the machine on the scale
    python benchmarks/friction_bands.py leakage                     500 records each

encoder         Loops with 30 nm of noise and an encoder of 0.1 µm, 12 N, 8 periods. The band of the proposed method,
                whose friction model is right, must cover P(jω); that of the conventional one the response of the
                machine in its loop: true displacement over input, the mean of 200 other seeds. `shift` is by how much
                rounding, which repeats with the motion, moves that response. With 40 steps per sample the error of the
                numerics is below the noise
single-period   Rounding in a single period depends on where on the scale the machine moves: at random places within one
                quantisation step, with noise and without, the circle must cover 91 % over all places and frequencies
leakage         A free mass with a mode, in closed loop, and windows of 1 s: each record must say that they leak, and
                the bands cover 93 %. Of sound records of random machines at most 2 % may raise an alarm
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from harness import ROOT, Bench, chance, run
from paper_machine import NOISE_M, PAPER, REGISTRY, RESOLUTION_M, machine_of, response_of
from scipy.stats import f as f_distribution

sys.path.insert(0, str(ROOT))
from fraexp_plugins.estimators.h1_h2_hv import H1H2Hv
from fraexp_plugins.estimators.joint_input_output import JointInputOutput

from fraexp.analysis.confidence import CONFIDENCE_LEVEL, circle_factor, confidence_limits, degrees_of_freedom
from fraexp.api import phasors
from fraexp.components.kinds import Estimator, Excitation, Plant
from fraexp.components.registry import create
from fraexp.data.results import FrequencyResponse, Outcome
from fraexp.data.signals import Encoder, Signals
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment
from fraexp.simulation.loop import CHANNEL_UNITS, prepare_setup
from tests.estimators import test_leakage as leaking

TOLERANCE, MIN_SINGLE_PERIOD_SHARE = 0.02, 0.91
FREQUENCIES_HZ = (2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0, 40.0, 80.0)
PERIODS = 8
NUMERICS = {"tolerance": 1e-5, "steps_per_sample": 40}
STIFFNESS_N_M = np.array([4e5, 2.5e5, 1.2e5, 6e4, 3e4, 1.2e4, 5e3])
THRESHOLDS_M = np.array([2, 5, 12, 25, 45, 80, 140]) * 1e-6
OTHER: dict[str, Any] = {
    "plant": {
        "name": "modal", "rigid_body_gain": 0.5, "frequencies": [23, 140], "damping_ratios": [0.01, 0.3],
        "modal_gain_ratios": [0.15, -0.4],
    },
    "friction": {
        "name": "rolling", "stiffness": STIFFNESS_N_M.tolist(), "viscous_coefficient": 60.0,
        "limit_force": (STIFFNESS_N_M * THRESHOLDS_M).tolist(),
    },
    "controller": {"name": "pid", "proportional": 800, "derivative_time": 0.03, "filter_time": 0.004},
    "loop": {
        "sample_time": 0.8e-3, "input_dead_time": 1.04e-3, "output_dead_time": 0.36e-3,
        "input_time_constants": [0.6e-3],
    },
}  # fmt: skip
"""A machine with narrow friction elements, a lightly damped mode and fractional dead times."""
DAMPED = {**OTHER["friction"], "viscous_coefficient": 2.0, "damping": [300, 200, 150, 100, 60, 30, 15]}
MACHINES: dict[str, dict[str, Any]] = {"paper": PAPER, "other": OTHER, "damped": {**OTHER, "friction": DAMPED}}
METHODS = ("effective_input", "conventional")
TRUTH_SEEDS, FIRST_TRUTH_SEED = 200, 50_000_000
"""Experiments that show what the machine does in its loop, and their first seed."""
SEEDS_PER_BATCH = 50
"""Records in memory at once."""


def records(
    sections: Mapping[str, Any],
    frequencies: Sequence[float],
    seeds: range,
    encoder: Mapping[str, float],
    amplitude: float = 12.0,
    recorded_periods: int = PERIODS,
) -> Iterator[Signals]:
    """Yield a machine's record of a stepped sine for each seed."""
    machine = machine_of(sections, NUMERICS, **encoder)
    setup = prepare_setup(machine)
    spec = {
        "name": "stepped_sine", "amplitude": amplitude, "frequencies": frequencies,
        "recorded_periods": recorded_periods, "settling_tolerance": 1e-5 if encoder["noise"] else 1e-9,
    }  # fmt: skip
    excitation = create(REGISTRY, Excitation, spec)
    periods = excitation.periods(machine.loop.sample_time)
    for begin in range(seeds.start, seeds.stop, SEEDS_PER_BATCH):
        numbers = range(begin * len(periods), min(begin + SEEDS_PER_BATCH, seeds.stop) * len(periods))
        experiments = [Experiment(setup, periods[n % len(periods)], excitation.schedule, n) for n in numbers]
        segments = [segment for segment in run_experiments(experiments, lambda _: None) if segment]
        for first in range(0, len(segments), len(periods)):
            found = tuple(segments[first : first + len(periods)])
            yield Signals(found, {name: CHANNEL_UNITS[name] for name in found[0].channels})


def method_for(sections: Mapping[str, Any], name: str) -> Estimator:
    """Return a method, with what it must know of the machine."""
    loop = sections["loop"]
    spec: dict[str, Any] = {"name": name, "resolution": RESOLUTION_M}
    if name == "effective_input":
        delays = ("input_dead_time", "output_dead_time", "input_time_constants")
        spec |= {key: loop[key] for key in delays if key in loop}
        spec |= {"friction": sections["friction"], "noise": NOISE_M, "force_std": 0.0}
        spec |= {"displacement_std": 0.0, "dead_time_std": 0.0}
        spec |= {"interpolation_tolerance": NUMERICS["tolerance"]}
    return create(REGISTRY, Estimator, spec)


def response_in_loop(sections: Mapping[str, Any], name: str, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what a method should find, and how far rounding and noise move it: the plant, or the machine in its loop.

    The latter is the mean true displacement over the mean input of other experiments, through the path to the encoder,
    which the same loop shows without noise and rounding.
    """
    if name == "effective_input":
        plant = create(REGISTRY, Plant, sections["plant"]).response(2 * np.pi * frequency)
        return plant, np.zeros(frequency.size)
    ideal = next(records(sections, FREQUENCIES_HZ, range(1), {"noise": 0.0, "resolution": 0.0}))
    position, moved, thrust = (mean_phasors(ideal, channel) for channel in ("y", "displacement", "u"))
    encoder = {"noise": NOISE_M, "resolution": RESOLUTION_M, "seed": 1}
    others = range(FIRST_TRUTH_SEED, FIRST_TRUTH_SEED + TRUTH_SEEDS)
    sums = [
        [mean_phasors(signals, channel) for channel in ("displacement", "u")]
        for signals in records(sections, FREQUENCIES_HZ, others, encoder)
    ]
    motion, force = np.sum(sums, axis=0)
    response = motion / force * position / moved
    return response, np.abs(response / (position / thrust) - 1)


def mean_phasors(signals: Signals, channel: str) -> np.ndarray:
    """Return the phasors of a channel at all frequencies, averaged over the periods, shape (n,)."""
    return np.concatenate([phasors(segment, channel).mean(axis=0) for segment in signals.segments])


def squared_distance(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the squared Mahalanobis distance of complex errors, shape (n,)."""
    parts = np.stack([error.real, error.imag], axis=1)
    return np.einsum("ni,nij,nj->n", parts, np.linalg.inv(covariance), parts)


def within_limits(response: FrequencyResponse, truth: np.ndarray, slack: float = 0.0) -> np.ndarray:
    """Return whether the limits of magnitude, and those of phase, cover the truth, shape (2, n)."""
    ratio, (magnitude, phase) = truth / response.response, confidence_limits(response)
    pairs = ((np.abs(ratio), magnitude), (np.angle(ratio), phase))
    return np.array([(edges[0] - slack <= value) & (value <= edges[1] + slack) for value, edges in pairs])


def covered(response: FrequencyResponse, truth: np.ndarray) -> np.ndarray:
    """Return whether circle, ellipse, limits of magnitude and limits of phase cover the truth, shape (4, n)."""
    covariance, freedom = response.covariance, degrees_of_freedom(response)
    error = response.response - truth
    circle = np.abs(error) <= circle_radius(covariance, freedom)
    ellipse = squared_distance(error, covariance) <= 2 * circle_factor(freedom) ** 2
    return np.vstack([circle, ellipse, within_limits(response, truth)])


def circle_radius(covariance: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """Return the radius of the 95 % circle, shape (n,): that of `circle_factor` where both parts are alike.

    An error that is mostly along one line exceeds a circle of this many standard deviations more often: its squared
    size is like χ² with (tr C)²/tr C² degrees of freedom in place of two (Satterthwaite).
    """
    trace, square = np.trace(covariance, axis1=1, axis2=2), np.einsum("nij,nij->n", covariance, covariance)
    own = trace**2 / square
    return np.sqrt(trace * f_distribution.ppf(CONFIDENCE_LEVEL, own, np.minimum(freedom, 1e6)))


def encoder(bench: Bench) -> None:
    """Coverage [%] of circle, ellipse, magnitude and phase; mean error, scatter, shift."""
    chosen = bench.options
    for name in [chosen.machine] if chosen.machine else MACHINES:
        for method in [chosen.method] if chosen.method else METHODS:
            _encoder_rows(bench, name, method)


def _encoder_rows(bench: Bench, name: str, method: str) -> None:
    sections, seeds = MACHINES[name], range(bench.seed, bench.seed + bench.options.seeds)
    scale, estimator = {"noise": NOISE_M, "resolution": RESOLUTION_M, "seed": 1}, method_for(sections, method)
    records_of_seeds = records(sections, FREQUENCIES_HZ, seeds, scale)
    responses = [response_of(estimator.estimate(signals)) for signals in records_of_seeds]
    truth, shift = response_in_loop(sections, method, responses[0].frequency)
    hits = np.array([covered(response, truth) for response in responses])
    ratios = np.array([response.response / truth for response in responses])
    slack, shares = TOLERANCE + chance(CONFIDENCE_LEVEL, len(responses)), hits.mean(axis=0)
    for place, frequency in enumerate(FREQUENCIES_HZ):
        judged = shares[[0, 2, 3], place]
        is_met = bool(np.all(np.abs(judged - CONFIDENCE_LEVEL) <= slack))
        text = " ".join(f"{100 * share:6.1f}" for share in shares[:, place])
        text += f"  {abs(ratios[:, place].mean() - 1):.1e} {ratios[:, place].std():.1e} {shift[place]:.1e}"
        bench.row(f"{name}, {method}, {frequency:g} Hz", text, is_met, circle=float(judged[0]))


def single_period(bench: Bench) -> None:
    """Coverage of the circle over places of the scale and 30 frequencies."""
    frequencies = tuple(np.geomspace(1, 200, 30).tolist())
    for name, amplitude in (("paper", 12.0), ("paper", 25.0), ("paper", 75.0), ("other", 12.0), ("damped", 12.0)):
        sections = MACHINES[name]
        for noise in (0.0, NOISE_M):
            for method in METHODS:
                estimator = method_for(sections, method)
                if method == "effective_input":
                    estimator = estimator.model_copy(update={"noise": noise})
                truth = _found_ideally(sections, amplitude, estimator, frequencies)
                ratios = []
                for number, place in enumerate(bench.generator().uniform(0, RESOLUTION_M, bench.options.places)):
                    signals = _at_place(sections, amplitude, place, Encoder(noise, RESOLUTION_M), number, frequencies)
                    response = response_of(estimator.estimate(signals))
                    radius = circle_factor(degrees_of_freedom(response)) * response.standard_deviation
                    error = np.abs(response.response / truth - 1)
                    ratios.append(error / (radius / np.abs(truth) + NUMERICS["tolerance"]))
                share = float(np.mean(np.array(ratios) <= 1))
                text = f"covers {share:6.1%}; at most {np.max(ratios):.1f} radii off"
                what = f"{name}, {amplitude:g} N, {1e9 * noise:g} nm, {method}"
                bench.row(what, text, share >= MIN_SINGLE_PERIOD_SHARE, share=share)


def _at_place(
    sections: Mapping[str, Any], amplitude: float, place: float, scale: Encoder, seed: int, frequencies: Sequence[float]
) -> Signals:
    """Return one period of each frequency, with the machine at a place on the scale [m]."""
    loop = {"noise": scale.noise, "resolution": scale.resolution, "reference": place, "seed": seed}
    (signals,) = records(sections, frequencies, range(1), loop, amplitude, 1)
    return replace(signals, encoder=scale)


def _found_ideally(
    sections: Mapping[str, Any], amplitude: float, method: Estimator, frequencies: Sequence[float]
) -> np.ndarray:
    """Return what a method should find: the plant, or what the conventional one finds with an ideal encoder."""
    ideal = _at_place(sections, amplitude, 0.0, Encoder(0.0, 0.0), 0, frequencies)
    frequency = np.concatenate([segment.frequency for segment in ideal.segments])
    if method.name == "effective_input":
        return create(REGISTRY, Plant, sections["plant"]).response(2 * np.pi * frequency)
    return response_of(method.model_copy(update={"resolution": 0.0}).estimate(ideal)).response


def leakage(bench: Bench) -> None:
    """Alarms and coverage on a free mass that leaks, and false alarms on sound records."""
    count = bench.options.records
    seeds = range(bench.seed, bench.seed + count)
    for estimator in (H1H2Hv(window=1.0), JointInputOutput(window=1.0)):
        found = [leaking.judged(estimator, leaking.on_a_free_mass(seed)) for seed in seeds]
        alarms = sum(result.outcome is Outcome.INACCURATE for result in found) / count
        responses = [response_of(result) for result in found]
        frequency = responses[0].frequency
        inside = np.mean([leaking.covered(each, leaking.free_mass()) for each in responses], axis=0)
        ratios = [each.response / leaking.response(leaking.free_mass(), frequency) for each in responses]
        places = np.searchsorted(frequency, (1.0, 2.0, 5.0, 10.0, 39.0, 100.0))
        bias = np.abs(np.mean(ratios, axis=0) - 1)[places]
        parts = zip(frequency[places], bias, inside[places], strict=True)
        text = f"alarms {alarms:.0%}, covers {inside.mean():.1%}; "
        text += ", ".join(f"{hertz:g} Hz: off by {error:.1%}, {part:.0%}" for hertz, error, part in parts)
        bench.row(estimator.name, text, alarms >= 0.95 and inside.mean() > 0.93, alarms=alarms)
    alarms = 0
    for seed in seeds:
        estimator, signals = leaking.sound(seed)
        alarms += "leakage" in [each.kind for each in leaking.judged(estimator, signals).findings]
    bench.bounded("false alarms on sound records", 100 * alarms / count, 2, "%")


if __name__ == "__main__":
    run(
        __doc__, encoder, single_period, leakage, seeds=(500, 60), places=(20, 5), records=(500, 50), machine="",
        method="",
    )  # fmt: skip
