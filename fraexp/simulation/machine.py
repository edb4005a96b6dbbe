"""The machine of an experiment: its plant and friction, with the sampled loop around them."""

from dataclasses import dataclass
from typing import Any

from fraexp.components.kinds import Controller, FrictionModel, Plant
from fraexp.components.parameters import Parameters, param
from fraexp.components.registry import Registry, create
from fraexp.data.sweep import Plain
from fraexp.errors import ParameterError
from fraexp.simulation.experiments import Compensation


class ControlLoop(Parameters):
    """The sampled loop around the plant (paper, Figs 3, 5 and 9): clock, delays and scale."""

    sample_time: float = param("s", "sample time Ts of the controller", above=0)
    input_dead_time: float = param("s", "dead time between control input and thrust", 0.0, at_least=0, at_most=10)
    input_lags: tuple[float, ...] = param("s", "time constants of first-order lags before the thrust", ())
    output_dead_time: float = param("s", "dead time between position and its sample", 0.0, at_least=0, at_most=10)
    output_lags: tuple[float, ...] = param("s", "time constants of first-order lags before the sample", ())
    reference: float = param("m", "position reference r", 0.0)
    resolution: float = param("m", "resolution of the scale, 0 for an ideal one", 0.0, at_least=0)
    noise: float = param("m", "standard deviation of the scale's noise", 0.0, at_least=0)
    seed: int = param("1", "seed of the scale's noise", 0, at_least=0)
    stroke: float = param("m", "displacement at which the loop counts as diverged", 1.0, above=0)

    def model_post_init(self, context: object) -> None:
        """Check the lags."""
        if min(self.input_lags + self.output_lags, default=1.0) <= 0:
            raise ParameterError("loop has a lag of 0 s or less; a first-order lag must be above 0 s")

    @property
    def delay(self) -> float:
        """Time that a change of the control input needs to be seen in the measured position [s]."""
        lags = sum(self.input_lags) + sum(self.output_lags)
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
        at_most=1000,
    )


@dataclass(frozen=True)
class Machine:
    """What the loop is made of."""

    plant: Plant
    friction: FrictionModel
    controller: Controller
    loop: ControlLoop
    numerics: Numerics
    compensation: Compensation | None = None


def build_machine(experiment: Plain, registry: Registry) -> Machine:
    """Return the machine of an experiment on a loop."""
    return Machine(
        plant=create(registry, Plant, experiment["plant"]),  # type: ignore[type-abstract]
        friction=create(registry, FrictionModel, experiment["friction"]),
        controller=create(registry, Controller, experiment["controller"]),  # type: ignore[type-abstract]
        loop=ControlLoop.parse(experiment["loop"], "loop"),
        numerics=Numerics.parse(experiment["numerics"], "numerics"),
        compensation=_compensation(experiment.get("compensation"), registry),
    )


def _compensation(section: Plain | None, registry: Registry) -> Compensation | None:
    if section is None:
        return None
    return Compensation.parse(registry.filled(Compensation, section, {}), "compensation")


def reference_response(experiment: Plain, frequency: Any, registry: Registry) -> Any:
    """Return P(jω) [m/N] of an experiment's plant at `frequency` [Hz], shape (n,)."""
    plant = create(registry, Plant, experiment["plant"])  # type: ignore[type-abstract]
    return plant.response(2 * 3.141592653589793 * frequency)
