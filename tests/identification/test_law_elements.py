"""Forces of one law: their columns add up to the law, and the law that made a motion's records is found again."""

import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._law_forces import LawForces, columns_of, rolling_elements, unit_law
from fraexp_plugins.identification._law_report import LawChoice, LawFit
from fraexp_plugins.identification._law_selection import LawSelection
from fraexp_plugins.identification._line_records import periodic_motion, remove_drift
from fraexp_plugins.identification.plant_and_friction import PlantAndFriction

from fraexp.components.kinds import FrictionModel, Motion
from fraexp.components.parameters import param
from fraexp.components.registry import create
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Settling, Signals

THRESHOLDS = np.array([1e-6, 4e-6, 2e-5])
CURVE = {"N": 0.2, "m/s": 1e-3}


def law_of(law: type[FrictionModel], sizes: dict[str, float]) -> LawForces:
    """Return a law whose shape has these numbers by their units."""
    columns = columns_of(unit_law(law, 4e-6, 0.02), THRESHOLDS)
    return replace(columns, shape=columns.starting_at(sizes))


LAWS: list[tuple[LawForces, list[float]]] = [
    (rolling_elements(THRESHOLDS, 2e-4), [1.0, 0.0, 2.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0]),
    (law_of(GeneralizedMaxwellSlip, {"N": 0.3, "m/s": 2e-3, "N/s": 40.0}), [1.0, 2.0, 0.5]),
    (law_of(LuGre, {"N/m": 1 / 8e-6, **CURVE}), [5.0, 1.0]),
    (law_of(Elastoplastic, {"N/m": 1 / 8e-6, **CURVE}), [5.0, 1.0]),
]
SAMPLE_TIME = 5e-4


@pytest.mark.parametrize(("elements", "sizes"), LAWS, ids=lambda each: getattr(each, "name", ""))
def test_columns_add_up_to_the_law(elements: LawForces, sizes: list[float]) -> None:
    motion = 1e-4 * np.sin(2 * np.pi * np.arange(4000) / 4000) + 4e-5 * np.sin(10 * np.pi * np.arange(4000) / 4000)
    model = elements.model(np.array(sizes), 0.0)
    expected = model.force(motion, 1e-4, periodic=True)
    found = elements.columns(Motion(motion, 1e-4, True)) @ sizes
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize(("elements", "sizes"), LAWS, ids=lambda each: getattr(each, "name", ""))
def test_a_drift_of_the_mean_leaves_the_force_as_it_is(elements: LawForces, sizes: list[float]) -> None:
    samples, periods, drift = 500, 8, 3e-6
    time = np.arange(samples * periods) / samples
    y = 1e-4 * np.sin(2 * np.pi * time) + drift * time
    force = elements.model(np.array(sizes), 0.0).force(y, SAMPLE_TIME)[-samples:]
    channels = {"u": np.tile(force, (2, 1)), "y": y[-2 * samples :].reshape(2, samples)}
    recorded = Signals((Segment(SAMPLE_TIME, channels, np.array([1])),), {"u": "N", "y": "m"})
    observer = EffectiveInput(friction=Frictionless(), oversampling=1)
    (segment,) = remove_drift(recorded, "y").segments
    assert np.ptp(segment.channels["y"].mean(axis=1)) < 1e-12
    motion = periodic_motion(observer, segment)
    np.testing.assert_allclose(elements.columns(motion) @ sizes, force, atol=5e-3 * np.abs(force).max())
    del segment.channels["drift"]
    apart = elements.columns(periodic_motion(observer, segment)) @ sizes
    assert np.abs(apart - force).max() > 0.015 * np.abs(force).max()  # without the drift


