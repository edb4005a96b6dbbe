"""Measure the accuracies of docs/accuracy.md, and print each beside its bound.

python benchmarks/accuracy.py             100 frequencies
python benchmarks/accuracy.py --points 30 a reduced size, for a quick check

The exit code is 1 if a bound is missed.
"""

import argparse
import csv
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from calibrate_machine import MACHINE, PRINTED, fitted, sections_of

from fraexp.analysis.delays import hold_response, image_factor, path_response
from fraexp.components.kinds import FrictionModel, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import FrequencyResponse
from fraexp.execution.job import Failure, Job, run_job
from fraexp.records import RecordSettings, resolve

REGISTRY = discover()
SECTIONS = sections_of(MACHINE)
PATH = {"input_dead_time": SECTIONS["loop"]["input_dead_time"]}
PLANT = create(REGISTRY, Plant, SECTIONS["plant"])
FRICTION = create(REGISTRY, FrictionModel, SECTIONS["friction"])
BENCH = Path(__file__).resolve().parents[2] / "shared" / "data" / "two_inertia_bench"


@dataclass(frozen=True)
class Row:
    """One figure: what it is, what was measured, and what it must not exceed."""

    what: str
    measured: float
    bound: float
    unit: str
    shortfall: str = ""
    """Why the bound cannot be met, where that is known."""

    @property
    def missed(self) -> bool:
        """Whether the bound is missed and nobody knows why."""
        return self.measured > self.bound and not self.shortfall

    def __str__(self) -> str:
        """Return the row as text."""
        verdict = "ok" if self.measured <= self.bound else self.shortfall or "MISSED"
        return f"{self.what:<78s} {self.measured:10.3g} {self.bound:10.3g} {self.unit:<5s} {verdict}"


def responses(amplitude: float, points: int, *estimators: dict[str, Any], **changes: Any) -> list[FrequencyResponse]:
    """Return the responses of the paper's machine at an amplitude [N]; `changes` replace sections or parts of them."""
    experiment: dict[str, Any] = {"source": "loop", **SECTIONS, "numerics": {}}
    tolerance = changes.pop("tolerance", 1e-5)
    for key, value in changes.items():
        experiment[key] = value if "name" in value else {**experiment[key], **value}
    experiment["excitation"] = {
        "name": "stepped_sine", "amplitude": amplitude, "points": points, "settling_tolerance": tolerance,
    }  # fmt: skip
    scale = {key: experiment["loop"].get(key, 0.0) for key in ("resolution", "noise")}
    specs = tuple({**PATH, **(scale if spec["name"] == "effective_input" else {}), **spec} for spec in estimators)
    answers = run_job(Job(experiment, specs), lambda _: None)
    for answer in answers:
        if isinstance(answer, Failure) or answer.response is None:
            raise SystemExit(f"no response: {answer.message}")
    return [answer.response for answer in answers if not isinstance(answer, Failure) and answer.response is not None]


def errors(response: FrequencyResponse, lowest: float = 0.0) -> tuple[float, float]:
    """Return the greatest error against P(jω) from `lowest` [Hz] on, in dB and degrees."""
    inside = response.frequency >= lowest
    ratio = (response.response / PLANT.response(2 * np.pi * response.frequency))[inside]
    return float(np.max(np.abs(decibel(ratio)))), float(np.max(np.abs(np.angle(ratio, deg=True))))


def decibel(ratio: np.ndarray) -> np.ndarray:
    """Return 20 log10 of the magnitude."""
    return 20 * np.log10(np.abs(ratio))


def without_friction(points: int) -> Iterator[Row]:
    """Both methods against the exact sampled plant."""
    none = {"name": "none", "version": 1}
    both = responses(
        12.0, points, {"name": "conventional"}, {"name": "effective_input", "friction": none},
        friction=none, loop={"resolution": 0.0}, tolerance=1e-8,
    )  # fmt: skip
    sample_time, dead_time = SECTIONS["loop"]["sample_time"], PATH["input_dead_time"]
    omega = 2 * np.pi * both[0].frequency
    path = hold_response(omega, sample_time) * path_response(omega, dead_time, ())
    path = path * image_factor(omega, sample_time, dead_time, (), 2)
    truth = sampled_plant(omega, sample_time, dead_time)
    yield Row("no friction, ideal encoder: conventional |P̂/P_sampled - 1|", _worst(both[0].response / truth), 1e-6, "")
    yield Row(
        "no friction, ideal encoder: proposed |P̂/P_sampled - 1|", _worst(both[1].response * path / truth), 1e-6, ""
    )


