"""Checks of plants, controllers and excitations."""

import numpy as np

from fraexp.components.kinds import Controller, Excitation, Period, Plant
from fraexp.errors import FraexpError
from fraexp.testing.conformance_check import NotApplicableError, require

OMEGA = 2 * np.pi * np.geomspace(0.1, 900.0, 60)
"""Angular frequencies at which responses are compared [rad/s]."""
SAMPLE_TIMES = (500e-6, 100e-6, 2e-3)
"""Sample times [s] that are tried."""
CARRIED = 0.95
"""Share of an excitation's energy that its lines must carry."""


def realisation(plant: Plant) -> None:
    """The state space and the response are the same P(jω)."""
    model = plant.state_space()
    identity = np.eye(model.b.size)
    realised = np.array([model.c @ np.linalg.solve(1j * omega * identity - model.a, model.b) for omega in OMEGA])
    stated = plant.response(OMEGA)
    require(np.shape(stated) == OMEGA.shape, f"response has shape {np.shape(stated)} for omega of shape {OMEGA.shape}")
    error = np.abs(realised - stated) / np.max([np.abs(stated), np.abs(realised)], axis=0)
    worst = int(np.argmax(error))
    require(error[worst] < 1e-6, f"they differ by {error[worst]:.1e} at {OMEGA[worst] / (2 * np.pi):.3g} Hz")


def relative_degree(plant: Plant) -> None:
    """A thrust moves the table by its acceleration: c·b = 0 and c·A·b > 0 (relative degree 2)."""
    model = plant.state_space()
    jump, push = float(model.c @ model.b), float(model.c @ model.a @ model.b)
    require(abs(jump) <= 1e-9 * np.linalg.norm(model.c) * np.linalg.norm(model.b), f"c·b is {jump:.4g}, not 0")
    require(push > 0, f"c·A·b is {push:.4g} m/(N s²); a positive thrust must accelerate the table forwards")


def shapes(plant: Plant) -> None:
    """A has shape (n, n), b and c have shape (n,), all of them real and finite."""
    model = plant.state_space()
    n = np.shape(model.a)[0]
    found = (np.shape(model.a), np.shape(model.b), np.shape(model.c))
    require(found == ((n, n), (n,), (n,)), f"shapes of a, b, c are {found}")
    require(all(np.isrealobj(part) and np.isfinite(part).all() for part in (model.a, model.b, model.c)), "not finite")


def causal(controller: Controller) -> None:
    """Numerator and denominator are finite, in powers of z⁻¹, and the denominator starts with 1."""
    for sample_time in SAMPLE_TIMES:
        numerator, denominator = controller.transfer_function(sample_time)
        for part in (numerator, denominator):
            require(np.ndim(part) == 1 and np.size(part), f"a part has shape {np.shape(part)}; expected (p,)")
            require(np.isrealobj(part) and np.isfinite(part).all(), f"it has {part} among its coefficients")
        require(denominator[0] == 1, f"the denominator starts with {denominator[0]:.4g}")


def coefficients(controller: Controller) -> None:
    """The response is that of the coefficients."""
    for sample_time in SAMPLE_TIMES:
        numerator, denominator = controller.transfer_function(sample_time)
        omega = OMEGA[OMEGA * sample_time < np.pi]
        delay = np.exp(-1j * omega * sample_time)
        expected = sum(b * delay**i for i, b in enumerate(numerator)) / sum(
            a * delay**i for i, a in enumerate(denominator)
        )
        stated = controller.response(omega, sample_time)
        require(np.allclose(stated, expected, rtol=1e-9, atol=0), f"they differ at a sample time of {sample_time:g} s")


def whole_periods(excitation: Excitation) -> None:
    """A period is finite samples of which the declared lines carry the energy."""
    for period in _periods(excitation):
        wave, lines = np.asarray(period.waveform), np.asarray(period.lines)
        require(wave.ndim == 1 and wave.size > 1 and np.isfinite(wave).all(), "a waveform is no row of finite samples")
        require(
            lines.size and lines.dtype.kind == "i" and (np.diff(lines) > 0).all(), "lines are no ascending integers"
        )
        require(lines[0] > 0 and 2 * lines[-1] < wave.size, f"lines {lines[0]}…{lines[-1]} of {wave.size} samples")
        energy = np.abs(np.fft.rfft(wave)) ** 2
        total = float(np.sum(energy[1:]))
        require(total > 0, "a waveform is constant")
        share = float(np.sum(energy[lines])) / total
        require(share >= CARRIED, f"{share:.0%} of a waveform's energy are at its lines; expected {CARRIED:.0%}")
        weakest = float(np.min(energy[lines])) / total
        require(weakest > 1e-12, "a line is not excited at all")


def schedule(excitation: Excitation) -> None:
    """The schedule has no negative time, a tolerance above 0 and one period at least."""
    plan = excitation.schedule
    times = (plan.ramp, plan.settle_limit, plan.record_time)
    require(all(np.isfinite(time) and time >= 0 for time in times), f"its times are {times} s")
    require(0 < plan.tolerance < 1, f"its tolerance is {plan.tolerance}")
    require(plan.periods >= 1, f"it records {plan.periods} periods")
    require(excitation.quantity in ("force", "displacement"), f"its quantity is '{excitation.quantity}'")


def refuses(excitation: Excitation) -> None:
    """What cannot be sampled is refused by `check` before anything is run."""
    for sample_time in (*SAMPLE_TIMES, 0.05, 10.0):
        try:
            excitation.check(sample_time)
        except FraexpError:
            continue
        try:
            periods = excitation.periods(sample_time)
        except Exception as error:  # whatever it is, check should have said it
            reason = f"check({sample_time:g}) accepts what periods fails at: {type(error).__name__}: {error}"
            require(False, reason)
        lines = [int(period.lines[-1]) * 2 < period.waveform.size for period in periods]
        require(all(lines) and lines, f"check({sample_time:g}) accepts lines beyond the Nyquist frequency")


def repeatable(excitation: Excitation) -> None:
    """Asked twice, it gives the same samples: what is random has a seed."""
    first, second = _periods(excitation), _periods(excitation)
    same = [np.array_equal(a.waveform, b.waveform) for a, b in zip(first, second, strict=True)]
    require(all(same), "the second waveform is another one")


def _periods(excitation: Excitation) -> tuple[Period, ...]:
    for sample_time in sorted(SAMPLE_TIMES, reverse=True):
        try:
            excitation.check(sample_time)
        except FraexpError:
            continue
        return excitation.periods(sample_time)
    raise NotApplicableError(f"it is refused at sample times of {min(SAMPLE_TIMES):g} to {max(SAMPLE_TIMES):g} s")
