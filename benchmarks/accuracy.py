"""Measure the accuracies of docs/accuracy.md on the paper's machine, and print each beside its bound.

python benchmarks/accuracy.py                        all parts, 100 frequencies
python benchmarks/accuracy.py --reduced              30 frequencies
python benchmarks/accuracy.py laws --law gms lugre   friction laws as machine and as model, these alone
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from harness import Bench, run
from paper_machine import (
    FRICTION,
    PAPER,
    PATH,
    PLANT,
    PRINTED,
    REGISTRY,
    decibel,
    fitted,
    loop_job,
    response_of,
    results,
    true_response,
)

from fraexp.analysis.delays import hold_response, image_factor, path_response
from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import create
from fraexp.data.results import FrequencyResponse

PRESET = {"version": 1, "preset": "linear_motor_table"}
ELEMENTS = {key: PAPER["friction"][key] for key in ("curve", "viscous_coefficient")}
MODELS: dict[str, dict[str, Any]] = {
    "rolling": ELEMENTS,
    "gms": PRESET,
    "elastoplastic": PRESET,
    "rolling, D_i": {"name": "rolling", **ELEMENTS, "damping": [20.0] * 20},
    "rolling_force_slider": ELEMENTS,
    "force slider, D_i": {"name": "rolling_force_slider", **ELEMENTS, "damping": [20.0] * 20},
    "lugre": PRESET,
    "dahl": {"stiffness": 3.9e5, "coulomb_force": 17.9, "viscous_coefficient": 4.69},
    "coulomb": {"coulomb_force": 17.9, "static_force": 22.0, "viscous_coefficient": 4.69},
}
"""Friction laws on the paper's machine."""
BOUNDED_LAWS, LAW_BOUNDS = ("rolling", "gms", "elastoplastic"), (0.05, 0.3)
"""Laws whose errors are bounded, and the bounds [dB], [°]."""
STEPS = 5


def law(name: str) -> FrictionModel:
    """Return a model of `MODELS`."""
    return create(REGISTRY, FrictionModel, {"name": name, **MODELS[name]})


def responses(
    amplitude: float,
    points: int,
    *estimators: Mapping[str, Any],
    tolerance: float = 1e-5,
    friction: Mapping[str, Any] = PAPER["friction"],
    resolution: float = 0.0,
    **numerics: Any,
) -> list[FrequencyResponse]:
    """Return the responses of the paper's machine at an amplitude [N]."""
    loop = {**PAPER["loop"], "resolution": resolution}
    excitation = {"name": "stepped_sine", "amplitude": amplitude, "points": points, "settling_tolerance": tolerance}
    scale = {"resolution": resolution, "noise": loop.get("noise", 0.0)}
    specs = [{**PATH, **(scale if spec["name"] == "effective_input" else {}), **spec} for spec in estimators]
    machine = {**PAPER, "loop": loop, "friction": friction, "numerics": numerics}
    return [response_of(result) for result in results(loop_job(machine, excitation, *specs))]


def errors(ratio: np.ndarray) -> tuple[float, float]:
    """Return the greatest distance from 1 in dB and degrees; NaN where there is no point."""
    if not ratio.size:
        return np.nan, np.nan
    return float(np.max(np.abs(decibel(ratio)))), float(np.max(np.abs(np.angle(ratio, deg=True))))


def _worst(ratio: np.ndarray) -> float:
    return float(np.max(np.abs(ratio - 1)))


def without_friction(bench: Bench) -> None:
    """Both methods against the exact sampled plant, with an ideal encoder."""
    none = {"name": "none", "version": 1}
    methods = {"name": "conventional"}, {"name": "effective_input", "friction": none}
    found = responses(12.0, bench.options.points, *methods, friction=none, tolerance=1e-8)
    sample_time, dead_time = PAPER["loop"]["sample_time"], PATH["input_dead_time"]
    omega = 2 * np.pi * found[0].frequency
    path = hold_response(omega, sample_time) * path_response(omega, dead_time, ())
    path = path * image_factor(omega, sample_time, dead_time, (), 2)
    truth = sampled_plant(omega, sample_time, dead_time)
    bench.bounded("no friction: conventional |P̂/P_sampled - 1|", _worst(found[0].response / truth), 1e-6)
    bench.bounded("no friction: proposed |P̂/P_sampled - 1|", _worst(found[1].response * path / truth), 1e-6)


def sampled_plant(omega: np.ndarray, sample_time: float, dead_time: float) -> np.ndarray:
    """Return the response of hold, dead time (whole samples) and plant, sampled, from the plant's state space."""
    from scipy.signal import cont2discrete

    model = PLANT.state_space()
    a, b, c, *_ = cont2discrete((model.a, model.b[:, None], model.c[None, :], np.zeros((1, 1))), sample_time)
    z = np.exp(1j * omega * sample_time)
    held = np.array([(c @ np.linalg.solve(value * np.eye(len(a)) - a, b)).item() for value in z])
    return held * z ** -round(dead_time / sample_time)


