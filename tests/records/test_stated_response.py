"""Responses that were measured elsewhere, against the closed form of the describing function of a spring and slider."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import fraexp
from fraexp.errors import FraexpError

MASS, DAMPING = 2.0, 30.0
STIFFNESS, FORCE = 1e6, 10.0
FREQUENCY = np.geomspace(5.0, 300.0, 25)
CHANNELS = {"frequency": "f", "magnitude": "mag", "phase": "phase"}


def plant(frequency: np.ndarray) -> np.ndarray:
    s = 2j * np.pi * frequency
    return 1 / (MASS * s**2 + DAMPING * s) * (1 + 0.3 * s**2 / (s**2 + 2 * 0.03 * 500 * s + 500**2))


def describing_function(amplitude: float) -> complex:
    """Return N(A) of a Jenkin element (Gelb and Vander Velde, 1968): it slips for A > F/K."""
    width = FORCE / STIFFNESS
    if amplitude <= width:
        return STIFFNESS
    theta = np.arccos(1 - 2 * width / amplitude)
    real = STIFFNESS / np.pi * (theta - 0.5 * np.sin(2 * theta))
    return real + 1j * 4 * FORCE / (np.pi * amplitude) * (1 - width / amplitude)


def measured(frequency: float, force: float) -> complex:
    """Return the response y/u with friction: the amplitude at which |y| (1 + N(|y|) P) = |P| u holds."""
    p = plant(np.array([frequency]))[0]

    def excess(log_amplitude: float) -> float:
        amplitude = np.exp(log_amplitude)
        return abs(amplitude * (1 + describing_function(amplitude) * p)) - abs(p) * force

    amplitude = np.exp(brentq(excess, -25, 5, xtol=1e-14))
    return p / (1 + describing_function(amplitude) * p)


def write_table(path: Path, header: str, magnitude: np.ndarray, phase: float | np.ndarray = -90.0) -> Path:
    rows = np.column_stack([FREQUENCY, magnitude, np.broadcast_to(phase, FREQUENCY.shape)])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.12g")
    return path


def write_bode(path: Path, response: np.ndarray) -> Path:
    magnitude = 20 * np.log10(np.abs(response) / 1e-3)
    return write_table(path, "f [Hz],mag [dB],phase [deg]", magnitude, np.degrees(np.angle(response)))


@pytest.fixture
def bode(tmp_path: Path) -> Path:
    return write_bode(tmp_path / "bode.csv", np.array([measured(f, 25.0) for f in FREQUENCY]))


def test_a_response_comes_back_as_it_was_stated(tmp_path: Path, bode: Path) -> None:
    recording = fraexp.read_record(bode, CHANNELS, response_unit="mm/N")
    found = fraexp.estimate(recording, "conventional")
    assert (found.outcome, found.unit) == ("inaccurate", "m/N")
    assert [each.kind for each in found.findings] == ["unknown band"]
    np.testing.assert_allclose(found.frequency, FREQUENCY, rtol=1e-11)
    np.testing.assert_allclose(found.response, [measured(f, 25.0) for f in FREQUENCY], rtol=1e-10)
    known = found.frequency_response
    assert np.isnan(known.input_amplitude).all()
    assert np.isnan(known.harmonics).all()
    assert np.isnan(known.standard_deviation).all()


def test_a_fit_takes_the_scatter_that_nobody_stated_from_its_residuals(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).standard_normal((2, FREQUENCY.size)).T @ [1, 1j]
    s = 2j * np.pi * FREQUENCY
    truth = 1 / (MASS * s**2) * (1 + 0.3 * s**2 / (s**2 + 2 * 0.03 * 500 * s + 500**2))
    path = write_bode(tmp_path / "noisy.csv", truth * (1 + 3e-3 * noise))
    recording = fraexp.read_record(path, CHANNELS, response_unit="mm/N")
    found = fraexp.estimate(recording, "modal_fit", method={"name": "conventional"})
    assert found.outcome == "ok"
    relative = found.frequency_response.standard_deviation / np.abs(found.response)
    np.testing.assert_allclose(relative, 3e-3 * np.sqrt(2), rtol=0.5)


def test_friction_is_taken_off_by_its_describing_function(bode: Path) -> None:
    recording = fraexp.read_record(bode, CHANNELS, response_unit="mm/N", input_amplitude="25 N")
    friction = {"name": "rolling", "stiffness": [STIFFNESS], "limit_force": [FORCE]}
    found = fraexp.estimate(recording, "effective_input", friction=friction)
    off = 20 * np.log10(np.abs(found.response / plant(FREQUENCY)))
    with_friction = 20 * np.log10(np.abs([measured(f, 25.0) for f in FREQUENCY] / plant(FREQUENCY)))
    assert np.abs(with_friction).max() > 3
    assert np.abs(off).max() < 1e-3
    np.testing.assert_allclose(found.frequency_response.input_amplitude[0], 25, atol=15)


def test_dead_time_is_removed(tmp_path: Path) -> None:
    delayed = plant(FREQUENCY) * np.exp(-2j * np.pi * FREQUENCY * 1.5e-3)
    recording = fraexp.read_record(write_bode(tmp_path / "d.csv", delayed), CHANNELS, response_unit="mm/N")
    found = fraexp.estimate(recording, "conventional", refer_to_plant=True, input_dead_time=1.5e-3)
    np.testing.assert_allclose(found.response, plant(FREQUENCY), rtol=1e-9)


def test_coherence_becomes_a_standard_deviation(tmp_path: Path) -> None:
    """Against the spread of a thousand estimates drawn as Bendat and Piersol assume: noise at the output alone."""
    rng, averages, share = np.random.default_rng(5), 40, 0.2
    x = (rng.normal(size=(2, 4000, averages)) / np.sqrt(2)).view().T @ [1, 1j]
    noise = (rng.normal(size=(2, 4000, averages)) / np.sqrt(2)).T @ [1, 1j] * share
    sxx, sxy = (np.abs(x) ** 2).mean(axis=0), (x.conj() * (x + noise)).mean(axis=0)
    spread = np.sqrt(np.mean(np.abs(sxy / sxx - 1) ** 2))
    coherence = 1 / (1 + share**2)
    lines = [f"{f!r},1,0,{coherence!r}" for f in (10.0, 20.0)]
    (tmp_path / "c.csv").write_text("\n".join(["f,re,im,coh", *lines]))
    channels = {"frequency": "f [Hz]", "real": "re", "imaginary": "im", "coherence": "coh"}
    recording = fraexp.read_record(tmp_path / "c.csv", channels, response_unit="m/N", averages=averages)
    known = fraexp.estimate(recording, "conventional").frequency_response
    assert known.standard_deviation == pytest.approx([spread, spread], rel=0.03)
    assert known.coherence == pytest.approx([coherence] * 2)


def test_an_accelerance_is_integrated_and_omega_is_read(tmp_path: Path) -> None:
    omega = 2 * np.pi * FREQUENCY
    rows = np.column_stack([omega, (-(omega**2) * plant(FREQUENCY)).view(float).reshape(-1, 2)])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="w [rad/s],re,im", comments="")
    channels = {"frequency": "w [rad/s]", "real": {"column": "re", "integrate": 2}, "imaginary": "im"}
    recording = fraexp.read_record(tmp_path / "a.csv", channels, response_unit="m/s^2/N")
    found = fraexp.estimate(recording, "conventional")
    assert found.unit == "m/N"
    np.testing.assert_allclose(found.response, plant(FREQUENCY), rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "text", "expected"),
    [
        ({"response_unit": ""}, None, "response_unit is not given; expected the output's over the input's"),
        ({"response_unit": "mm"}, None, "response_unit is 'mm'; expected"),
        ({}, "f [Hz],mag [dB],phase [deg]\n1,2,3\n1,4,5\n", "1 Hz is there twice"),
        ({}, "f [Hz],mag [dB],phase [deg]\n0,2,3\n-1,4,5\n", "0 frequencies are above 0 Hz"),
        ({}, "f [Hz],mag [mm/N],phase [deg]\n1,0,3\n2,4,5\n", "the response at 1 Hz is 0"),
        ({"channels": {"frequency": "f", "magnitude": "mag"}}, None, "expected frequency with magnitude and phase"),
        ({"input_amplitude": "12 V"}, None, "'V' is not a unit of the same kind as 'N'"),
        ({"input_amplitude": 0}, None, "input_amplitude is 0.0; expected a number above 0 N"),
    ],
)
def test_a_fault_is_one_line(tmp_path: Path, bode: Path, change: dict, text: str | None, expected: str) -> None:
    if text:
        bode.write_text(text)
    keys = {"channels": CHANNELS, "response_unit": "mm/N", **change}
    with pytest.raises(FraexpError, match=expected):
        fraexp.read_record(bode, **keys)


def test_what_needs_samples_or_an_amplitude_says_so(bode: Path) -> None:
    recording = fraexp.read_record(bode, CHANNELS, response_unit="mm/N")
    with pytest.raises(FraexpError, match="local_polynomial needs samples over time"):
        fraexp.estimate(recording, "local_polynomial")
    with pytest.raises(FraexpError, match=r"friction depends on the amplitude.* give record.input_amplitude"):
        fraexp.estimate(recording, "effective_input", friction={"name": "coulomb", "coulomb_force": 1.0})


def test_the_unit_in_the_heading_is_that_of_the_response(tmp_path: Path) -> None:
    table = write_table(tmp_path / "t.csv", "f (Hz),mag (deg/Nm),phase (deg)", 1 / FREQUENCY)
    found = fraexp.estimate(fraexp.read_record(table, CHANNELS), "conventional")
    assert found.unit == "rad/(N m)"
    np.testing.assert_allclose(np.abs(found.response), np.pi / 180 / FREQUENCY, rtol=1e-11)


@pytest.mark.parametrize(
    ("header", "size", "change", "message"),
    [
        ("f (Hz),mag (deg/Nm),phase (deg)", 1.0, {"response_unit": "rad/Nm"}, "given as rad/Nm, but deg/Nm is stated"),
        ("f (Hz),mag (rad/Nm),phase (deg)", 1.0, {"response_unit": "mm/N"}, "given as mm/N, but rad/Nm is stated"),
        ("f (Hz),mag,phase (rad)", 1.0, {"channels": CHANNELS | {"phase": "phase [deg]"}}, "but the file says rad"),
        ("f (Hz),mag,phase (deg)", -1.0, {}, r"magnitude -1; expected 0 or more, or dB: 'magnitude=mag \[dB\]'"),
        ("f (Hz),mag (dB),phase (deg)", 1.0, {"channels": CHANNELS | {"magnitude": "mag [1]"}}, "the file says dB"),
    ],
)
def test_a_unit_that_contradicts_the_heading_is_refused(
    tmp_path: Path, header: str, size: float, change: dict, message: str
) -> None:
    table = write_table(tmp_path / "t.csv", header, np.full(FREQUENCY.size, size))
    keys = {"channels": CHANNELS, "response_unit": "mm/N", **change}
    with pytest.raises(FraexpError, match=message):
        fraexp.read_record(table, **keys)
