"""Rolling friction as a play of elements: closed forms of one element (Jenkins) and of Masing models, and damping."""

import numpy as np
import pytest
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.friction.rolling_force_slider import RollingForceSlider
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline

from tests.machines import cosine, guide, harmonic, work

BOTH = pytest.mark.parametrize("reading", [Rolling, RollingForceSlider], ids=lambda reading: reading.name)
ELEMENT = Rolling(stiffness=(1.0,), limit_force=(1.0,))
FC, WIDTH = 17.9, 45e-6
SHAPES = {"exponential": lambda x: FC * (1 - np.exp(-x / WIDTH)), "hyperbolic": lambda x: FC * x / (x + WIDTH)}


def jenkins(stiffness: float, limit: float, amplitude: float) -> complex:
    """Describing function K/π (θ - ½ sin 2θ + j sin²θ), θ = arccos(1 - 2Y/A); K below slip."""
    if amplitude <= limit:
        return complex(stiffness)
    theta = np.arccos(1 - 2 * limit / amplitude)
    return complex(stiffness / np.pi * (theta - np.sin(2 * theta) / 2 + 1j * np.sin(theta) ** 2))


@pytest.mark.parametrize(
    ("amplitude", "expected"),
    [
        (0.7, 1),
        (1.5, 0.708209 + 0.282942j),
        (2, 0.5 + 0.318310j),
        (5, 0.142378 + 0.203718j),
        (10, 0.052044 + 0.114592j),
    ],
)
def test_describing_function_of_one_element(amplitude, expected):
    force = ELEMENT.force(cosine(amplitude), 1e-4, periodic=True)
    found = harmonic(force) / amplitude
    assert abs(found - expected) < 1e-6
    assert abs(found - jenkins(1.0, 1.0, amplitude)) < 1e-7


def test_describing_function_of_the_guide_is_the_sum_over_its_elements():
    friction = guide()
    for amplitude in (2e-6, 30e-6, 90e-6, 1e-3):
        expected = sum(
            jenkins(k, f / k, amplitude) for k, f in zip(friction.stiffness, friction.limit_force, strict=True)
        )
        found = harmonic(friction.force(cosine(amplitude), 1e-4, periodic=True)) / amplitude
        assert abs(found / expected - 1) < 1e-6


@pytest.mark.parametrize(("ratio", "third", "fifth"), [(2, 0.1790, 0.0358), (5, 0.2732, 0.1076)])
def test_odd_harmonics_of_one_element_and_no_even_ones(ratio, third, fifth):
    force = ELEMENT.force(cosine(ratio), 1e-4, periodic=True)
    first = abs(harmonic(force))
    assert abs(harmonic(force, 3)) / first == pytest.approx(third, abs=5e-5)
    assert abs(harmonic(force, 5)) / first == pytest.approx(fifth, abs=5e-5)
    assert abs(harmonic(force, 2)) / first < 1e-12


def test_energy_per_cycle_is_four_times_force_times_excess_stroke():
    friction, y = guide(), cosine(80e-6)
    found = work(friction.force(y, 1e-4, periodic=True), y)
    deflections = np.array(friction.limit_force) / np.array(friction.stiffness)
    expected = 4 * np.sum(np.array(friction.limit_force) * np.maximum(80e-6 - deflections, 0))
    assert found == pytest.approx(expected, rel=1e-6)


def test_the_compiled_law_equals_plain_python_to_the_last_bit():
    friction = guide()
    path = np.cumsum(np.random.default_rng(5).normal(0, 2e-6, 300))
    z, plain, last = np.zeros((2, friction.state_size)), [], path[0]
    for now, value in enumerate(path):
        here, there = z[now % 2], z[(now + 1) % 2]
        plain.append(friction.law(here, value - last, 1e-4, there, *friction.law_arguments()))
        last = value
    assert np.array_equal(friction.force(path, 1e-4), plain)


