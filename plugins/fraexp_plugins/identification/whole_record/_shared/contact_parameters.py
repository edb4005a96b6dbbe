"""The parameters of a machine with friction at several contacts: scales of each, and the plant's numbers."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, Plant, did_you_mean
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_unit, parameter_value, with_parameters
from fraexp_plugins.identification.whole_record._shared.free_parameters import (
    SCALES,
    FreeParameters,
    Models,
    plant_parameters,
)


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
    """Names of the parameters that are estimated: `friction` has those such as `motor.force_scale`."""

    @classmethod
    def of(cls, start: ContactModels) -> Self:
        """Return the scales of every contact whose friction has any, and all numbers of the plant."""
        contacts = [name for name, model in start.replay.frictions.items() if model.state_size]
        scales = tuple(f"{contact}.{scale}" for contact in contacts for scale in SCALES)
        return cls(scales, plant_parameters(start.plant))

    def keep(self, names: tuple[str, ...]) -> Self:
        """Return those of them; ParameterError for a name that is none of them."""
        for name in names:
            if name not in self.names:
                raise ParameterError(f"free: there is no parameter '{name}'{did_you_mean(name, self.names)}")
        return self.leave_out([name for name in self.names if name not in names])

    def leave_out(self, names: list[str]) -> Self:
        """Return the others."""
        friction, plant = (tuple(n for n in group if n not in names) for group in (self.friction, self.plant))
        return type(self)(friction, plant)

    def units(self, start: Models) -> tuple[str, ...]:
        """Return the units of all parameters."""
        return (*("1" for _ in self.friction), *(parameter_unit(start.plant, name) for name in self.plant))

    def _start_value(self, start: Models, name: str) -> float:
        return 1.0 if name in self.friction else parameter_value(start.plant, name)

    def applied_to(self, start: Models, logs: NDArray[np.float64]) -> Models:
        """Return the machine with these parameters."""
        values = dict(zip(self.names, self.values(start, logs).tolist(), strict=True))
        changed = start.with_plant(with_parameters(start.plant, {name: values[name] for name in self.plant}))
        scales = {
            contact: tuple(values.get(f"{contact}.{scale}", 1.0) for scale in SCALES)
            for contact in start.replay.frictions
        }
        return replace(changed, replay=changed.replay.with_scales(scales))