def proposed(bench: Bench) -> None:
    """The matched observer against P, with an ideal encoder and with that of the machine."""
    matched = {"name": "effective_input", "friction": PAPER["friction"]}
    hidden = "short: below 4 Hz û_e is under 2 % of the friction force, below the encoder's resolution"
    for resolution, bounds, lowest, shortfall in (
        (0.0, (0.005, 0.02), 1.0, ""),
        (1e-7, (0.1, 1.0), 4.0, ""),
        (1e-7, (0.1, 1.0), 1.0, hidden),
    ):
        encoder = f"{1e6 * resolution:g} µm encoder, {lowest:g}…200 Hz"
        found = [responses(force, bench.options.points, matched, resolution=resolution)[0] for force in (12, 75)]
        inside = found[0].frequency >= lowest
        for force, response in zip((12, 75), found, strict=True):
            ratio = (response.response / true_response(response.frequency))[inside]
            for error, bound, unit in zip(errors(ratio), bounds, ("dB", "°"), strict=True):
                bench.bounded(f"proposed, {force} N, {encoder}", error, bound, unit, shortfall if force == 12 else "")
        apart = float(np.max(np.abs(decibel(found[0].response / found[1].response))[inside]))
        bench.bounded(f"proposed, {encoder}: 12 N against 75 N", apart, 2 * bounds[0], "dB", shortfall)


def fits(bench: Bench) -> None:
    """The numbers that the paper identifies, from 100 frequencies."""
    found = fitted(PAPER, 12.0, max(bench.options.points, 100))
    for method, bounds in (("conventional", (1.0, 0.5)), ("effective_input", (0.1, 0.05 / 38.8 * 100))):
        gain, frequency = found[method]
        wanted = PRINTED[method]
        what = f"{method} at 12 N, P_d fitted"
        bench.bounded(f"{what}: k0 = {gain * 1e3:.2f} mm/(N s²)", abs(gain / wanted[0] - 1) * 100, bounds[0], "%")
        bench.bounded(f"{what}: f1 = {frequency:.3f} Hz", abs(frequency / wanted[1] - 1) * 100, bounds[1], "%")


def model_errors(bench: Bench) -> None:
    """Figs 14 and 15: which error of the friction model is worse, where, and the error law."""
    cases = {(f, w): {"force_scale": f, "displacement_scale": w} for f, w in ((0.9, 1), (1.1, 1), (1, 0.9), (1, 1.1))}
    own = {"name": "effective_input", "friction": PAPER["friction"], "corrects_friction": False}
    specs = [own | case for case in cases.values()]
    found = dict(zip(cases, responses(12.0, bench.options.points, *specs), strict=True))
    worst: dict[str, dict[str, float]] = {"ΣF_m": {}, "Y_m": {}}
    for (force, _), response in found.items():
        error = np.abs(decibel(response.response / true_response(response.frequency)))
        kind = worst["ΣF_m" if force != 1 else "Y_m"]
        for band, (low, high) in {"1…20": (0, 20), "36…44": (36, 44), "44…70": (44, 70)}.items():
            inside = (response.frequency >= low) & (response.frequency < high)
            kind[band] = max(kind.get(band, 0.0), float(error[inside].max()))
    for band in ("1…20", "36…44"):
        by_width, by_force = worst["Y_m"][band], worst["ΣF_m"][band]
        bench.bounded(f"±10 %, {band} Hz: Y_m {by_width:.2f} dB over ΣF_m {by_force:.2f} dB", by_width / by_force, 1.0)
    for name, at in worst.items():
        bench.bounded(f"{name} ±10 %: error at 44…70 Hz over that around 40 Hz", at["44…70"] / at["36…44"], 1.0)
        bench.bounded(f"{name} ±10 %: error around 40 Hz over that below 20 Hz", at["36…44"] / at["1…20"], 1.0)
    bench.bounded("error law 1/P̂ - 1/P = N - N̂ against simulation above 25 Hz", law_error(found), 0.1, "dB")


def law_error(found: Mapping[Any, FrequencyResponse]) -> float:
    """Return how far the responses with model errors lie from the error law above 25 Hz [dB]."""
    worst = 0.0
    for (force, width), response in found.items():
        above = response.frequency > 25
        amplitude = response.output_amplitude[above]
        right = np.array([describing_function(a) for a in amplitude])
        wrong = np.array([describing_function(a / width) * force / width for a in amplitude])
        predicted = 1 / (1 / true_response(response.frequency)[above] + right - wrong)
        worst = max(worst, float(np.max(np.abs(decibel(response.response[above] / predicted)))))
    return worst


def describing_function(amplitude: float) -> complex:
    """Return N(A) [N/m] of the machine's friction, without its viscous part."""
    y = amplitude * np.cos(2 * np.pi * np.arange(2000) / 2000)
    force = FRICTION.force(y, 1e-4, periodic=True)
    return complex(np.fft.rfft(force)[1] / np.fft.rfft(y)[1])


def laws(bench: Bench) -> None:
    """Each law as machine and observer: error of the proposed method at settled frequencies, and with half the step."""
    for name in bench.options.law or MODELS:
        friction = law(name).spec()
        methods = {"name": "conventional"}, {"name": "effective_input", "friction": friction}
        for force in (12.0, 75.0):
            coarse, fine = (
                responses(force, bench.options.points, *methods, friction=friction, steps_per_sample=steps)
                for steps in (STEPS, 2 * STEPS)
            )
            settled = coarse[1].settled & fine[1].settled
            ratio = (coarse[1].response / true_response(coarse[1].frequency))[coarse[1].settled]
            decibels, degrees = errors(ratio)
            halved = [errors((b.response / a.response)[settled])[0] for a, b in zip(coarse, fine, strict=True)]
            text = f"{decibels:8.4f} dB {degrees:7.3f}°, step halved {halved[0]:.4f} and {halved[1]:.4f} dB"
            text += f", {ratio.size} settled"
            is_met = name not in BOUNDED_LAWS or (decibels <= LAW_BOUNDS[0] and degrees <= LAW_BOUNDS[1])
            bench.row(f"{name}, {force:g} N", text, is_met, decibels=decibels, degrees=degrees)


if __name__ == "__main__":
    run(__doc__, without_friction, proposed, fits, model_errors, laws, points=(100, 30), law=[])