def generated(shape: str, elements: int = 20) -> Rolling:
    curve = {"shape": shape, "coulomb_force": FC, "characteristic_displacement": WIDTH, "elements": elements}
    return Rolling.parse({"curve": curve}, "rolling")


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("elements", [1, 20])
def test_elements_of_a_virgin_curve_pass_through_its_knots(shape, elements):
    friction = generated(shape, elements)
    knots = np.geomspace(0.01 * WIDTH, 5 * WIDTH, elements) if elements > 1 else np.array([5 * WIDTH])
    scale = FC / SHAPES[shape](5 * WIDTH)
    assert len(friction.law_arguments()[0]) == elements
    force = friction.force(np.concatenate([[0.0], knots]), 1e-4)
    assert np.allclose(force[1:], scale * SHAPES[shape](knots), rtol=0, atol=1e-12 * FC)
    assert friction.force(np.array([0.0, 1.0]), 1e-4)[-1] == pytest.approx(FC, rel=1e-12)


def test_elements_of_a_measured_virgin_curve_pass_through_its_points():
    x, g = (2e-6, 5e-6, 9e-6, 40e-6), (2.0, 4.4, 6.4, 9.0)
    friction = Rolling.parse({"curve": {"shape": "table", "displacements": x, "forces": g}}, "rolling")
    assert np.allclose(friction.force(np.array([0.0, *x]), 1e-4)[1:], g, rtol=1e-12)
    assert friction.max_stiffness == pytest.approx(1e6, rel=1e-12)


def test_a_straight_piece_of_a_table_needs_no_element():
    table = {"shape": "table", "displacements": (1e-6, 2e-6, 4e-6), "forces": (1.0, 2.0, 3.0)}
    assert len(Rolling.parse({"curve": table}, "rolling").law_arguments()[0]) == 2


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("amplitude", [5e-6, 200e-6])
def test_energy_and_describing_function_of_a_masing_model(shape, amplitude):
    """Both follow from the virgin curve alone; 300 elements lie within 1e-4 of the smooth one."""
    y, scale = cosine(amplitude), FC / SHAPES[shape](5 * WIDTH)

    def curve(x: float) -> float:
        return float(scale * SHAPES[shape](x))

    energy = 8 * quad(curve, 0, amplitude)[0] - 4 * amplitude * curve(amplitude)
    real = -4 / (np.pi * amplitude) * quad(lambda p: curve(amplitude * np.sin(p / 2) ** 2) * np.cos(p), 0, np.pi)[0]
    force = generated(shape, 300).force(y, 1e-4, periodic=True)
    assert work(force, y) == pytest.approx(energy, rel=1e-3)
    assert harmonic(force) / amplitude == pytest.approx(real + 1j * energy / (np.pi * amplitude**2), rel=1e-3)


def test_no_energy_is_lost_where_nothing_slips():
    friction = guide()
    y = cosine(0.99 * float(np.min(friction.limit_deflection)))
    assert abs(work(friction.force(y, 1e-4, periodic=True), y)) < 1e-12 * sum(friction.limit_force) * y[0]


@pytest.mark.parametrize("seed", range(3))
def test_without_damping_both_readings_are_the_same(seed):
    friction = guide()
    slider = RollingForceSlider(stiffness=friction.stiffness, limit_force=friction.limit_force)
    walk = np.cumsum(np.random.default_rng(seed).normal(0, 10.0 ** (-7 + seed), 3000))
    bound = 1e-14 * sum(friction.limit_force)
    assert np.allclose(slider.force(walk, 1e-4), friction.force(walk, 1e-4), rtol=0, atol=bound)


@BOTH
def test_damped_elements_below_slip_are_spring_and_dashpot(reading):
    friction, omega = reading(stiffness=(3.0,), limit_force=(30.0,), damping=(0.02,)), 20.0
    found = harmonic(friction.force(cosine(1.0), 2 * np.pi / omega / 20_000, periodic=True))
    assert found == pytest.approx(3.0 + 1j * omega * 0.02, rel=1e-4)


@BOTH
def test_damped_elements_whose_slider_has_time_to_rest_agree(reading):
    """The dashpot relaxes in D/K = 7 ms, the reversal comes after 157 ms: the loops differ only while it relaxes."""
    friction = reading(stiffness=(3.0,), limit_force=(1.2,), damping=(0.02,))
    found = harmonic(friction.force(cosine(1.0), 2 * np.pi / 20.0 / 20_000, periodic=True))
    assert found == pytest.approx(1.0023 + 1.0504j, abs=1e-4)


