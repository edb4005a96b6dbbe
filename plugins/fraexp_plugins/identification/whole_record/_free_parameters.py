"""The parameters that all records share: factors on friction's force and deflection, and numbers of the models."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, Plant, ReplayModel, did_you_mean
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_unit, parameter_value, with_parameters

FORCE_SCALE, DISPLACEMENT_SCALE = "force_scale", "displacement_scale"
SCALES = (FORCE_SCALE, DISPLACEMENT_SCALE)
"""Factors on the friction model's force, and on its deflections at the same force."""
DEAD_TIME = "input_dead_time"
"""The dead time before the thrust, which counts for all of the loop: others before and after cannot be told apart."""
VISCOUS = "viscous_coefficient"
MAX_LOG, MAX_DEAD_TIME_SAMPLES = 5.0, 100.0
"""Greatest logarithm of a factor, and greatest change of the dead time in samples."""


@dataclass(frozen=True)
class Models:
    """Plant and friction of a machine, and the delays around them as a replay takes them."""

    plant: Plant
    replay: ReplayModel
    added_dead_time: float = 0.0
    """Dead time before the thrust, in addition to that of the start [s]."""
    thrust: str = ""
    """Thrust that is excited; the plant's first if it is empty."""
    position: str = ""
    """Position that is compared; that of the thrust's name if it is empty."""

    def with_dead_time(self, added: float) -> "Models":
        """Return the machine with another dead time before the thrust, at least none."""
        dead_time, lags = self.replay.input_path
        added = max(added, -dead_time)
        return replace(self, replay=replace(self.replay, input_path=(dead_time + added, lags)), added_dead_time=added)

    @property
    def friction(self) -> FrictionModel:
        """Friction model of the first contact."""
        return next(iter(self.replay.frictions.values()))

    @property
    def has_one_contact(self) -> bool:
        """Whether friction acts at one place alone."""
        return len(self.replay.frictions) == 1

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P(jω) from the thrust to the position that is compared [m/N], shape (n,), at ω [rad/s]."""
        return self.plant.response(omega) if self.has_one_contact else self.replay.ports.response(omega)

    def with_plant(self, plant: Plant) -> "Models":
        """Return the machine with another plant of the same ports."""
        ports = plant.ports().closed_by(self.thrust, self.position)
        return replace(self, plant=plant, replay=replace(self.replay, ports=ports))

    def with_steps_of(self, replay: ReplayModel) -> "Models":
        """Return the machine with a replay of as many steps as another one."""
        return replace(self, replay=self.replay.with_steps_of(replay))


@dataclass(frozen=True)
class FreeParameters:
    """Names of the parameters that are estimated, as factors on their values at the start.

    The fit sees the logarithms of the factors: what is positive stays so, and a step is a relative change. A dead time
    may be 0 at the start: what the fit sees of it is its change, in sample times.
    """

    friction: tuple[str, ...]
    """Scales, names of the friction model's numbers, and the dead time; with several contacts after the name of one,
    such as `motor.force_scale`."""
    plant: tuple[str, ...] = ()
    """Names of the plant's numbers."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all, those of friction first."""
        return (*self.friction, *self.plant)

    def check(self, model: FrictionModel) -> None:
        """Raise ParameterError for a name that the friction model does not have, or whose value is 0."""
        for place, name in enumerate(self.friction):
            if name in self.friction[:place]:
                raise ParameterError(f"maximum_likelihood.free names '{name}' twice; name each parameter once")
            if name in (*SCALES, DEAD_TIME):
                continue
            try:
                value = parameter_value(model, name)
            except ParameterError as error:
                text, near = str(error).removeprefix("deviations: "), did_you_mean(name, (*SCALES, DEAD_TIME))
                raise ParameterError(f"maximum_likelihood.free: {text}{near}") from None
            if value == 0:
                raise ParameterError(
                    f"maximum_likelihood.free: '{name}' is 0, and a factor on it is estimated: start from another value"
                )

    def from_scales(self, scales: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithms of all parameters for those of the scales of force and deflection."""
        given = dict(zip(SCALES, scales, strict=True))
        return np.array([given.get(name, 0.0) for name in self.names])

    def scales(self, logs: NDArray[np.float64]) -> tuple[float, float]:
        """Return the factors on friction's force and deflection."""
        factors = dict(zip(self.names, np.exp(logs), strict=True))
        return float(factors.get(FORCE_SCALE, 1.0)), float(factors.get(DISPLACEMENT_SCALE, 1.0))

    def values(self, start: Models, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values of all parameters, shape (p,)."""
        values = np.array([self._start_value(start, name) for name in self.names]) * np.exp(logs)
        for place in self._dead_time_places:
            dead_time = start.replay.input_path[0]
            values[place] = max(dead_time + start.replay.sample_time * logs[place], 0.0)
        return values

    def slopes(self, start: Models, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of the values by what the fit sees, shape (p,)."""
        slopes = self.values(start, logs)
        slopes[self._dead_time_places] = start.replay.sample_time
        return slopes

    def limit(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithms within limits: what the records do not tell runs off, until numbers overflow."""
        limits = np.full(logs.size, MAX_LOG)
        limits[self._dead_time_places] = MAX_DEAD_TIME_SAMPLES
        return np.asarray(np.clip(logs, -limits, limits))

    @property
    def _dead_time_places(self) -> list[int]:
        return [place for place, name in enumerate(self.friction) if name == DEAD_TIME]

    def _start_value(self, start: Models, name: str) -> float:
        owner, number = self._place_of(start, name)
        return 1.0 if number in (*SCALES, DEAD_TIME) else parameter_value(owner, number)

    def _place_of(self, start: Models, name: str) -> tuple[Plant | FrictionModel, str]:
        """Return the component that has a number, and its name there."""
        if name in self.plant:
            return start.plant, name
        if start.has_one_contact:
            return start.friction, name
        contact, _, number = name.partition(".")
        return start.replay.frictions[contact], number

    def dead_time(self, logs: NDArray[np.float64], sample_time: float) -> float:
        """Return the dead time in addition to that of the start [s]."""
        return sum(sample_time * float(logs[place]) for place in self._dead_time_places)

    def with_dead_time(self, logs: NDArray[np.float64], added: float, sample_time: float) -> NDArray[np.float64]:
        """Return the logarithms for a dead time that is longer [s], if it is free."""
        changed = np.array(logs)
        changed[self._dead_time_places] += added / sample_time
        return changed

    def units(self, start: Models) -> tuple[str, ...]:
        """Return the units of all parameters."""
        given = {**dict.fromkeys(SCALES, "1"), DEAD_TIME: "s"}
        places = [self._place_of(start, name) for name in self.names]
        return tuple(given.get(number) or parameter_unit(owner, number) for owner, number in places)

    def applied_to(self, start: Models, logs: NDArray[np.float64]) -> Models:
        """Return the machine with these parameters."""
        values = dict(zip(self.names, self.values(start, logs).tolist(), strict=True))
        frictions, scales = {}, {}
        for contact, law in start.replay.frictions.items():
            prefix = "" if start.has_one_contact else f"{contact}."
            own = {n.removeprefix(prefix): values[n] for n in self.friction if n.startswith(prefix) and n != DEAD_TIME}
            scales[contact] = (own.pop(FORCE_SCALE, 1.0), own.pop(DISPLACEMENT_SCALE, 1.0))
            frictions[contact] = with_parameters(law, own)
        plant = with_parameters(start.plant, {name: values[name] for name in self.plant})
        changed = replace(start, replay=start.replay.with_frictions(frictions).with_scales(scales))
        if DEAD_TIME in self.friction:
            changed = changed.with_dead_time(self.dead_time(logs, start.replay.sample_time))
        return changed.with_plant(plant) if self.plant else changed

    def leave_out(self, name: str) -> "FreeParameters":
        """Return the others."""
        friction, plant = (tuple(n for n in group if n != name) for group in (self.friction, self.plant))
        return FreeParameters(friction, plant)


def parameters_of_contacts(start: Models, chosen: Sequence[str] = ()) -> FreeParameters:
    """Return the chosen parameters of several contacts and the plant; ParameterError for one that there is not.

    By default these are the scales and the viscous coefficient of every contact, and all numbers of the plant. A
    viscous force shares its spectrum with the plant's own: where it is not free, its error is in their numbers.
    """
    plant, default, known = nonzero_numbers(start.plant), list[str](), list[str]()
    for contact, law in start.replay.frictions.items():
        numbers = [*(SCALES if law.state_size else ()), *nonzero_numbers(law)]
        known += [f"{contact}.{number}" for number in numbers]
        default += [f"{contact}.{number}" for number in numbers if number in (*SCALES, VISCOUS)]
    if not chosen:
        return FreeParameters(tuple(default), plant)
    for place, name in enumerate(chosen):
        if name in chosen[:place]:
            raise ParameterError(f"free names '{name}' twice; name each parameter once")
        if name not in (*known, *plant):
            nearest = did_you_mean(name, (*known, *plant)) or f"; known: {', '.join((*known, *plant))}"
            raise ParameterError(f"free: there is no parameter '{name}' that is not 0{nearest}")
    return FreeParameters(tuple(n for n in chosen if n not in plant), tuple(n for n in chosen if n in plant))


def nonzero_numbers(model: Plant | FrictionModel) -> tuple[str, ...]:
    """Return the names of all numbers of a plant or a friction model that are not 0."""
    names: list[str] = []
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, tuple):
            names += [f"{name}.{place}" for place, each in enumerate(value) if each]
        elif isinstance(value, float) and value:
            names.append(name)
    return tuple(names)
