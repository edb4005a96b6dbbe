"""An interactive trial of a friction law: force loop along a sine and describing function, without compiling."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.components.first_trial import first_trial
from fraexp.components.kinds import FrictionModel
from fraexp.components.law_step import overdue_text
from fraexp.components.parameters import Parameters, param
from fraexp.components.registry import Registry, create, reason_of
from fraexp.data import toml
from fraexp.errors import FraexpError, PluginError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, time_limit

Answer = TypeVar("Answer")
TRIAL_STUDY = "friction/hysteresis"
"""Study that drives a friction model along the same motion, compiled, and stores the result."""
STEPS_PER_PERIOD, STEPS_PER_AMPLITUDE = 400, 96
"""Steps per period of the loop, and of each amplitude of the describing function; multiples of four, to turn at ±A."""
PERIODICITY_TOLERANCE, MAX_PERIODS = 1e-4, 12
"""Maximum relative change of the force between periods of a periodic loop, and maximum number of periods."""
AMPLITUDE_RATIOS = np.geomspace(1e-2, 10.0, 19)
"""Amplitudes of the describing function, relative to that of the loop."""
ENERGY_ROUNDING = 1e-12
"""Energy relative to the work along the path below which it is rounding."""
MAX_TRIAL_TIME_S = 4.0
"""Maximum time of a trial [s]; a slower law must be compiled."""


class SineMotion(Parameters):
    """The displacement y = A sin(2πft) that drives the law."""

    amplitude: float = param("m", "amplitude A of the displacement", 1e-4, above=0)
    frequency: float = param("Hz", "frequency f of the displacement", 1.0, above=0)


@dataclass(frozen=True)
class ForceLoop:
    """Force over displacement along a sine, in steady state."""

    displacement: NDArray[np.float64]
    """One period [m], shape (n,)."""
    force: NDArray[np.float64]
    """Friction force including viscous friction [N], shape (n,)."""
    virgin: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Displacement [m] and force [N] of the first quarter period, from rest."""
    is_periodic: bool
    """Whether the force has become periodic."""

    @property
    def describing_function(self) -> complex:
        """Describing function F₁/Y₁ [N/m]: the stiffness and loss that a sine of this amplitude meets."""
        return complex(np.fft.rfft(self.force)[1] / np.fft.rfft(self.displacement)[1])

    @property
    def energy(self) -> float:
        """Energy per cycle ∮ f dy [J]; exactly 0 if it is within rounding."""
        work = (self.force + np.roll(self.force, -1)) / 2 * (np.roll(self.displacement, -1) - self.displacement)
        energy = float(np.sum(work))
        return energy if abs(energy) > ENERGY_ROUNDING * float(np.sum(np.abs(work))) else 0.0


def trial_overrides(spec: Mapping[str, object], sine: SineMotion) -> list[str]:
    """Return the ``--set`` values with which `TRIAL_STUDY` computes the same loop."""
    return [
        f"friction={toml.dumps(spec)}",
        f"excitation.amplitude={sine.amplitude:.12g}",
        f"excitation.frequency={sine.frequency:.12g}",
    ]


class SineTrial:
    """A friction law with its parameters and a time limit; FraexpError names a fault in one line."""

    def __init__(self, spec: Mapping[str, object], sine: SineMotion, registry: Registry) -> None:
        model = create(registry, FrictionModel, spec)
        self._file = registry.provider(FrictionModel.kind, model.name).file
        self.model, self.sine = model, sine
        first_trial(spec, registry)
        self._ends = time.monotonic() + MAX_TRIAL_TIME_S
        self._call_law(model.check_law)
        self._law, self._arguments, self._viscous = self._call_law(
            lambda: (model.law, model.law_arguments(), float(model.viscous))
        )

    def loop(self) -> ForceLoop:
        """Return the loop of the motion."""
        return self._loop(self.sine.amplitude, STEPS_PER_PERIOD)

    def describing_function(
        self, wanted: Callable[[], bool] = lambda: True
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return amplitudes [m] and the describing function there [N/m]; stop early once `wanted` returns False."""
        amplitudes = AMPLITUDE_RATIOS * self.sine.amplitude
        found: list[complex] = []
        for amplitude in amplitudes.tolist():
            if not wanted():
                break
            found.append(self._loop(amplitude, STEPS_PER_AMPLITUDE).describing_function)
        return amplitudes[: len(found)], np.array(found, dtype=complex)

    def _loop(self, amplitude: float, steps: int) -> ForceLoop:
        """Return the loop of an amplitude [m]; PluginError if the law does not return in time."""
        try:
            with time_limit(LAW_TIME_LIMIT_S):
                return self._closed_loop(amplitude, steps)
        except OverdueError as error:
            at = f"in steps of a sine of {amplitude:g} m"
            raise PluginError(f"the law of {self.model.name} {overdue_text(error, self._law, at)}") from None

    def _closed_loop(self, amplitude: float, steps: int) -> ForceLoop:
        angle = 2 * np.pi * np.arange(steps) / steps
        displacement = amplitude * np.sin(angle)
        changes = (displacement - np.roll(displacement, 1)).tolist()
        z = np.zeros(self.model.state_size)
        time_step = 1 / (self.sine.frequency * steps)
        force, z = self._forces_along([0.0, *changes[1:]], z, time_step)  # from rest at 0
        viscous = self._viscous * amplitude * 2 * np.pi * self.sine.frequency * np.cos(angle)
        quarter = slice(0, steps // 4 + 1)
        virgin = displacement[quarter], (force + viscous)[quarter]
        closed = False
        for _ in range(MAX_PERIODS):
            before = force
            force, z = self._forces_along(changes, z, time_step)
            closed = bool(np.max(np.abs(force - before)) <= PERIODICITY_TOLERANCE * np.max(np.abs(force)))
            if closed:
                break
        return ForceLoop(displacement, force + viscous, virgin, closed)

    def _forces_along(
        self, changes: list[float], z: NDArray[np.float64], time_step: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the forces [N] of steps by `changes` [m], and the memory after them."""
        forces, reached = self._call_law(lambda: self._step_law(changes, z, time_step))
        if not (np.all(np.isfinite(forces)) and np.all(np.isfinite(reached))):
            wrong = forces[~np.isfinite(forces)]
            found = f"a force of {wrong[0]} N" if wrong.size else f"a memory of {reached.tolist()}"
            raise PluginError(
                f"the law gives {found} in steps up to {np.max(np.abs(changes)):.3g} m; expected finite numbers"
            )
        return forces, reached

    def _step_law(
        self, changes: list[float], z: NDArray[np.float64], time_step: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        law, arguments, forces = self._law, self._arguments, []
        for change in changes:
            z_next = np.full(z.size, np.nan)
            forces.append(law(z, change, time_step, z_next, *arguments))
            z = z_next
            if time.monotonic() > self._ends:
                raise PluginError(f"the law is too slow for plain Python; run the study {TRIAL_STUDY} instead")
        return np.array(forces, dtype=float), z

    def _call_law(self, action: Callable[[], Answer]) -> Answer:
        try:
            return action()
        except FraexpError:
            raise
        except Exception as error:  # a stranger's law may raise anything
            raise PluginError(f"the law fails: {reason_of(error, self._file)}") from error
