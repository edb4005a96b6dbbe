"""What is fitted to records: a machine as a replay takes it, and which of its numbers are free."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, Plant, ReplayModel, Signals, did_you_mean
from fraexp_plugins.estimators._shared.effective_input_observer import TOLERANCE_RATIO
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_unit, parameter_value, with_parameters
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._law_numbers import VISCOUS, nonzero_numbers
from fraexp_plugins.identification._likelihood import MODEL_ERROR

FORCE_SCALE, DISPLACEMENT_SCALE = "force_scale", "displacement_scale"
SCALES = (FORCE_SCALE, DISPLACEMENT_SCALE)
"""Factors on the friction model's force, and on its deflections at the same force."""
DEAD_TIME = "input_dead_time"
"""Dead time before the thrust, which stands for all of the loop: a record does not tell it from one after the plant."""
NOISE = "noise"
MAX_LOG, MAX_DEAD_TIME_SAMPLES = 20.0, 100.0
"""Bounds of the search: logarithm of a factor, change of the dead time in samples. They only keep numbers from
overflowing that the records do not tell."""
REPLAY_ERROR = 1e-5
"""Error over the motion that the steps of a replay cause at least; at most it is `TOLERANCE_RATIO` times as large. A
finer replay corrects what they do to the result. Half of it takes up to three times as long."""


