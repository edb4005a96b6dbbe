"""Checks of estimators, of record readers and of machines, with a small simulated machine."""

import math
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from fraexp.analysis.delays import hold_response
from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import (
    Component,
    Controller,
    Estimator,
    Excitation,
    FrictionModel,
    MachineDriver,
    Plant,
    RecordReader,
)
from fraexp.components.machine_session import Chunk, MachineSession, PlayRequest
from fraexp.components.registry import create
from fraexp.data import units
from fraexp.data.findings import remarks
from fraexp.data.results import Outcome, Result
from fraexp.data.signals import Signals
from fraexp.errors import FraexpError, MachineError, RecordError
from fraexp.measurement.watched_machine import si_factors
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.testing.component_checks import registry_with
from fraexp.testing.conformance_check import NotApplicableError, require
from fraexp.testing.examples import installed_components, strategy
from fraexp.testing.walk import SLOW_TIME_STEP_S, Walk, breakaway_displacement, describe_component

SILENCE = PlayRequest(0, np.zeros(50), 4, 0.1, 10)
"""What the checks play."""


def _connected(component: type[MachineDriver]) -> MachineSession:
    """Return a machine with its defaults, connected."""
    driver: MachineDriver = _default_component(component)
    with tempfile.TemporaryDirectory() as folder:
        return driver.connect(Path(folder))


def description(component: type[MachineDriver]) -> None:
    """It says its channels, y and u among them, with known units, a sample time, and limits that fraexp has."""
    with _connected(component) as session:
        found = session.description
    require(found.sample_time > 0, f"its sample time is {found.sample_time} s; expected one above 0")
    require(found.watchdog > 0, f"its watchdog is {found.watchdog} s; expected a time above 0")
    require_si(found.channels)
    try:
        for unit in found.channels.values():
            units.si(unit)
        MotionLimits.parse(found.limits, "limits")
    except FraexpError as error:
        require(False, str(error))


def require_si(channels: Mapping[str, str]) -> None:
    """Require a position and a force, or an angle and a torque."""
    try:
        si_factors(channels, rotary=False)
    except MachineError as error:
        with suppress(MachineError):
            si_factors(channels, rotary=True)
            return
        require(False, f"{error}, or an angle and a torque")


def silence(component: type[MachineDriver]) -> None:
    """It plays a period as often as asked, and its ramp out, and returns all samples in order, without gaps."""
    with _connected(component) as session:
        channels = set(session.description.channels)
        count = sum(_checked_size(chunk, start, channels) for chunk, start in _with_starts(session))
    require(count == SILENCE.samples, f"it returns {count} samples of {SILENCE.samples}")


def stop(component: type[MachineDriver]) -> None:
    """It can be stopped at rest, and while it plays, and then plays again."""
    with _connected(component) as session:
        session.stop()
        for chunk in session.play(SILENCE):
            session.stop()
            require(chunk.size <= SILENCE.samples, f"a chunk has {chunk.size} samples of {SILENCE.samples}")
        count = sum(chunk.size for chunk in session.play(SILENCE))
    require(count == SILENCE.samples, f"after a stop it returns {count} samples of {SILENCE.samples}")


def _with_starts(session: MachineSession) -> list[tuple[Chunk, int]]:
    """Return the chunks of a play, each with the number of samples before it."""
    chunks = list(session.play(SILENCE))
    starts = np.cumsum([0, *(chunk.size for chunk in chunks)]).tolist()
    return list(zip(chunks, starts[:-1], strict=True))


def _checked_size(chunk: Chunk, start: int, channels: set[str]) -> int:
    """Return the size of a chunk that has all channels, in order and of one length."""
    require(chunk.start == start, f"a chunk starts at sample {chunk.start}; expected {start}")
    missing = channels - set(chunk.channels)
    require(not missing, f"a chunk lacks the channel {', '.join(sorted(missing))}")
    for name in channels:
        samples = np.asarray(chunk.channels[name])
        require(
            samples.shape == (chunk.size,), f"channel {name} has the shape {samples.shape}; expected ({chunk.size},)"
        )
        require(np.isfinite(samples).all(), f"channel {name} has values that are not finite numbers")
    return chunk.size


SAMPLE_TIME_S = 500e-6
"""Sample time [s]."""
CROSSOVER_HZ = 8.0
"""Crossover of the loop [Hz]."""
STEPS = 10
"""Steps per sample."""
FREQUENCIES = (5.0, 23.0, 61.0)
"""Frequencies [Hz] at which a response is compared."""


