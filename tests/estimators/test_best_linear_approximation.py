"""Best linear approximations of known nonlinear systems, and what they say of noise and distortions."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.fast_best_linear_approximation import FastBestLinearApproximation

from fraexp.analysis.confidence import circle_factor
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from tests.machines import FRICTIONLESS, simulated
from tests.refusals import refused

UNITS = {"u": "N", "y": "m", "excitation": "N"}
ALPHA = 0.1
ODD = np.arange(1, 100, 2)


def multisines(
    realisations: int, lines: np.ndarray, samples: int = 1024, periods: int = 1, seed: int = 1
) -> np.ndarray:
    """Return random-phase multisines with a root mean square of 1 N, shape (realisations, periods, samples)."""
    generator = np.random.default_rng(seed)
    bins = np.zeros((realisations, samples // 2 + 1), dtype=complex)
    bins[:, lines] = np.exp(2j * np.pi * generator.random((realisations, lines.size)))
    waves = np.fft.irfft(bins * samples / np.sqrt(2 * lines.size))
    return np.repeat(waves[:, None], periods, axis=1)


def signals(u: np.ndarray, y: np.ndarray, r: np.ndarray, lines: np.ndarray) -> Signals:
    """Return realisations of shape (realisations, periods, samples) as signals of 1000 Hz."""
    segments = (Segment(1e-3, {"u": u[m], "y": y[m], "excitation": r[m]}, lines) for m in range(len(u)))
    return Signals(tuple(segments), UNITS)


def response_of(result: Result) -> FrequencyResponse:
    assert result.outcome is Outcome.OK, result.message
    assert result.response is not None
    return result.response


def level(result: Result, name: str) -> np.ndarray:
    (curve,) = result.curves
    assert curve.name == "distortion levels"
    return curve.columns[name]


def left_out(lines: np.ndarray, one_of: int = 4) -> np.ndarray:
    return np.delete(lines, np.arange(2, lines.size - 1, one_of))


def test_a_cubic_has_the_best_linear_approximation_of_the_closed_form() -> None:
    lines = np.arange(1, 201)  # of equal amplitudes, 1 N altogether: 1 + α(3σ² - ¾A²) = 1.29925
    u = multisines(300, lines)
    response = response_of(BestLinearApproximation().estimate(signals(u, u + ALPHA * u**3, u, lines)))

    truth = 1 + ALPHA * (3 - 0.75 * 2 / lines.size)
    deviation = response.standard_deviation
    assert truth == pytest.approx(1.29925)
    # the mean over 200 lines scatters by a fourteenth of one line's deviation
    assert np.mean(response.response) == pytest.approx(truth, abs=3 * np.mean(deviation) / np.sqrt(lines.size))
    inside = np.abs(response.response - truth) <= deviation * circle_factor(598)
    assert 0.9 <= np.mean(inside) <= 0.99
    assert np.all(response.freedom == 598)


def test_without_noise_all_scatter_of_realisations_is_nonlinear() -> None:
    lines = left_out(ODD)
    u = multisines(50, lines, periods=2)
    response = response_of(BestLinearApproximation().estimate(signals(u, u + ALPHA * u**3, u, lines)))

    assert np.max(response.noise_variance) < 1e-25
    np.testing.assert_allclose(response.nonlinear_variance, 50 * response.standard_deviation**2, rtol=1e-9)


def test_noise_and_distortions_are_separated() -> None:
    lines, noise = left_out(ODD), 0.2
    u = multisines(40, lines, periods=4)
    v = noise * np.random.default_rng(3).standard_normal(u.shape)
    amplitude = np.sqrt(2 / lines.size)
    of_noise = 4 * noise**2 / u.shape[2] / amplitude**2  # E|dY|² = 4 σ²/N for one period, over |U|²
    for estimator in (BestLinearApproximation(), FastBestLinearApproximation()):
        quiet = response_of(estimator.estimate(signals(u, u + ALPHA * u**3, u, lines)))
        loud = response_of(estimator.estimate(signals(u, u + ALPHA * u**3 + v, u, lines)))
        linear = response_of(estimator.estimate(signals(u, u + v, u, lines)))
        assert np.mean(loud.noise_variance) == pytest.approx(of_noise / (40 * 4), rel=0.05)
        assert np.mean(loud.nonlinear_variance) == pytest.approx(np.mean(quiet.nonlinear_variance), rel=0.1)
        assert np.mean(linear.nonlinear_variance) < 0.2 * of_noise / 4  # the positive part of what scatters around 0
        assert np.mean(linear.standard_deviation**2) == pytest.approx(of_noise / (40 * 4), rel=0.1)


def test_robust_and_fast_method_find_the_same_variance_of_a_realisation() -> None:
    lines = left_out(ODD)
    u = multisines(300, lines, periods=2)
    record = signals(u, u + ALPHA * u**3, u, lines)
    robust, fast = (
        response_of(one.estimate(record)) for one in (BestLinearApproximation(), FastBestLinearApproximation())
    )
    np.testing.assert_allclose(robust.response, fast.response, rtol=1e-12)
    # with 38 lines a cubic has 2 % less at omitted ones; per line both scatter by some 5 %
    assert np.mean(fast.nonlinear_variance) == pytest.approx(np.mean(robust.nonlinear_variance), rel=0.06)
    np.testing.assert_allclose(fast.nonlinear_variance, robust.nonlinear_variance, rtol=0.3)


def cubic_level(line: int, lines: np.ndarray, amplitude: float) -> float:
    """Return E|Y|² of α u³ at a line that is not excited: Σ over triples of lines that add up to it."""
    signed = [*lines, *-lines]
    known = set(signed)
    orders = 0
    for a, b in itertools.product(signed, signed):
        c = line - a - b
        if c in known:
            orders += {1: 1, 2: 3, 3: 6}[len({a, b, c})]  # a sum of equal phases adds up amplitudes
    return float(4 * ALPHA**2 * (amplitude / 2) ** 6 * orders)


def test_omitted_odd_lines_show_the_level_of_a_cubic_and_even_lines_are_empty() -> None:
    lines = left_out(ODD)
    u = multisines(150, lines)
    result = FastBestLinearApproximation().estimate(signals(u, u + ALPHA * u**3, u, lines))

    omitted = np.setdiff1d(np.arange(1, lines[-1], 2), lines)
    theory = [cubic_level(int(k), lines, np.sqrt(2 / lines.size)) for k in omitted]
    expected = np.interp(lines, omitted, theory)
    inner = (lines > omitted[0]) & (lines < omitted[-1])
    # 150 realisations and 8 neighbours scatter by 3 %, at the ends by 6 %
    np.testing.assert_allclose(level(result, "odd")[inner] ** 2, expected[inner], rtol=0.2)
    assert np.mean(level(result, "odd")[inner] ** 2) == pytest.approx(np.mean(expected[inner]), rel=0.05)
    assert np.max(level(result, "even")) < 1e-14  # rounding: the output's amplitude is 0.3
    metrics = {metric.name: metric.value for metric in result.metrics}
    assert metrics["odd level over output"] > 0.05
    assert metrics["even level over output"] < 1e-13


def test_one_period_does_not_separate_noise_and_distortions() -> None:
    """Noise and distortions of one realisation are unknown then; the total, and the band by it, are known."""
    lines, sigma = left_out(ODD), 0.05
    u = multisines(1, lines, periods=2)
    y = u + ALPHA * u**3 + sigma * np.random.default_rng(5).standard_normal(u.shape)
    one, two = (FastBestLinearApproximation().estimate(signals(u[:, :n], y[:, :n], u[:, :n], lines)) for n in (1, 2))
    response, separated = response_of(one), response_of(two)
    assert response.noise_variance is None
    assert response.nonlinear_variance is None
    assert separated.noise_variance is not None
    assert np.isnan(level(one, "noise")).all()
    assert np.isfinite(level(two, "noise")).all()
    assert np.isnan(next(metric.value for metric in one.metrics if metric.name == "noise level over output"))
    # 200 lines of which eight neighbours tell each: the means of the totals differ by the noise of one period alone
    expected = np.mean(separated.standard_deviation**2) + np.mean(separated.noise_variance)
    assert np.mean(response.standard_deviation**2) == pytest.approx(expected, rel=0.2)


def test_a_square_shows_at_even_lines_alone() -> None:
    lines = left_out(ODD)
    u = multisines(1, lines)
    result = FastBestLinearApproximation().estimate(signals(u, u + ALPHA * u**2, u, lines))
    response = response_of(result)
    np.testing.assert_allclose(response.response, 1, rtol=1e-12)
    assert np.max(level(result, "odd")) < 1e-14
    assert np.min(level(result, "even")) > 1e-3


def test_what_feedback_brings_to_omitted_lines_is_taken_off() -> None:
    """In closed loop the noise at an omitted line is v/(1 + GC) in y: E = y - G u gives back v."""
    lines, gain, controller = left_out(ODD), 2.0, 1.5
    r = multisines(100, lines, periods=4)
    v = 0.1 * np.random.default_rng(2).standard_normal(r.shape)
    u, y = (r - controller * v) / (1 + gain * controller), (gain * r + v) / (1 + gain * controller)
    result = FastBestLinearApproximation().estimate(signals(u, y, r, lines))
    expected = 4 * 0.1**2 / (4 * r.shape[2])  # of a mean over 4 periods
    for parity in ("odd", "even"):
        np.testing.assert_allclose(level(result, parity) ** 2, expected, rtol=0.25)
        assert np.mean(level(result, parity) ** 2) == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(np.mean(level(result, "noise") ** 2), expected, rtol=0.05)


def test_a_single_realisation_is_the_conventional_response() -> None:
    record = simulated(FRICTIONLESS, (7.0, 30.0))
    for refer_to_plant in (False, True):
        delays = {"input_dead_time": 1e-3, "refer_to_plant": refer_to_plant}
        best, plain = (response_of(kind(**delays).estimate(record)) for kind in (BestLinearApproximation, Conventional))
        np.testing.assert_allclose(best.response, plain.response, rtol=1e-12)
        assert np.isnan(best.covariance).all(), "one period and one realisation do not show the distortion"
        np.testing.assert_array_equal(best.settled, plain.settled)
        np.testing.assert_array_equal(best.settling_time, plain.settling_time)


def test_realisations_need_the_injected_signal_and_one_does_not() -> None:
    u = multisines(2, ODD, periods=2)
    both = signals(u, u, u, ODD)
    bare = replace(
        both,
        units={"u": "N", "y": "m"},
        segments=tuple(replace(s, channels={"u": s.channels["u"], "y": s.channels["y"]}) for s in both.segments),
    )
    with refused(RecordError, "'excitation'", "estimator.excitation_channel=u"):
        BestLinearApproximation().estimate(bare)
    open_loop = response_of(BestLinearApproximation(excitation_channel="u").estimate(bare))
    single = response_of(BestLinearApproximation().estimate(replace(bare, segments=bare.segments[:1])))
    np.testing.assert_allclose(open_loop.response, 1, rtol=1e-12)
    np.testing.assert_allclose(single.response, 1, rtol=1e-12)


def test_realisations_of_different_lengths_are_refused() -> None:
    u = multisines(2, ODD, periods=3)
    record = signals(u, u, u, ODD)
    short = {name: values[:2] for name, values in record.segments[1].channels.items()}
    record = replace(record, segments=(record.segments[0], replace(record.segments[1], channels=short)))
    with refused(RecordError, "2 to 3"):
        BestLinearApproximation().estimate(record)


def test_a_grid_without_omitted_lines_is_refused() -> None:
    u = multisines(1, ODD, periods=2)
    with refused(RecordError, "0.9766", "96.68 Hz", "detection_group_size", "best_linear_approximation"):
        FastBestLinearApproximation().estimate(signals(u, u, u, ODD))


def test_a_line_where_nothing_moves_is_reported() -> None:
    u = multisines(3, ODD)
    y = np.zeros_like(u)
    result = BestLinearApproximation().estimate(signals(u, y, u, ODD))
    assert result.outcome is Outcome.NO_MOTION
    assert result.response is not None
    assert not result.response.settled.any()
