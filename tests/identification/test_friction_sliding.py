"""Mass and friction from sliding: dead time, asymmetry, honest doubts and what cannot tell."""

import re

import numpy as np
import pytest

from fraexp.data.signals import Segment, Settling, Signals
from fraexp.errors import RecordError
from tests.identification.friction_records import THREE, driven, sliding, values
from tests.responses import judged

RATE, MASS = 1000.0, 3.0


def record(*, asymmetry: float = 0.0, late: int = 0, noise: float = 0.0, stribeck: float = 0.0) -> Signals:
    """A motion that slides at many speeds, and the thrust that it takes; the thrust is held, and so is exact."""
    time = np.arange(20000) / RATE
    phase = 2 * np.pi * time
    y = 0.03 * np.sin(0.5 * phase) + 2e-3 * np.sin(2.3 * phase)
    fine = np.gradient(y, time)
    force = (
        8 * np.sign(fine) * (1 + stribeck * np.exp(-np.abs(fine) / 0.02)) + 25 * fine + 1.3 + asymmetry * np.abs(fine)
    )
    u = MASS * np.gradient(fine, time) + force
    u = np.roll((u + np.roll(u, -1)) / 2, -late)  # held over the sample that follows
    u += noise * np.random.default_rng(1).normal(size=u.size)
    segment = Segment(1 / RATE, {"u": u[None], "y": y[None]}, np.array([1]), Settling(True, 0.0, 0.0))
    return Signals((segment,), {"u": "N", "y": "m"})


TRUTH = {"mass": MASS, "Coulomb force": 8.0, "viscous coefficient": 25.0, "offset": 1.3}


@pytest.mark.parametrize(("late", "asymmetry", "noise"), [(0, 0.0, 0.0), (2, 0.0, 0.3), (0, 6.0, 0.1)])
def test_what_the_motion_took_is_found(late: int, asymmetry: float, noise: float) -> None:
    estimator = sliding(input_dead_time=late / RATE, fit_asymmetry=asymmetry > 0)
    result = judged(estimator, record(late=late, asymmetry=asymmetry, noise=noise))
    found = values(result)
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, rel=0.01), name
    if asymmetry:
        assert found["viscous asymmetry"] == pytest.approx(asymmetry, rel=0.1)
    assert not result.message
    assert result.fits[0].component["coulomb_force"] == pytest.approx(8, rel=0.01)


def test_the_intervals_hold_the_truth_in_noise() -> None:
    covered, clean = [], record()
    (segment,) = clean.segments
    for seed in range(10):
        u = segment.channels["u"] + np.random.default_rng(seed).normal(size=segment.channels["u"].shape)
        noisy = Segment(1 / RATE, {**segment.channels, "u": u}, segment.lines, segment.settling)
        found = values(sliding().estimate(Signals((noisy,), clean.units)))
        covered += [abs(found[name] - value) < found[f"{name}, 95 %"] for name, value in TRUTH.items()]
    assert 0.88 < np.mean(covered) <= 1.0


def fewer(signals: Signals, every: int) -> Signals:
    """Return every n-th sample as a record without any other information."""
    (segment,) = signals.segments
    channels = {name: values[:, ::every] for name, values in segment.channels.items()}
    return Signals((Segment(every * segment.sample_time, channels, segment.lines),), signals.units)


@pytest.mark.parametrize("late", [0, 3, 10])
def test_a_dead_time_that_nobody_states_is_found(late: int) -> None:
    """Every fifth sample of a held thrust comes 0.4 of the new samples before one that is held, not 0.5."""
    result = sliding().estimate(fewer(record(late=late), 5))
    found = values(result)
    assert found["further dead time"] == pytest.approx((late - 2) / RATE, abs=2e-5)
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, rel=1e-3), name
    assert "acts at another time than one that is held between samples and delayed as stated" in result.message


@pytest.mark.thorough
def test_an_error_of_a_few_percent_is_reported_where_it_is_no_noise() -> None:
    (segment,) = record().segments
    beat = 0.6 * np.sin(2 * np.pi * 1.7 * np.arange(20000) / RATE)  # a force of 7.5 % that nobody knows of
    channels = {**segment.channels, "u": segment.channels["u"] + beat}
    shaken = Signals((Segment(1 / RATE, channels, segment.lines, segment.settling),), {"u": "N", "y": "m"})
    result = sliding().estimate(shaken)
    found = values(result)
    (misfit,) = [each for each in result.findings if each.kind == "misfit"]
    assert misfit.error == pytest.approx(0.053, abs=1e-3)
    assert all(abs(found[name] - value) < found[f"{name}, 95 %"] for name, value in TRUTH.items())


