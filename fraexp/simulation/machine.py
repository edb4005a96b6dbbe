"""The machine of an experiment: its plant and friction, with the sampled loop around them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import Controller, FrictionModel, Plant
from fraexp.components.parameters import Parameters, param
from fraexp.components.ports import Ports
from fraexp.components.registry import Registry, create
from fraexp.data.sweep import Plain, components_by_port
from fraexp.errors import ParameterError, did_you_mean
from fraexp.simulation.discretisation import SignalPath
from fraexp.simulation.experiments import Compensation

FED_BACK = "y"
"""Channel of the measured position that is fed back; another one of name `load` is `y.load`."""

MAX_STEPS_PER_SAMPLE = 1000
"""Maximum number of steps of the plant and its friction per sample."""


LATER_KEYS = ("thrust", "position", "rotary")
"""Keys that came after databases were filled: without them, their sweeps are the same ones as before."""


class ControlLoop(Parameters):
    """The sampled loop around the plant (paper, Figs 3, 5 and 9): clock, delays and encoder."""

    sample_time: float = param("s", "sample time Ts of the controller", above=0)
    input_dead_time: float = param("s", "dead time between control input and thrust", 0.0, at_least=0, at_most=10)
    input_time_constants: tuple[float, ...] = param("s", "time constants of first-order lags before the thrust", ())
    output_dead_time: float = param("s", "dead time between position and its sample", 0.0, at_least=0, at_most=10)
    output_time_constants: tuple[float, ...] = param("s", "time constants of first-order lags before the sample", ())
    thrust: str = param("", "thrust that is excited; the plant's first if not given", "")
    position: str = param("", "position that is fed back to it; that of the thrust's name if not given", "")
    reference: float = param("m", "position reference r", 0.0)
    resolution: float = param("m", "quantisation step of the encoder, 0 for an ideal one", 0.0, at_least=0)
    noise: float = param("m", "standard deviation of the encoder's noise", 0.0, at_least=0)
    seed: int = param("1", "seed of the encoder's noise", 0, at_least=0)
    divergence_limit: float = param("m", "displacement at which the loop counts as diverged", 1.0, above=0)
    rotary: bool = param("", "whether the axis turns: in rad, N m and kg m² instead of m, N and kg", False)

    def model_post_init(self, context: object) -> None:
        """Raise ParameterError for a lag that is not above 0 s."""
        if min(self.input_time_constants + self.output_time_constants, default=1.0) <= 0:
            raise ParameterError("loop has a lag of 0 s or less; a first-order lag must be above 0 s")

    def plain(self) -> dict[str, Any]:
        """Return plain data; what was not there to be chosen once is left out where it is not chosen."""
        return {key: value for key, value in super().plain().items() if value or key not in LATER_KEYS}

    @property
    def input_path(self) -> SignalPath:
        """What delays the control input on its way to the thrust."""
        return SignalPath(self.input_dead_time, self.input_time_constants)

    @property
    def output_path(self) -> SignalPath:
        """What delays the position on its way to its sample."""
        return SignalPath(self.output_dead_time, self.output_time_constants)

    @property
    def delay(self) -> float:
        """Time [s] after which a change of the control input shows in the measured position."""
        lags = sum(self.input_time_constants) + sum(self.output_time_constants)
        return self.input_dead_time + self.output_dead_time + 5 * lags


class Numerics(Parameters):
    """How finely the loop is computed."""

    tolerance: float = param(
        "1", "relative error of a response that the steps may cause", 1e-4, at_least=1e-5, at_most=0.1
    )
    steps_per_sample: int = param(
        "1",
        "steps of the plant and its friction per sample; 0 for what the tolerance needs",
        0,
        at_least=0,
        at_most=MAX_STEPS_PER_SAMPLE,
    )


@dataclass(frozen=True)
class Machine:
    """The parts of a simulated machine."""

    plant: Plant
    friction: FrictionModel | Mapping[str, FrictionModel]
    """The friction model, or one for each of several contacts, by its name."""
    controller: Controller | Mapping[str, Controller]
    """The controller of the thrust that is excited, or one for each of several thrusts, by its name."""
    loop: ControlLoop
    numerics: Numerics
    compensation: Compensation | None = None

    @cached_property
    def ports(self) -> Ports:
        """Where forces act on the plant and positions are measured, those of the loops before the others."""
        controlled = () if isinstance(self.controller, Controller) else self.controller
        return self.plant.ports().closed_by(self.loop.thrust, self.loop.position, controlled)

    @cached_property
    def controllers(self) -> Mapping[str, Controller]:
        """Controller of each thrust that has one, by its name; the first one is excited.

        Raises ParameterError if that has none.
        """
        excited, *others = self.ports.thrusts
        if isinstance(self.controller, Controller):
            return {excited: self.controller}
        if excited not in self.controller:
            raise ParameterError(
                f"the thrust '{excited}' is excited and has no controller; write [controller.{excited}], or set [loop] "
                f"thrust to one that has: {', '.join(self.controller)}"
            )
        return {name: self.controller[name] for name in (excited, *others) if name in self.controller}

    def response(self, omega: NDArray[np.floating]) -> NDArray[np.complex128]:
        """Return the plant's response [m/N] from the thrust to the position of the loop, at omega [rad/s]."""
        has_ports = self.loop.thrust or self.loop.position
        return self.ports.response(omega) if has_ports else self.plant.response(omega)

    @cached_property
    def frictions(self) -> Mapping[str, FrictionModel]:
        """Friction model of each of the plant's contacts, by its name, in their order.

        Raises ParameterError if there is a model without a contact, or a contact without a model.
        """
        return _models_at(list(self.ports.contacts), self.friction)

    @property
    def friction_names(self) -> str:
        """Names of the friction models, such as ``rolling`` or ``rolling+lugre``."""
        return "+".join(model.name for model in self.frictions.values())


