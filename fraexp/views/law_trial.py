"""A friction law tried by hand: its loop along a sine and its describing function, in plain Python, at once."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fraexp.components.first_trial import first_trial
from fraexp.components.kinds import FrictionModel
from fraexp.components.law_check import overdue
from fraexp.components.parameters import Parameters, param
from fraexp.components.registry import Registry, reason_of
from fraexp.errors import FraexpError, PluginError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, time_limit
from fraexp.views.fields import toml_value

Answer = TypeVar("Answer")
STUDY = "friction/hysteresis"
"""Study that drives a friction model by the same motion, compiled and stored."""
STEPS, STEPS_AMPLITUDE = 400, 96
"""Steps per period of the loop, and of each amplitude of the describing function; multiples of four, to turn at ±A."""
CLOSED, PASSES = 1e-4, 12
"""Change of the force from a period to the next, relative to its greatest, that counts as periodic; periods at most."""
AMPLITUDES = np.geomspace(1e-2, 10.0, 19)
"""Amplitudes of the describing function, in those of the loop."""
ROUNDING = 1e-12
"""Energy relative to the work to and fro that is nothing but rounding."""
LONGEST = 4.0
"""Time that a trial may take [s]: for more the law must be compiled."""


class Sine(Parameters):
    """The displacement y = A sin(2πft) that drives the law."""

    amplitude: float = param("m", "amplitude A of the displacement", 1e-4, above=0)
    frequency: float = param("Hz", "frequency f of the displacement", 1.0, above=0)


@dataclass(frozen=True)
class ForceLoop:
    """Force over displacement along a sine, once it repeats itself."""

    displacement: np.ndarray
    """One period [m], shape (n,)."""
    force: np.ndarray
    """Friction force with the viscous one [N], shape (n,)."""
    virgin: tuple[np.ndarray, np.ndarray]
    """Displacement [m] and force [N] of the first quarter period, from rest."""
    closed: bool
    """Whether the force repeats itself."""

    @property
    def describing(self) -> complex:
        """Describing function F₁/Y₁ [N/m]: the stiffness and loss that a sine of this amplitude meets."""
        return complex(np.fft.rfft(self.force)[1] / np.fft.rfft(self.displacement)[1])

    @property
    def energy(self) -> float:
        """Energy per cycle ∮ f dy [J]; exactly 0 where it is nothing but rounding."""
        work = (self.force + np.roll(self.force, -1)) / 2 * (np.roll(self.displacement, -1) - self.displacement)
        energy = float(np.sum(work))
        return energy if abs(energy) > ROUNDING * float(np.sum(np.abs(work))) else 0.0


def overrides(spec: Mapping[str, Any], sine: Sine) -> list[str]:
    """Return what `fraexp run` must be told with ``--set`` so that `STUDY` does the same."""
    return [
        f"friction={toml_value(spec)}",
        f"excitation.amplitude={sine.amplitude:.12g}",
        f"excitation.frequency={sine.frequency:.12g}",
    ]


class Trial:
    """A friction law with its parameters and a time limit; FraexpError tells in one line what is wrong with it."""

    def __init__(self, spec: Mapping[str, Any], sine: Sine, registry: Registry) -> None:
        self._file: Path | None = None
        model = registry.create(FrictionModel.kind, spec)
        if not isinstance(model, FrictionModel):
            raise PluginError(f"{spec.get('name')} is no friction model")
        supply = registry.supply(FrictionModel.kind, str(spec["name"]))
        self._file = supply.file
        self.model, self.sine = model, sine
        first_trial(spec, registry)
        self._ends = time.monotonic() + LONGEST
        self._guarded(model.rehearse)
        self._law, self._arguments, self._viscous = self._guarded(
            lambda: (model.law, model.law_arguments(), float(model.viscous))
        )

    def loop(self) -> ForceLoop:
        """Return the loop of the motion."""
        return self._loop(self.sine.amplitude, STEPS)

    def describing_function(self, wanted: Callable[[], bool] = lambda: True) -> tuple[np.ndarray, np.ndarray]:
        """Return amplitudes [m] and the describing function there [N/m]; shorter if it is no longer wanted."""
        amplitudes = AMPLITUDES * self.sine.amplitude
        found: list[complex] = []
        for amplitude in amplitudes.tolist():
            if not wanted():
                break
            found.append(self._loop(amplitude, STEPS_AMPLITUDE).describing)
        return amplitudes[: len(found)], np.array(found, dtype=complex)

    def _loop(self, amplitude: float, steps: int) -> ForceLoop:
        """Return the loop of an amplitude [m]; PluginError if the law does not return from a step."""
        try:
            with time_limit(LAW_TIME_LIMIT_S):
                return self._closed_loop(amplitude, steps)
        except OverdueError as error:
            at = f"in steps of a sine of {amplitude:g} m"
            raise PluginError(f"the law of {self.model.name} {overdue(error, self._law, at)}") from None

    def _closed_loop(self, amplitude: float, steps: int) -> ForceLoop:
        angle = 2 * np.pi * np.arange(steps) / steps
        displacement = amplitude * np.sin(angle)
        changes = (displacement - np.roll(displacement, 1)).tolist()
        z = np.zeros(self.model.state_size)
        time_step = 1 / (self.sine.frequency * steps)
        force, z = self._along([0.0, *changes[1:]], z, time_step)  # from rest at 0
        viscous = self._viscous * amplitude * 2 * np.pi * self.sine.frequency * np.cos(angle)
        quarter = slice(0, steps // 4 + 1)
        virgin = displacement[quarter], (force + viscous)[quarter]
        closed = False
        for _ in range(PASSES):
            before = force
            force, z = self._along(changes, z, time_step)
            closed = bool(np.max(np.abs(force - before)) <= CLOSED * np.max(np.abs(force)))
            if closed:
                break
        return ForceLoop(displacement, force + viscous, virgin, closed)

    def _along(self, changes: list[float], z: np.ndarray, time_step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the forces [N] of steps by `changes` [m], and the memory after them."""
        forces, reached = self._guarded(lambda: self._walked(changes, z, time_step))
        if not (np.all(np.isfinite(forces)) and np.all(np.isfinite(reached))):
            wrong = forces[~np.isfinite(forces)]
            found = f"a force of {wrong[0]} N" if wrong.size else f"a memory of {reached.tolist()}"
            raise PluginError(f"the law gives {found} in steps up to {np.max(np.abs(changes)):.3g} m; expected numbers")
        return forces, reached

    def _walked(self, changes: list[float], z: np.ndarray, time_step: float) -> tuple[np.ndarray, np.ndarray]:
        law, arguments, forces = self._law, self._arguments, []
        for change in changes:
            z_next = np.full(z.size, np.nan)
            forces.append(law(z, change, time_step, z_next, *arguments))
            z = z_next
            if time.monotonic() > self._ends:
                raise PluginError(f"the law is too slow to be tried in plain Python; run the study {STUDY}")
        return np.array(forces, dtype=float), z

    def _guarded(self, action: Callable[[], Answer]) -> Answer:
        try:
            return action()
        except FraexpError:
            raise
        except Exception as error:  # a stranger's law may raise anything
            raise PluginError(f"the law fails: {reason_of(error, self._file)}") from error