def experiment(mass: float, amplitude: float, friction: Mapping[str, object]) -> dict[str, Any]:
    """Return a free mass [kg] with a lead controller, excited by `amplitude` [N], as a study has it."""
    omega = 2 * math.pi * CROSSOVER_HZ
    return {
        "plant": {"name": "modal", "rigid_body_gain": 1 / mass},
        "friction": friction,
        "controller": {
            "name": "pid", "proportional": mass * omega**2 / 4,
            "derivative_time": 3 / omega, "filter_time": 0.3 / omega,
        },
        "excitation": {
            "name": "stepped_sine", "amplitude": amplitude, "frequencies": FREQUENCIES, "settling_timeout": 5.0,
        },
        "loop": {"sample_time": SAMPLE_TIME_S, "divergence_limit": 1.0},
    }  # fmt: skip


def simulate_experiment(parts: Mapping[str, Any], friction: FrictionModel) -> Signals:
    """Return the signals of such an experiment with this friction."""
    machine = Machine(
        plant=create(installed_components(), Plant, parts["plant"]),
        friction=friction,
        controller=create(installed_components(), Controller, parts["controller"]),
        loop=ControlLoop.parse(parts["loop"], "loop"),
        numerics=Numerics(steps_per_sample=STEPS),
    )
    excitation = create(installed_components(), Excitation, parts["excitation"])
    return simulate_loop(machine, excitation, lambda _: None)


MASS_KG, FORCE_N = 7.6, 10.0
"""Free mass [kg] and force [N] of the linear machine."""
FRICTIONLESS = {"name": "none"}


@cache
def _linear_experiment() -> tuple[Mapping[str, Any], Signals]:
    """Return a frictionless experiment and its signals."""
    parts = _experiment()
    return parts, simulate_experiment(parts, create(installed_components(), FrictionModel, FRICTIONLESS))


def _experiment() -> dict[str, Any]:
    return experiment(MASS_KG, FORCE_N, FRICTIONLESS)


def _default_component(component: type[Component]) -> Any:
    """Return a component with its defaults, which inherits from the experiment what a study would give it."""
    try:
        return registry_with(component).create(component.kind, {"name": component.name}, _experiment())
    except FraexpError as error:
        raise NotApplicableError(f"it has no defaults: {error}") from None


def _linear_result(component: type[Estimator]) -> Result:
    result = _default_component(component).estimate(_linear_experiment()[1])
    require(isinstance(result, Result), f"estimate returns {type(result).__name__}; expected a Result")
    return result


def linear_plant(component: type[Estimator]) -> None:
    """Without friction, its response is that of the plant, with or without the sampling's hold, within 0.1 %."""
    response = _linear_result(component).response
    if response is None:
        raise NotApplicableError("it gives no response")
    if response.unit != "m/N":
        raise NotApplicableError(f"its response is in {response.unit}, not that of the plant")
    omega = 2 * np.pi * response.frequency
    plant = create(installed_components(), Plant, _linear_experiment()[0]["plant"]).response(omega)
    errors = [
        float(np.max(np.abs(response.response / truth - 1)))
        for truth in (plant, plant * hold_response(omega, SAMPLE_TIME_S))
    ]
    require(min(errors) < 1e-3, f"P̂/P is off by {errors[0]:.2%}, and by {errors[1]:.2%} with the hold")


def result_units(component: type[Estimator]) -> None:
    """Response, metrics and curves have known units."""
    result = _linear_result(component)
    found = [metric.unit for metric in result.metrics]
    found += [unit for curve in result.curves for unit in curve.units.values()]
    found += [result.response.unit] if result.response is not None else []
    require(found, "it gives no response, no metric and no curve")
    for unit in found:
        units.si(unit.replace(" ", "*"))
    for curve in result.curves:
        require(set(curve.units) == set(curve.columns), f"the curve {curve.name} has units for {sorted(curve.units)}")


def covariance(component: type[Estimator]) -> None:
    """The response's columns have one shape; its covariance is (n, 2, 2), symmetric and not negative, or NaN."""
    response = _linear_result(component).response
    if response is None:
        raise NotApplicableError("it gives no response")
    n = response.frequency.size
    columns = ("response", "input_amplitude", "output_amplitude", "settled", "settling_time", "residual")
    wrong = [name for name in columns if np.shape(getattr(response, name)) != (n,)]
    require(not wrong, f"{', '.join(wrong)} of a response at {n} frequencies has another shape than ({n},)")
    shape = np.shape(response.covariance)
    require(shape == (n, 2, 2), f"the covariance has shape {shape}; expected ({n}, 2, 2)")
    known = response.covariance[np.isfinite(response.covariance).all(axis=(1, 2))]
    require(np.array_equal(known, known.transpose(0, 2, 1)), "the covariance is not symmetric")
    require((np.linalg.eigvalsh(known) >= -1e-12 * np.abs(known).max(initial=0.0)).all(), "a variance is negative")