def test_effects_outside_the_model_are_reported() -> None:
    assert "Stribeck" in sliding().estimate(record(stribeck=2.0)).message


def test_an_unsuitable_motion_is_refused() -> None:
    time = np.arange(4000) / RATE
    one_way = Segment(
        1 / RATE,
        {"u": time[None] + 1, "y": (0.1 + 0.1 * time[None]) * time[None]},
        np.array([1]),
        Settling(True, 0.0, 0.0),
    )
    with pytest.raises(RecordError, match=r"the machine slides in 0 rows in one direction; expected 30"):
        sliding().estimate(Signals((one_way,), {"u": "N", "y": "m"}))
    turned = record()
    (segment,) = turned.segments
    wrong = Segment(
        1 / RATE, {"u": -segment.channels["u"], "y": segment.channels["y"]}, segment.lines, segment.settling
    )
    with pytest.raises(RecordError, match="check signs and gains"):
        sliding().estimate(Signals((wrong,), turned.units))


def test_friction_that_rises_after_each_reversal_is_left_out() -> None:
    time = np.arange(20000) / RATE
    y = 0.02 * np.sin(np.pi * time) + 1e-3 * np.sin(5 * np.pi * time)
    velocity = np.gradient(y, time)
    u = MASS * np.gradient(velocity, time) + driven(THREE, y, 1 / RATE)
    u = (u + np.roll(u, -1)) / 2
    segment = Segment(1 / RATE, {"u": u[None], "y": y[None]}, np.array([1]), Settling(True, 0.0, 0.0))
    found = values(sliding(presliding_distance=3e-4).estimate(Signals((segment,), {"u": "N", "y": "m"})))
    assert found["mass"] == pytest.approx(MASS, rel=0.01)
    assert found["Coulomb force"] == pytest.approx(sum(THREE.limit_force), rel=0.01)
    assert found["viscous coefficient"] == pytest.approx(THREE.viscous, rel=0.05)


def disturbed(force: float, decay: float, noise: float = 0.0, seed: int = 1) -> Signals:
    """Return the record with a force in its thrust that decays from the start and that nobody knows of."""
    (segment,) = record().segments
    time = np.arange(20000) / RATE
    extra = force * np.exp(-time / decay) + noise * np.random.default_rng(seed).normal(size=time.size)
    channels = {**segment.channels, "u": segment.channels["u"] + extra}
    return Signals((Segment(1 / RATE, channels, segment.lines, segment.settling, periodic=False),), record().units)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_disturbed_start_is_left_out(noise: float) -> None:
    """Of 20 s the first second has another force; with it the viscous coefficient is wrong by more than half."""
    result = sliding().estimate(disturbed(300.0, 0.1, noise))
    found = values(result)
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, rel=0.015), name
        assert found[f"{name}, 95 %"] < 0.05 * value
    assert re.search(
        r"the first (1.2|2.5)\d* s are left out, because their error is up to [\d.e+]+ times", result.message
    )
    assert "set skip_time in [record] (--skip-time)" in result.message


def test_a_jump_of_the_reference_at_the_start_does_no_harm() -> None:
    """A record of which the first samples differ by kilonewtons."""
    found = values(sliding().estimate(disturbed(3000.0, 1e-3)))
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, rel=0.015), name


def test_no_start_is_left_out_without_reason() -> None:
    for seed in range(5):
        result = sliding().estimate(disturbed(0.0, 1.0, 1.0, seed))
        assert "left out" not in result.message


def test_a_record_that_does_not_repeat_itself_is_not_differentiated_as_a_period() -> None:
    """Its end is not its beginning: the Fourier transform would make ripple of a tenth of the Coulomb force."""
    (segment,) = record().segments
    channels = {name: values[:, :13300] for name, values in segment.channels.items()}
    for settling in (None, Settling(True, 5.0, 0.0)):
        cut = Segment(1 / RATE, channels, segment.lines, settling, periodic=False)
        found = values(sliding().estimate(Signals((cut,), record().units)))
        for name, value in TRUTH.items():
            assert found[name] == pytest.approx(value, rel=1e-3), name