def record_of(model: FrictionModel, frequency: float, amplitude: float, mass: float = 5.0) -> Segment:
    """Return the record of a free mass whose motion has harmonics: the force that this motion takes, in closed form."""
    samples = round(1 / (frequency * SAMPLE_TIME))
    fine = np.arange(8 * samples) / (8 * samples)
    shapes = [(1, 1.0), (3, 0.06)]
    y = amplitude * sum(size * np.sin(2 * np.pi * k * fine) for k, size in shapes)
    omega = 2 * np.pi / (samples * SAMPLE_TIME)
    acceleration = -amplitude * sum(size * (k * omega) ** 2 * np.sin(2 * np.pi * k * fine) for k, size in shapes)
    force = model.forces([Motion(y, SAMPLE_TIME / 8, True)])[0] + mass * acceleration
    bins = np.fft.rfft(force)[: samples // 2] / 8
    omegas = omega * np.arange(bins.size)
    held = np.sinc(omegas * SAMPLE_TIME / 2 / np.pi) * np.exp(-0.5j * omegas * SAMPLE_TIME)
    u = np.fft.irfft(np.append(bins / held, np.zeros(samples // 2 + 1 - bins.size)), samples)
    channels = {"u": np.tile(u, (2, 1)), "y": np.tile(y[::8], (2, 1))}
    return Segment(SAMPLE_TIME, channels, np.array([1]), settling=Settling(True, 1.0, 0.0))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["lugre", "rolling", "dahl", "gms", "elastoplastic"])
def test_the_law_of_records_is_found(name: str, registry: Any) -> None:
    curve = {"coulomb_force": 10.0, "static_force": 12.5, "stribeck_velocity": 2e-3}
    bristles = {"bristle_stiffness": 1e6, "bristle_damping": 200.0, **curve}
    elements = {"stiffness": [1e6, 3e5], "attraction_rate": 300.0, "force_fractions": [0.4, 0.6]}
    spec: dict[str, Any] = {
        "lugre": bristles,
        "rolling": {"stiffness": [1e6, 3e5], "limit_force": [4.0, 6.0]},
        "dahl": {"stiffness": 1e6, "coulomb_force": 10.0},
        "gms": {**elements, **curve},
        "elastoplastic": {**bristles, "elastic_limit_ratio": 0.6},
    }[name]
    choice = choice_of(create(registry, FrictionModel, {"name": name, **spec}))
    found: LawFit = choice.best
    assert found.explains, choice.residuals
    assert found.coulomb == pytest.approx(10.0, rel=0.01)
    assert choice.interval[0] <= 10.0 <= choice.interval[1] or abs(found.coulomb - 10.0) < 0.01
    assert found.law.name in (name, "gms" if name == "rolling" else name)


def choice_of(model: FrictionModel, others: tuple[type[FrictionModel], ...] = ()) -> LawChoice:
    """Return the law that explains records at eight frequencies and three speeds."""
    segments = tuple(
        record_of(model, frequency, size / (2 * np.pi * frequency))
        for frequency in np.geomspace(1, 40, 8)
        for size in (1e-3, 8e-3, 0.06)
    )
    signals = Signals(segments, {"u": "N", "y": "m"})
    observer = EffectiveInput(friction=Frictionless(), oversampling=4)
    return LawSelection(signals, observer, 3e-4, True).choose(others, True)


def test_a_law_that_noise_does_not_explain_is_taken_with_a_verdict_that_says_so() -> None:
    limits, widths = np.array([4.0, 6.0]), np.array([4e-6, 2e-5])
    model = Rolling(stiffness=limits / widths, limit_force=limits)
    gains = 1 + 3e-3 * np.random.default_rng(2).normal(size=24)  # of a drive that errs
    segments = [record_of(model, f, v / (2 * np.pi * f)) for f in np.geomspace(3, 40, 8) for v in (1e-3, 8e-3, 0.06)]
    erring = tuple(
        replace(each, channels={**each.channels, "u": gain * each.channels["u"]})
        for each, gain in zip(segments, gains, strict=True)
    )
    result = PlantAndFriction(modes=0, estimate_dead_time=True).estimate(Signals(erring, {"u": "N", "y": "m"}))
    metrics = {metric.name: metric.value for metric in result.metrics}
    assert (result.outcome, metrics["friction law"]) == (Outcome.INACCURATE, 0)
    assert "no friction law explains the records" in result.message
    assert metrics["Coulomb force"] == pytest.approx(10.0, rel=2e-3)
    assert metrics["k0"] == pytest.approx(0.2, rel=5e-3)


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_a_law_is_judged_by_what_the_encoder_does_to_it(error: float) -> None:
    """Errors of stuck records, 200 times those of others, had let a law pass that 2 % of the thrust contradict."""
    limits, widths, generator = np.array([3.0, 7.0]), np.array([3e-7, 6e-6]), np.random.default_rng(5)
    model, segments, step = Rolling(stiffness=limits / widths, limit_force=limits), [], 1e-7
    for frequency in np.geomspace(3, 40, 6):
        for size in (6e-7, 1e-5, 0.06 / (2 * np.pi * frequency)):  # m: six steps of the encoder, bending, and sliding
            record = record_of(model, frequency, size)
            y = record.channels["y"] + generator.normal(0, step / 2, record.channels["y"].shape)
            u = (1 + error * generator.normal()) * record.channels["u"]
            segments.append(replace(record, channels={"u": u, "y": step * np.round(y / step)}))
    observer = EffectiveInput(friction=Frictionless(), oversampling=4, resolution=step, noise=0.58 * step)
    signals = Signals(tuple(segments), {"u": "N", "y": "m"})
    best = LawSelection(signals, observer, 3e-4, False).choose((), False).best
    assert best.explains == (error == 0)
    if not error:
        assert best.residual < 1.5
        assert best.coulomb == pytest.approx(10.0, rel=0.01)


def signals_of(mode: float, lag: float) -> Signals:
    """Return records of a mass and two elements, of which a mode [Hz] makes more, with a lag of the position [s]."""
    model, segments = rolling_elements(np.array([1e-6, 4e-6])).model(np.array([4.0, 6.0])), []
    for f, speed in product(np.geomspace(2.0, 20.0, 10), (1e-3, 8e-3, 0.06)):
        segment = record_of(model, f, speed / (2 * np.pi * f), 5.0 / (1 - (f / mode) ** 2))
        omega = 2 * np.pi * np.fft.rfftfreq(segment.samples, SAMPLE_TIME)
        bins = np.fft.rfft(segment.channels["y"]) / (1 + 1j * omega * lag)
        channels = {**segment.channels, "y": np.fft.irfft(bins, segment.samples)}
        segments.append(replace(segment, channels=channels))
    return Signals(tuple(segments), {"u": "N", "y": "m"})


@pytest.mark.parametrize(("mode", "lag", "is_free"), [(60.0, 0.0, True), (3.5, 0.0, False), (60.0, 1e-3, True)])
def test_a_mode_near_the_lowest_frequencies_is_not_taken_for_a_free_body(
    mode: float, lag: float, is_free: bool
) -> None:
    """Far below the first mode an axis is a free body: elements that are a spring in most records are seen there."""
    observer = EffectiveInput(friction=Frictionless(), oversampling=4, output_time_constants=(lag,) if lag else ())
    choice = LawSelection(signals_of(mode, lag), observer, 3e-4, False).choose((), False)
    assert (choice.records.free_lines.size > 0) == is_free
    assert choice.best.coulomb == pytest.approx(10.0, rel=2e-3)


class BoucWen(FrictionModel, name="bouc_wen_of_a_user", version=1):
    """A law that fraexp does not have: dF/dx = K (1 - (½ + ½ sgn(v F)) |F/Fc|^n) (R. Bouc, 1967; Y.-K. Wen, 1976)."""

    states = ("force [N]",)
    slope: float = param("N/m", "stiffness after a reversal", above=0)
    limit: float = param("N", "Coulomb force", above=0)
    sharpness: float = param("1", "exponent n", at_least=0.5, at_most=4)

    @staticmethod
    def advance(z: Any, dy: float, dt: float, z_next: Any, slope: float, limit: float, sharpness: float) -> float:
        force, steps = z[0], 16
        for _ in range(steps):
            opposed = 0.5 + 0.5 * math.copysign(1.0, dy * force)
            force += slope * dy / steps * (1.0 - opposed * min(abs(force) / limit, 1.0) ** sharpness)
            force = min(max(force, -limit), limit)
        z_next[0] = force
        return force


class Failing(FrictionModel, name="failing_of_a_user", version=1):
    """A law that writes where it has no state."""

    limit: float = param("N", "Coulomb force", above=0)

    @staticmethod
    def advance(z: Any, dy: float, dt: float, z_next: Any, limit: float) -> float:
        z_next[3] = dy
        return limit


def test_a_law_that_fails_is_named_and_left_out() -> None:
    dahl = Dahl(stiffness=2e5, coulomb_force=10.0)  # which elements do not explain
    segments = [record_of(dahl, f, v / (2 * np.pi * f)) for f in (5.0, 10.0, 20.0) for v in (1e-3, 8e-3, 0.06)]
    signals, observer = Signals(tuple(segments), {"u": "N", "y": "m"}), EffectiveInput(friction=Frictionless())
    observer = observer.model_copy(update={"oversampling": 4})
    choice = LawSelection(signals, observer, 3e-4, False).choose((Failing(limit=1.0), dahl), False)
    assert choice.best.law.name == "dahl"
    assert [f"{each.place} {each.text}"[:27] for each in choice.left_out] == ["failing_of_a_user left out,"]


@pytest.mark.thorough
def test_a_users_own_law_is_tried_by_its_name_and_found() -> None:
    truth = BoucWen(slope=6e5, limit=10.0, sharpness=1.4)
    choice = choice_of(truth, (BoucWen,))
    assert choice.best.law.name == truth.name, choice.residuals
    assert choice.best.explains
    assert choice.best.coulomb == pytest.approx(10.0, rel=0.01)
    model = choice.best.law.model(choice.best.sizes, 0.0)
    assert isinstance(model, BoucWen)
    assert model.sharpness == pytest.approx(1.4, rel=0.05)