def outcome(component: type[Estimator]) -> None:
    """The result keeps the outcome of the signals, such as that they have not settled."""
    signals = replace(_linear_experiment()[1], outcome=Outcome.NOT_SETTLED, findings=remarks("as a test"))
    result = _default_component(component).estimate(signals)
    require(result.outcome is Outcome.NOT_SETTLED, f"the outcome becomes {result.outcome.name}")


def suffixes(component: type[RecordReader]) -> None:
    """It lists the file name endings that it reads, in lower case with their dot."""
    require(component.suffixes, "it reads no suffix")
    wrong = [suffix for suffix in component.suffixes if not suffix.startswith(".") or suffix != suffix.lower()]
    require(not wrong, f"'{', '.join(wrong)}' is not an ending such as '.csv'")


def foreign_file(component: type[RecordReader]) -> None:
    """A file of another format raises a RecordError of one line, not a traceback."""
    contents = {"an empty file": b"", "random bytes": bytes(range(256)) * 8, "a text": b"no record\nat all\n"}
    for suffix in component.suffixes:
        for what, content in contents.items():
            _require_refusal(component, suffix, what, content)


def _require_refusal(component: type[RecordReader], suffix: str, what: str, content: bytes) -> None:
    reader = _default_component(component)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"record{suffix}"
        path.write_bytes(content)
        try:
            reader.read(path, ["force"])
        except RecordError as error:
            require("\n" not in str(error), f"the error for {what} ({suffix}) has several lines")
        except Exception as error:  # whatever it is, a user would see it
            require(False, f"{what} ({suffix}) raises {type(error).__name__}: {error}")
        else:
            require(False, f"{what} ({suffix}) is read without an error")


TOLERANCE = 5e-3
"""Relative error of P̂ (0.04 dB, 0.3°), times |P N| where friction outweighs the plant."""
STUCK_RESONANCE_HZ = 60.0
"""Resonance of the mass that is stuck on the friction's stiffness [Hz]."""
MAX_ACCELERATION = 20.0
"""Greatest acceleration by the friction force [m/s²]."""


@dataclass(frozen=True)
class Exposure:
    """A friction model on a mass that suits it, excited by a multiple of its force."""

    model: FrictionModel
    push: float
    """Amplitude of the excitation in multiples of the friction force."""

    @property
    def force(self) -> float:
        """Friction force [N] in gross sliding."""
        return abs(Walk(self.model, SLOW_TIME_STEP_S).move(10 * breakaway_displacement(self.model))) or 1.0

    @property
    def mass(self) -> float:
        """Moving mass [kg]."""
        return max(
            self.model.max_stiffness / (2 * np.pi * STUCK_RESONANCE_HZ) ** 2, self.force / MAX_ACCELERATION, 1e-6
        )

    def __str__(self) -> str:
        """One line for a report."""
        return f"{describe_component(self.model)}; {self.mass:.4g} kg pushed by {self.push * self.force:.4g} N"


def exposure_strategy(component: type[Component]) -> SearchStrategy[Exposure]:
    """Return the strategy of exposures of a friction model."""
    return st.builds(Exposure, strategy(component), st.sampled_from([4.0, 0.5, 1.5]))


def observer(exposure: Exposure) -> None:
    """An observer with the machine's own friction model finds the plant: P̂ = P within 0.5 % of max(1, |P N|)."""
    parts = experiment(exposure.mass, exposure.push * exposure.force, exposure.model.spec())
    signals = simulate_experiment(parts, exposure.model)
    if signals.outcome is Outcome.NOT_SETTLED:
        raise NotApplicableError("the machine's motion did not become periodic")
    require(signals.outcome is Outcome.OK, signals.message)
    estimator: Any = installed_components().provider(Estimator.kind, "effective_input").component
    response = estimator(friction=exposure.model).estimate(signals).response
    omega = 2 * np.pi * response.frequency
    plant = create(installed_components(), Plant, parts["plant"]).response(omega)
    describing = np.array([abs(phasors(s, "friction") / phasors(s, "displacement")).max() for s in signals.segments])
    error = np.abs(response.response / plant - 1) / np.maximum(1.0, np.abs(plant) * describing)
    worst = int(np.argmax(error))
    require(
        error[worst] <= TOLERANCE,
        f"P̂/P is off by {error[worst]:.2%} of max(1, |P N|) at {response.frequency[worst]:.3g} Hz",
    )
