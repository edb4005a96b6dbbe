"""A friction law to be called: its force along a motion, its loops and its describing function."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fraexp.components.kinds import FrictionModel, Motion
from fraexp.components.parameters import example_call
from fraexp.data.results import Curve
from fraexp.errors import ParameterError, PluginError
from fraexp.interface.argument_checks import numbers_of, require_positive, with_unit
from fraexp.interface.html import page_part
from fraexp.kernels.law_error import LawError
from fraexp.views.words import value_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES_PER_PERIOD = 4096
"""Samples of a sine, which resolve the corners of a hysteresis loop."""
MIN_AMPLITUDE_M = 1e-12
"""Smallest amplitude [m], a hundredth of an atom: laws that add to a large force lose increments below it."""
SHOWN_AMPLITUDES_M = (1e-6, 1e-5, 1e-4)
"""Amplitudes of the loops in a notebook's figure [m]."""


@contextmanager
def compiler_errors_as_ours() -> Iterator[None]:
    """Raise a PluginError for a law that cannot be compiled."""
    try:
        yield
    except LawError as error:
        raise PluginError(str(error)) from None


@dataclass(frozen=True, eq=False)
class FrictionLaw:
    """A friction law with its parameters, from a displacement [m] to a force [N]; any friction model of a plugin."""

    model: FrictionModel
    """The component (see `fraexp.api.FrictionModel`)."""

    def __post_init__(self) -> None:
        """Refuse what is no friction model, such as a name."""
        if isinstance(self.model, type) and issubclass(self.model, FrictionModel):
            raise ParameterError(
                f"FrictionLaw: found the class {self.model.__name__}; expected an object: {example_call(self.model)}"
            )
        if not isinstance(self.model, FrictionModel):
            raise ParameterError(
                f"FrictionLaw: found {self.model!r:.60}; expected a friction model, such as MyLaw(stiffness=1e6); "
                "friction_law(name, ...) makes one from a name"
            )

    @property
    def name(self) -> str:
        """Name of the friction model."""
        return self.model.name

    @property
    def parameters(self) -> dict[str, Any]:
        """Values of all parameters, in SI units."""
        return self.model.plain()

    def force(
        self, displacement: ArrayLike, sample_time: float | str = 1e-3, periodic: bool = False
    ) -> NDArray[np.float64]:
        """Return the friction force [N] along a displacement [m], shape (n,), viscous friction included.

        Parameters
        ----------
        displacement
            Motion from rest, sampled uniformly, shape (n,).
        sample_time
            Its sample time [s], or a quantity such as ``"1 ms"``; it matters for laws that depend on the velocity.
        periodic
            Whether the displacement is one or more whole periods, of which the periodic force is wanted.
        """
        sample_time = require_positive(with_unit(sample_time, "s", "sample_time"), "sample_time")
        motion = numbers_of(displacement, "displacement", "m")
        if motion.ndim != 1 or motion.size < 2:
            found = "one sample" if motion.size == 1 else f"the shape {motion.shape}"
            raise ParameterError(f"force: the displacement has {found}; expected a list of two or more samples")
        if not np.isfinite(motion).all():
            place = int(np.flatnonzero(~np.isfinite(motion))[0])
            raise ParameterError(f"force: displacement[{place}] is {motion[place]}; expected finite numbers")
        with compiler_errors_as_ours():
            force = self.model.force(motion, sample_time, periodic)
        if not self.model.viscous:
            return force
        return np.asarray(force + self.model.viscous * _velocity(motion, sample_time, periodic))

    def describing_function(self, amplitude: ArrayLike, frequency: float | str = 1.0) -> NDArray[np.complex128]:
        """Return N(A) = F₁/Y₁ [N/m] of sinusoidal motions, shape as `amplitude`, viscous friction included.

        F₁ and Y₁ are the fundamentals of force and displacement (A. Gelb and W. E. Vander Velde, 1968, section 2.2).

        Parameters
        ----------
        amplitude
            Amplitudes A of the displacement [m], 1e-12 or more; quantities such as ``"10 um"`` are converted.
        frequency
            Frequency of the motion [Hz]; it matters for laws that depend on the velocity.
        """
        amplitudes = numbers_of(amplitude, "amplitude", "m")
        frequency = require_positive(with_unit(frequency, "Hz", "frequency"), "frequency")
        sine = np.sin(2 * np.pi * np.arange(SAMPLES_PER_PERIOD) / SAMPLES_PER_PERIOD)
        forces = self._forces(amplitudes.ravel(), frequency, sine)
        fundamental = np.fft.rfft(sine)[1]
        ratios = [
            np.fft.rfft(force)[1] / (fundamental * a) for force, a in zip(forces, amplitudes.ravel(), strict=True)
        ]
        viscous = 2j * np.pi * frequency * self.model.viscous
        return np.asarray(ratios, dtype=np.complex128).reshape(amplitudes.shape) + viscous

    def loop(
        self, amplitude: float | str, frequency: float | str = 1.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return displacement [m] and force [N] over one period of a sinusoidal motion, each of shape (n,)."""
        angle = 2 * np.pi * np.arange(SAMPLES_PER_PERIOD) / SAMPLES_PER_PERIOD
        amplitude = require_positive(with_unit(amplitude, "m", "amplitude"), "amplitude")
        frequency = require_positive(with_unit(frequency, "Hz", "frequency"), "frequency")
        (force,) = self._forces(np.array([amplitude], dtype=float), frequency, np.sin(angle))
        velocity = 2 * np.pi * frequency * amplitude * np.cos(angle)
        return amplitude * np.sin(angle), force + self.model.viscous * velocity

    def _forces(
        self, amplitudes: NDArray[np.float64], frequency: float, sine: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return the periodic force along sines of these amplitudes, without viscous friction."""
        wrong = amplitudes[~(np.isfinite(amplitudes) & (amplitudes >= MIN_AMPLITUDE_M))]
        if wrong.size:
            raise ParameterError(
                f"{self.name}: an amplitude is {wrong[0]:g} m; expected {MIN_AMPLITUDE_M:g} m or more, and finite: "
                "below, rounding takes the place of the force"
            )
        step = 1 / (frequency * sine.size)
        with compiler_errors_as_ours():
            return self.model.forces([Motion(amplitude * sine, step, periodic=True) for amplitude in amplitudes])

    def plot(self, amplitudes: ArrayLike = SHOWN_AMPLITUDES_M, frequency: float | str = 1.0) -> "Figure":
        """Return a matplotlib figure of the hysteresis loops at some amplitudes [m]."""
        from fraexp.figures.kinds.curves import draw_hysteresis, hysteresis_info

        curves = []
        for amplitude in np.atleast_1d(numbers_of(amplitudes, "amplitudes", "m")):
            displacement, force = self.loop(float(amplitude), frequency)
            columns = {"displacement": np.append(displacement, displacement[0]), "force": np.append(force, force[0])}
            curves.append(
                (f"{1e6 * float(amplitude):.4g} µm", Curve("hysteresis", columns, {"displacement": "m", "force": "N"}))
            )
        return draw_hysteresis(hysteresis_info(curves, f"Friction law {self.name}"))

    def __repr__(self) -> str:
        return f"<FrictionLaw {self.name}: {self._parameters_text()}>"

    def _parameters_text(self) -> str:
        return ", ".join(f"{name}={value_text(value)}" for name, value in self.parameters.items())

    def _repr_html_(self) -> str:
        return page_part(f"Friction law {self.name}", [self._parameters_text()], self.plot())


def _velocity(displacement: NDArray[np.float64], sample_time: float, periodic: bool) -> NDArray[np.float64]:
    """Return the central difference of a displacement [m/s]."""
    if periodic:
        return (np.roll(displacement, -1) - np.roll(displacement, 1)) / (2 * sample_time)
    return np.gradient(displacement, sample_time)