@dataclass(frozen=True)
class Models:
    """Plant and friction of a machine, and the delays around them as a replay takes them."""

    plant: Plant
    replay: ReplayModel
    added_dead_time: float = 0.0
    """Dead time before the thrust, in addition to that of the start [s]."""
    ports: tuple[str, str] = ("", "")
    """Thrust that is excited and position that is compared, as in the loop; the plant's first if they are empty."""

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
    def scales(self) -> tuple[float, float]:
        """Factors on force and deflection of friction at the first contact."""
        return next(iter(self.replay.scales.values()), (1.0, 1.0))

    @property
    def has_one_contact(self) -> bool:
        """Whether friction acts at one place alone."""
        return len(self.replay.frictions) == 1

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P(jω) from the thrust to the position that is compared [m/N], shape (n,), at ω [rad/s]."""
        return self.plant.response(omega) if self.has_one_contact else self.replay.ports.response(omega)

    def with_plant(self, plant: Plant) -> "Models":
        """Return the machine with another plant of the same ports."""
        return replace(self, plant=plant, replay=replace(self.replay, ports=plant.ports().closed_by(*self.ports)))

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

    @classmethod
    def chosen(
        cls, names: Sequence[str] | None, frictions: Mapping[str, FrictionModel], plant: Plant | None
    ) -> "FreeParameters":
        """Return the parameters with these names, or those that are free by default.

        `frictions` has the friction model of each contact by its name, or that of the one contact by an empty one. The
        plant's numbers are free only if it is given. By default the scales are free, and with a plant its numbers and
        the viscous coefficients, too: the spectrum of a viscous force is also that of the plant's own damping, so that
        the error of one that is fixed is in the numbers of the plant. ParameterError for a name of no such parameter.
        """
        of_plant, default, known = nonzero_numbers(plant) if plant else (), list[str](), [DEAD_TIME, NOISE]
        for contact, law in frictions.items():
            numbers = [*(SCALES if law.state_size or plant is None else ()), *nonzero_numbers(law)]
            known += [f"{contact}.{number}".lstrip(".") for number in numbers]
            is_default = SCALES if plant is None else (*SCALES, VISCOUS)
            default += [f"{contact}.{number}".lstrip(".") for number in numbers if number in is_default]
        for place, name in enumerate(names or ()):
            if name in (names or ())[:place]:
                raise ParameterError(f"maximum_likelihood.free names '{name}' twice; name each parameter once")
            if name not in (*known, *of_plant):
                nearest = did_you_mean(name, (*known, *of_plant)) or f"; known: {', '.join((*known, *of_plant))}"
                raise ParameterError(f"maximum_likelihood.free: no parameter '{name}' that is not 0{nearest}")
        wanted = tuple(name for name in names or (*default, *of_plant) if name != NOISE)
        return cls(
            tuple(name for name in wanted if name not in of_plant), tuple(name for name in wanted if name in of_plant)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all, those of friction first."""
        return (*self.friction, *self.plant)

    def with_plant(self, plant: Plant) -> "FreeParameters":
        """Return the same of friction with all numbers of a plant."""
        return replace(self, plant=nonzero_numbers(plant))

    def leave_out(self, name: str) -> "FreeParameters":
        """Return the others."""
        friction, plant = (tuple(n for n in group if n != name) for group in (self.friction, self.plant))
        return FreeParameters(friction, plant)

    def logs_of(self, scales: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithms of all parameters for those of the scales of force and deflection."""
        given = dict(zip(SCALES, scales, strict=True))
        return np.array([given.get(name, 0.0) for name in self.names])

    def with_dead_time(self, logs: NDArray[np.float64], added: float, sample_time: float) -> NDArray[np.float64]:
        """Return the logarithms for a dead time that is longer [s], if it is free."""
        return logs + added / sample_time * self._is_dead_time

    def limit(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithms within the bounds of the search."""
        limits = np.where(self._is_dead_time, MAX_DEAD_TIME_SAMPLES, MAX_LOG)
        return np.asarray(np.clip(logs, -limits, limits))

    def values(self, start: Models, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values of all parameters, shape (p,)."""
        values = np.array([self._start_value(start, name) for name in self.names])
        delayed = np.maximum(values + start.replay.sample_time * logs, 0.0)
        return np.where(self._is_dead_time, delayed, values * np.exp(np.where(self._is_dead_time, 0.0, logs)))

    def slopes(self, start: Models, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of the values by what the fit sees, shape (p,)."""
        return np.where(self._is_dead_time, start.replay.sample_time, self.values(start, logs))

    def units(self, start: Models) -> tuple[str, ...]:
        """Return the units of all parameters."""
        given = {**dict.fromkeys(SCALES, "1"), DEAD_TIME: "s"}
        places = [self._place_of(start, name) for name in self.names]
        return tuple(given.get(number) or parameter_unit(owner, number) for owner, number in places)

    def applied_to(self, start: Models, logs: NDArray[np.float64]) -> Models:
        """Return the machine with these parameters, those of friction or all."""
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
            changed = changed.with_dead_time(start.replay.sample_time * float(logs[self.friction.index(DEAD_TIME)]))
        return changed.with_plant(plant) if self.plant else changed

    @property
    def _is_dead_time(self) -> NDArray[np.bool_]:
        return np.array([name == DEAD_TIME for name in self.names], dtype=bool)

    def _start_value(self, start: Models, name: str) -> float:
        owner, number = self._place_of(start, name)
        if number == DEAD_TIME:
            return start.replay.input_path[0]
        return 1.0 if number in SCALES else parameter_value(owner, number)

    def _place_of(self, start: Models, name: str) -> tuple[Plant | FrictionModel, str]:
        """Return the component that has a number, and its name there."""
        if name in self.plant:
            return start.plant, name
        if start.has_one_contact or name == DEAD_TIME:
            return start.friction, name
        contact, _, number = name.partition(".")
        return start.replay.frictions[contact], number


@dataclass(frozen=True)
class MachineProblem:
    """Records of a machine with friction at one contact, whose plant may be unknown, or at several."""

    signals: Signals
    observer: EffectiveInput
    """The friction model of the one contact at the start, the delays and the encoder."""
    free: FreeParameters
    nominal_plant: Plant | None
    modes: int | None
    frictions: Mapping[str, FrictionModel] = field(default_factory=dict)
    """Friction models at the start by the name of their contact, of a plant whose numbers are free."""
    ports: tuple[str, str] = ("", "")
    """Thrust that is excited and position that is compared, as in the loop."""

    @property
    def sample_time(self) -> float:
        """Sample time of all records [s]."""
        return self.signals.segments[0].sample_time

    def free_of(self, plant: Plant) -> FreeParameters:
        """Return what is free of a machine with this plant: all numbers of one that was not given."""
        return self.free.with_plant(plant) if self.nominal_plant is None else self.free

    def models_around(self, plant: Plant) -> Models:
        """Return the machine at the start, with this plant."""
        observer, closed = self.observer, plant.ports().closed_by(*self.ports)
        law = Frictionless() if self.frictions else observer.law
        replay = ReplayModel(
            closed,
            {contact: self.frictions.get(contact, law) for contact in closed.contacts},
            self.sample_time,
            (observer.input_dead_time, observer.input_time_constants),
            (observer.output_dead_time, observer.output_time_constants),
            observer.interpolation_tolerance / TOLERANCE_RATIO,
            self._step_tolerance,
        )
        return Models(plant, replay, ports=self.ports)

    @property
    def _step_tolerance(self) -> float:
        """Relative error of the motion that the steps of a replay may cause: that of a right model, if it is small."""
        motion = max(float(np.ptp(each.channels[self.observer.output])) for each in self.signals.segments) / 2
        error = self.observer.encoder.deviation / motion
        return float(np.clip(MODEL_ERROR * error, REPLAY_ERROR, TOLERANCE_RATIO * REPLAY_ERROR))

    def leave_out(self, name: str) -> "MachineProblem":
        """Return the problem in which a parameter stays as it is at the start."""
        return replace(self, free=self.free.leave_out(name))