def _worst(ratio: np.ndarray) -> float:
    return float(np.max(np.abs(ratio - 1)))


def sampled_plant(omega: np.ndarray, sample_time: float, dead_time: float) -> np.ndarray:
    """Return the response of hold, dead time (whole samples) and plant, sampled, from the plant's state space."""
    from scipy.signal import cont2discrete

    model = PLANT.state_space()
    a, b, c, *_ = cont2discrete((model.a, model.b[:, None], model.c[None, :], np.zeros((1, 1))), sample_time)
    z = np.exp(1j * omega * sample_time)
    held = np.array([(c @ np.linalg.solve(value * np.eye(len(a)) - a, b)).item() for value in z])
    return held * z ** -round(dead_time / sample_time)


def proposed(points: int) -> Iterator[Row]:
    """Yield the errors of the matched observer, with an ideal encoder and with that of the machine."""
    matched = {"name": "effective_input", "friction": SECTIONS["friction"]}
    hidden = "short: below 4 Hz û_e is under 2 % of the friction force, below the encoder's resolution"
    for scale, resolution, bounds, lowest, shortfall in (
        ("ideal encoder", 0.0, (0.005, 0.02), 1.0, ""),
        ("0.1 µm encoder", 1e-7, (0.1, 1.0), 4.0, ""),
        ("0.1 µm encoder", 1e-7, (0.1, 1.0), 1.0, hidden),
    ):
        found = [responses(amplitude, points, matched, loop={"resolution": resolution})[0] for amplitude in (12, 75)]
        for amplitude, response in zip((12, 75), found, strict=True):
            for error, bound, unit in zip(errors(response, lowest), bounds, ("dB", "°"), strict=True):
                what = f"proposed, {amplitude} N, {scale}, {lowest:g}…200 Hz: error"
                yield Row(what, error, bound, unit, shortfall if amplitude == 12 else "")
        inside = found[0].frequency >= lowest
        apart = float(np.max(np.abs(decibel(found[0].response / found[1].response))[inside]))
        yield Row(f"proposed, {scale}, {lowest:g}…200 Hz: 12 N against 75 N", apart, 2 * bounds[0], "dB", shortfall)


def fits(points: int) -> Iterator[Row]:
    """Yield the paper's identified numbers, which need 100 frequencies."""
    points = max(points, 100)
    for method, bounds in (("conventional", (1.0, 0.5)), ("effective_input", (0.1, 0.05 / 38.8 * 100))):
        gain, frequency = fitted(SECTIONS, 12.0, points)[method]
        wanted = PRINTED[method]
        name = f"{method} at 12 N, P_d fitted"
        yield Row(f"{name}: k0 = {gain * 1e3:.2f} mm/(N s²)", abs(gain / wanted[0] - 1) * 100, bounds[0], "%")
        yield Row(f"{name}: f1 = {frequency:.3f} Hz", abs(frequency / wanted[1] - 1) * 100, bounds[1], "%")


def model_errors(points: int) -> Iterator[Row]:
    """Figs 14 and 15: which error is worse, where, and the error law."""
    cases = {(f, w): {"force_scale": f, "displacement_scale": w} for f, w in ((0.9, 1), (1.1, 1), (1, 0.9), (1, 1.1))}
    specs = [{"name": "effective_input", "friction": SECTIONS["friction"], **case} for case in cases.values()]
    found = dict(zip(cases, responses(12.0, points, *specs, loop={"resolution": 0.0}), strict=True))
    worst: dict[str, dict[str, float]] = {"ΣF_m": {}, "Y_m": {}}
    for (force, _), response in found.items():
        error = np.abs(decibel(response.response / PLANT.response(2 * np.pi * response.frequency)))
        kind = worst["ΣF_m" if force != 1 else "Y_m"]
        for band, (low, high) in {"1…20": (0, 20), "20…36": (20, 36), "36…44": (36, 44), "44…70": (44, 70)}.items():
            inside = (response.frequency >= low) & (response.frequency < high)
            kind[band] = max(kind.get(band, 0.0), float(error[inside].max()))
    for band in ("1…20", "36…44"):
        share = worst["Y_m"][band] / worst["ΣF_m"][band]
        text = f"±10 %, {band} Hz: Y_m error {worst['Y_m'][band]:.2f} dB over ΣF_m error {worst['ΣF_m'][band]:.2f} dB"
        yield Row(text, share, 1.0, "")
    for name, at in worst.items():
        yield Row(f"{name} ±10 %: error at 44…70 Hz over that around 40 Hz", at["44…70"] / at["36…44"], 1.0, "")
        yield Row(f"{name} ±10 %: error around 40 Hz over that below 20 Hz", at["36…44"] / at["1…20"], 1.0, "")
    yield Row("error law 1/P̂ - 1/P = N - N̂ against simulation above 25 Hz", law_error(found), 0.1, "dB")


