"""The parameters of a machine with friction at several contacts: scales of each, and the plant's numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, Plant, did_you_mean
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_unit, parameter_value, with_parameters
from fraexp_plugins.identification.whole_record._shared.free_parameters import (
    DISPLACEMENT_SCALE,
    FORCE_SCALE,
    SCALES,
    FreeParameters,
    Models,
    nonzero_numbers,
)

VISCOUS = "viscous_coefficient"


@dataclass(frozen=True)
class ContactModels(Models):
    """Plant and friction of a machine with several contacts; `friction` is that of the first one."""

    thrust: str = ""
    """Thrust that is excited; the plant's first if it is empty."""
    position: str = ""
    """Position that is compared; that of the thrust's name if it is empty."""

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P(jω) from the thrust to the position that is compared [m/N], shape (n,), at ω [rad/s]."""
        return self.replay.ports.response(omega)

    def with_plant(self, plant: Plant) -> Self:
        """Return the machine with another plant of the same ports."""
        ports = plant.ports().closed_by(self.thrust, self.position)
        return replace(self, plant=plant, replay=replace(self.replay, ports=ports))


@dataclass(frozen=True)
class ContactParameters(FreeParameters):
    """Names of the parameters that are estimated: those of friction begin with their contact, `motor.force_scale`."""

    @classmethod
    def of(cls, start: ContactModels, chosen: Sequence[str] = ()) -> Self:
        """Return the chosen parameters, or all that are free by default; ParameterError for one that there is not.

        By default these are the scales and the viscous coefficient of every contact, and all numbers of the plant. A
        viscous force shares its spectrum with the plant's own: where it is not free, its error is in their numbers.
        """
        scaled = {name: [*SCALES] if law.state_size else [] for name, law in start.replay.frictions.items()}
        numbers = {name: nonzero_numbers(law) for name, law in start.replay.frictions.items()}
        default = {name: [*scaled[name], *(n for n in numbers[name] if n == VISCOUS)] for name in scaled}
        plant = nonzero_numbers(start.plant)
        if not chosen:
            return cls(_with_contacts(default), plant)
        known = (*_with_contacts({name: [*scaled[name], *numbers[name]] for name in scaled}), *plant)
        for place, name in enumerate(chosen):
            if name in chosen[:place]:
                raise ParameterError(f"free names '{name}' twice; name each parameter once")
            if name not in known:
                nearest = did_you_mean(name, known) or f"; known: {', '.join(known)}"
                raise ParameterError(f"free: there is no parameter '{name}' that is not 0{nearest}")
        return cls(tuple(n for n in chosen if n not in plant), tuple(n for n in chosen if n in plant))

    def leave_out(self, name: str) -> Self:
        """Return the others."""
        friction, plant = (tuple(n for n in group if n != name) for group in (self.friction, self.plant))
        return type(self)(friction, plant)

    def units(self, start: Models) -> tuple[str, ...]:
        """Return the units of all parameters."""
        return tuple(
            "1" if name.endswith(SCALES) else parameter_unit(*self._place_of(start, name)) for name in self.names
        )

    def _start_value(self, start: Models, name: str) -> float:
        return 1.0 if name.endswith(SCALES) else parameter_value(*self._place_of(start, name))

    def _place_of(self, start: Models, name: str) -> tuple[Plant | FrictionModel, str]:
        """Return the component that has a number, and its name there."""
        contact, _, number = name.partition(".")
        return (start.plant, name) if name in self.plant else (start.replay.frictions[contact], number)

    def applied_to(self, start: Models, logs: NDArray[np.float64]) -> Models:
        """Return the machine with these parameters."""
        values = dict(zip(self.names, self.values(start, logs).tolist(), strict=True))
        changed = start.with_plant(with_parameters(start.plant, {name: values[name] for name in self.plant}))
        frictions, scales = {}, {}
        for contact, law in start.replay.frictions.items():
            own = {n.removeprefix(f"{contact}."): values[n] for n in self.friction if n.startswith(f"{contact}.")}
            scales[contact] = (own.pop(FORCE_SCALE, 1.0), own.pop(DISPLACEMENT_SCALE, 1.0))
            frictions[contact] = with_parameters(law, own)
        replay = changed.replay.with_frictions(frictions).with_scales(scales)
        return replace(changed, friction=next(iter(frictions.values())), replay=replay)


def _with_contacts(names: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return names after that of their contact."""
    return tuple(f"{contact}.{name}" for contact, own in names.items() for name in own)
