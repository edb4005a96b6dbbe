"""Checks of machines. They play silence alone: a real machine stays at rest."""

import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from fraexp.components.kinds import MachineDriver
from fraexp.components.machine_session import Chunk, MachineSession, PlayRequest
from fraexp.data import units
from fraexp.errors import FraexpError, MachineError
from fraexp.measurement.watched_machine import si_factors
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.testing import example_loop
from fraexp.testing.component_checks import registry_with
from fraexp.testing.conformance_check import NotApplicableError, require

SILENCE = PlayRequest(0, np.zeros(50), 4, 0.1, 10)
"""What the checks play."""
MASS_KG, FORCE_N = 7.6, 10.0
"""Machine and excitation of the study from which a machine inherits."""


def _connected(component: type[MachineDriver]) -> MachineSession:
    """Return a machine with its defaults, connected."""
    registry = registry_with(component)
    try:
        sections = example_loop.experiment(MASS_KG, FORCE_N, {"name": "none"})
        driver = registry.create(component.kind, {"name": component.name}, sections)
    except FraexpError as error:
        raise NotApplicableError(f"it has no defaults: {error}") from None
    assert isinstance(driver, component)
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