def law_error(found: dict[Any, FrequencyResponse]) -> float:
    """Return how far the responses with model errors lie from the error law above 25 Hz [dB]."""
    worst = 0.0
    for (force, width), response in found.items():
        above = response.frequency > 25
        plant = PLANT.response(2 * np.pi * response.frequency)[above]
        amplitude = response.output_amplitude[above]
        right = np.array([describing_function(a) for a in amplitude])
        wrong = np.array([describing_function(a / width) * force / width for a in amplitude])
        predicted = 1 / (1 / plant + right - wrong)
        worst = max(worst, float(np.max(np.abs(decibel(response.response[above] / predicted)))))
    return worst


def describing_function(amplitude: float) -> complex:
    """Return N(A) [N/m] of the machine's friction, without its viscous part."""
    y = amplitude * np.cos(2 * np.pi * np.arange(2000) / 2000)
    force = FRICTION.force(y, 1e-4, periodic=True)
    return complex(np.fft.rfft(force)[1] / np.fft.rfft(y)[1])


def bench(_: int) -> Iterator[Row]:
    """The motor bench's record against the answer of its authors' toolbox."""
    if not BENCH.is_dir():
        print(f"(the motor bench's record is not at {BENCH.name}/: left out)")
        return
    with (BENCH / "reference_frf.csv").open(encoding="utf-8") as file:
        reference = np.array([[float(cell) for cell in row] for row in list(csv.reader(file))[1:]])
    channels = {"u": "iq_adx [A]", "x": "theta_mx [rad]", "y": {"column": "theta_my", "unit": "rad", "scale": -1}}
    data = {"file": "MultisineTypeA.mat", "sample_rate": 2500, "period": 2500, "skip": 1, "channels": channels}
    experiment, files = resolve(RecordSettings.parse(data, "record"), BENCH, REGISTRY)
    specs = tuple({"name": "conventional", "input": "u", "output": output} for output in ("x", "y"))
    for number, answer in enumerate(run_job(Job(experiment, specs, files), lambda _: None)):
        if isinstance(answer, Failure) or answer.response is None:
            raise SystemExit(f"no response: {answer.message}")
        response, columns = answer.response, reference[:, 1 + 3 * number :]
        truth = columns[:, 0] + 1j * columns[:, 1]
        name = f"motor bench, output {number + 1}"
        yield Row(f"{name}: FRF against the reference, relative", _worst(response.response / truth), 1e-6, "")
        deviation = np.abs(response.standard_deviation / columns[:, 2] - 1) * 100
        beyond = response.frequency[deviation > 10]
        lines = ", ".join(f"{value:g}" for value in beyond)
        yield Row(f"{name}: σ against the reference, median", float(np.median(deviation)), 10, "%")
        conjugate = "short: the reference conjugates its input-output covariance the other way round"
        yield Row(f"{name}: σ against the reference, worst line", float(np.max(deviation)), 10, "%", conjugate)
        yield Row(f"{name}: lines with σ beyond 10 % ({lines} Hz) of {len(truth)}", len(beyond), 0, "", conjugate)
        if number == 0:
            magnitude = np.abs(response.response)
            near = (response.frequency > 40) & (response.frequency < 70)
            lowest = response.frequency[near][np.argmin(magnitude[near])]
            highest = response.frequency[response.frequency > 60][np.argmax(magnitude[response.frequency > 60])]
            yield Row(f"{name}: anti-resonance at {lowest:g} Hz, from 53 Hz", abs(lowest - 53), 1, "Hz")
            yield Row(f"{name}: resonance at {highest:g} Hz, from 77 Hz", abs(highest - 77), 1, "Hz")


def main() -> int:
    """Print all rows; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--points", type=int, default=100, help="frequencies of a sweep, 1 to 200 Hz")
    options.add_argument("--reduced", action="store_const", dest="points", const=30, help="the same as --points 30")
    points = options.parse_args().points
    print(f"{'what':<78s} {'measured':>10s} {'bound':>10s}")
    missed = 0
    for part in (without_friction, proposed, fits, model_errors, bench):
        for row in part(points):
            print(row, flush=True)
            missed += row.missed
    print(f"{missed} missed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
