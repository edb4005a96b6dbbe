"""A look at the energy of a friction law along closed paths: a law that gives more than it takes drives the machine."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import PluginError
from fraexp.kernels.watchdog import OverdueError, time_limit

AMPLITUDES_M = (1e-7, 1e-6, 1e-5, 1e-4)
FREQUENCIES_HZ = (1.0, 50.0)
"""Sines along which a law is moved."""
PERIODS = 4
"""Periods of each; the energy is that of the last one."""
STEPS, FINE_STEPS = 48, 480
"""Steps of a period, and of one by which a suspicion is confirmed."""
MAX_RELEASED = 0.02
"""Greatest energy that a period may release, relative to the work along it: the error of the steps."""
TIME_LIMIT_S = 5.0
"""Time limit [s]; a law that is slower in plain Python is not looked at."""

Law = Callable[..., float]


class ClosedPath(NamedTuple):
    """A sine along which a law is moved, and the energy that its last period releases."""

    amplitude: float
    """Amplitude [m]."""
    frequency: float
    """Frequency [Hz]."""
    released: float
    """Energy released in a period [J]; negative if it is dissipated."""
    effort: float
    """Work along the path, regardless of its sign [J]."""

    @property
    def is_active(self) -> bool:
        """Whether it releases more than the steps explain."""
        return self.released > MAX_RELEASED * self.effort


def check_passivity(name: str, law: Law, arguments: tuple[object, ...], states: int, viscous: float) -> None:
    """Raise PluginError for a law that gives energy along a closed path; a slow law is left to `fraexp check`."""

    def move(amplitude: float, frequency: float, steps: int) -> ClosedPath:
        return _travel(law, arguments, np.zeros(states), viscous, amplitude, frequency, steps)

    try:
        with time_limit(TIME_LIMIT_S), np.errstate(all="ignore"):
            for amplitude in AMPLITUDES_M:
                for frequency in FREQUENCIES_HZ:
                    if move(amplitude, frequency, STEPS).is_active:
                        path = move(amplitude, frequency, FINE_STEPS)
                        if path.is_active:
                            raise PluginError(_active_text(name, path))
    except OverdueError:
        return


def _active_text(name: str, path: ClosedPath) -> str:
    sine = f"a sine of {path.amplitude:g} m at {path.frequency:g} Hz"
    found = f"the law of {name} gives energy: {sine} releases {path.released:.3g} J a period"
    return (
        f"{found}, with {path.effort:.3g} J of work along it (check 'energy'); expected a law that takes energy, or "
        "expected_failures = {'energy': REASON} in its class"
    )


def _travel(
    law: Law,
    arguments: tuple[object, ...],
    z: NDArray[np.float64],
    viscous: float,
    amplitude: float,
    frequency: float,
    steps: int,
) -> ClosedPath:
    displacement = amplitude * np.sin(2 * np.pi * np.arange(1, PERIODS * steps + 1) / steps)
    dy, dt = np.diff(displacement, prepend=0.0), 1 / (frequency * steps)
    forces = np.zeros(dy.size + 1)
    for k, step in enumerate(dy.tolist()):
        z_next = np.full(z.size, np.nan)
        forces[k + 1] = law(z, step, dt, z_next, *arguments)
        z = z_next
    mean, last = (forces[-steps - 1 : -1] + forces[-steps:]) / 2, dy[-steps:]
    work, lost = mean * last, viscous * float(np.sum(last**2)) / dt
    return ClosedPath(amplitude, frequency, -(float(np.sum(work)) + lost), float(np.sum(np.abs(work))) + lost)