def build_machine(experiment: Plain, registry: Registry) -> Machine:
    """Return the machine of an experiment on a loop."""
    return Machine(
        plant=create(registry, Plant, experiment["plant"]),
        friction=_friction(experiment["friction"], registry),
        controller=_controller(experiment["controller"], registry),
        loop=ControlLoop.parse(experiment["loop"], "loop"),
        numerics=Numerics.parse(experiment["numerics"], "numerics"),
        compensation=_compensation(experiment.get("compensation"), registry),
    )


def _friction(section: Plain, registry: Registry) -> FrictionModel | Mapping[str, FrictionModel]:
    models = components_by_port(section)
    if not models:
        return create(registry, FrictionModel, section)
    return {contact: create(registry, FrictionModel, model) for contact, model in models.items()}


def _controller(section: Plain, registry: Registry) -> Controller | Mapping[str, Controller]:
    controllers = components_by_port(section)
    if not controllers:
        return create(registry, Controller, section)
    return {thrust: create(registry, Controller, each) for thrust, each in controllers.items()}


def _models_at(
    contacts: Sequence[str], friction: FrictionModel | Mapping[str, FrictionModel]
) -> Mapping[str, FrictionModel]:
    if isinstance(friction, FrictionModel):
        if len(contacts) == 1:
            return {contacts[0]: friction}
        tables = " and ".join(f"[friction.{contact}]" for contact in contacts)
        raise ParameterError(
            f"[friction] is one model, {friction.name}; the plant has {len(contacts)} contacts: write {tables}"
        )
    for contact in friction:
        if contact not in contacts:
            near, known = did_you_mean(contact, contacts), ", ".join(contacts)
            raise ParameterError(f"[friction.{contact}]: the plant has no contact '{contact}'{near}; known: {known}")
    for contact in contacts:
        if contact not in friction:
            raise ParameterError(
                f"the plant's contact '{contact}' has no friction model; write [friction.{contact}], where name = "
                "'none' stands for no friction"
            )
    return {contact: friction[contact] for contact in contacts}


def _compensation(section: Plain | None, registry: Registry) -> Compensation | None:
    if section is None:
        return None
    return Compensation.parse(registry.fill_inherited(Compensation, section, {}), "compensation")


def reference_response(
    experiment: Plain, frequency: NDArray[np.float64], registry: Registry, output: str = FED_BACK
) -> NDArray[np.complex128]:
    """Return P(jω) [m/N] of an experiment's plant at `frequency` [Hz], shape (n,), to an output's channel."""
    plant, loop = create(registry, Plant, experiment["plant"]), experiment["loop"]
    thrust, position, omega = loop.get("thrust", ""), loop.get("position", ""), 2 * np.pi * frequency
    ports, further = plant.ports().closed_by(thrust, position), output.removeprefix(f"{FED_BACK}.")
    if further in ports.positions:
        return ports.response(omega, further)
    return ports.response(omega) if thrust or position else plant.response(omega)