def stored(friction: Rolling | RollingForceSlider, walk: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return force and elastic energy of the elements along a walk, with the law run as plain Python."""
    z, force, energy, n = np.zeros((2, friction.state_size)), [], [], len(friction.stiffness)
    for now, dy in enumerate(np.diff(walk, prepend=walk[0])):
        force.append(friction.law(z[now % 2], dy, step, z[1 - now % 2], *friction.law_arguments()))
        energy.append(np.sum(np.array(friction.stiffness) * z[1 - now % 2][:n] ** 2) / 2)
    return np.array(force), np.array(energy)


@pytest.mark.parametrize("seed", range(3))
def test_undamped_elements_are_passive_step_by_step(seed):
    walk = np.cumsum(np.random.default_rng(seed).normal(0, 3e-6, 600))
    force, energy = stored(guide(), walk, 1e-4)
    dy, gain = np.diff(walk), np.diff(energy)
    assert np.min((force[1:] + force[:-1]) / 2 * dy - gain) >= -1e-16
    assert np.min(force[1:] * dy - gain) >= -1e-16


@pytest.mark.parametrize("law", [Rolling, RollingForceSlider])
@pytest.mark.parametrize("step", [1e-5, 1e-3, 0.1])
def test_damped_elements_are_passive_along_a_motion_that_the_steps_resolve(law, step):
    friction = law(stiffness=(3e5, 1e5), limit_force=(3.0, 2.0), damping=(300.0, 50.0))
    knots = np.cumsum(np.random.default_rng(3).normal(0, 3e-6, 30))
    motion = CubicSpline(np.arange(30), knots, bc_type="clamped")(np.linspace(0, 29, 6000))
    force, energy = stored(friction, motion, step)
    supplied = np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(motion))
    assert np.all(supplied >= energy[1:] - 1e-3 * supplied[-1])
    assert supplied[-1] > 2 * energy[-1]  # the motion slips, not only stores


def swept_force(friction: Rolling | RollingForceSlider, points: int) -> complex:
    """Return the describing function at 28 µm and 60 Hz, from `points` steps a period."""
    motion = 28e-6 * np.cos(2 * np.pi * np.arange(points) / points)
    force = friction.force(motion, 1 / 60.0 / points, periodic=True)
    return complex(2 / 28e-6 * np.mean(force * np.exp(-2j * np.pi * np.arange(points) / points)))


@pytest.mark.parametrize("law", [Rolling, RollingForceSlider])
def test_the_force_of_damped_elements_is_of_second_order_in_the_step(law):
    """The damper is as fast as the slip, 2 µm within two steps: the mean velocity of a step is far off at its end."""
    friction = law(stiffness=(4e5, 2.5e5), limit_force=(0.8, 1.25), damping=(300.0, 200.0))
    truth = swept_force(friction, 100_000)
    # the number of steps is no multiple of four, so that no reversal lies on a step's bound
    errors = {points: abs(swept_force(friction, points) / truth - 1) for points in (251, 502, 1006, 2010)}
    assert all(error < 1e-3 * (251 / points) ** 2 for points, error in errors.items()), errors


@pytest.mark.parametrize("law", [Rolling, RollingForceSlider])
def test_damped_elements_obey_their_differential_equation(law):
    """Both readings by adaptive integration, which knows no steps: force = K y + D ẏ limited to ±F_m."""
    stiffness, limit, damping, omega, amplitude = 4e5, 0.8, 300.0, 2 * np.pi * 60.0, 28e-6

    def force_of(y: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.clip(stiffness * y + damping * v, -limit, limit)

    def right(time: float, y: np.ndarray) -> list[float]:
        v = -omega * amplitude * np.sin(omega * time)
        if law is Rolling:  # the deflection is the slider: it stops at F_m/K
            return [0.0 if abs(y[0]) >= limit / stiffness and y[0] * v > 0 else v]
        trial = stiffness * y[0] + damping * v
        return [v if abs(trial) <= limit else (np.sign(trial) * limit - stiffness * y[0]) / damping]

    period = 2 * np.pi / omega
    time = 2 * period + np.arange(4000) * period / 4000
    y = solve_ivp(right, (0, 3 * period), [0.0], t_eval=time, rtol=1e-8, atol=1e-13, max_step=period / 2000).y[0]
    expected = force_of(y, -omega * amplitude * np.sin(omega * time))
    truth = 2 / amplitude * np.mean(expected * np.exp(-2j * np.pi * np.arange(4000) / 4000))
    friction = law(stiffness=(stiffness,), limit_force=(limit,), damping=(damping,))
    assert swept_force(friction, 1006) == pytest.approx(truth, rel=5e-4)
