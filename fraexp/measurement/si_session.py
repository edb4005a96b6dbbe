"""A connected machine in SI units, whatever units it counts in: limits mean nothing beside any others."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from fraexp.components.kinds import MachineDriver
from fraexp.components.machine_session import Chunk, MachineDescription, MachineSession, PlayRequest
from fraexp.data import units
from fraexp.errors import MachineError, ParameterError
from fraexp.simulation.motion_limits import MotionLimits

SI_UNITS = {False: {"y": ("m", "a position"), "u": ("N", "a force")}}
SI_UNITS[True] = {"y": ("rad", "an angle"), "u": ("N m", "a torque")}
"""Unit and quantity of the two channels that are compared with limits, by whether the axis is rotary."""


def connect_in_si(machine: MachineDriver, folder: Path, rotary: bool) -> MachineSession:
    """Return a machine, connected, whose position, control input and limits are in SI units.

    MachineError if it cannot be reached, or if its units are not those of such an axis; nothing has moved then.
    """
    session = machine.connect(folder)
    try:
        return SiSession(session, rotary)
    except BaseException:
        session.close()
        raise


def si_factors(channels: Mapping[str, str], rotary: bool) -> dict[str, float]:
    """Return what samples of ``y`` and ``u`` are multiplied by to be in SI units; MachineError if they cannot be."""
    found = {}
    for name, (unit, quantity) in SI_UNITS[rotary].items():
        if name not in channels:
            known = ", ".join(channels)
            raise MachineError(f"the machine records no channel '{name}'; expected y and u among {known}")
        try:
            found[name] = units.factor(channels[name], unit)
        except ParameterError as error:
            raise MachineError(
                f"channel {name} of the machine: {error}; expected {quantity}, because limits are compared with it"
            ) from None
    return found


class SiSession(MachineSession):
    """A session whose position and control input are converted, as is what it is asked to play."""

    def __init__(self, session: MachineSession, rotary: bool) -> None:
        self._session, found = session, session.description
        self._factors = si_factors(found.channels, rotary)
        limits = MotionLimits.parse(found.limits, "limits of the machine", rotary=rotary).plain()
        stated = {name: value for name, value in limits.items() if value is not None}
        channels = {**found.channels, **{name: unit for name, (unit, _) in SI_UNITS[rotary].items()}}
        self._description = replace(found, channels=channels, limits=stated)

    @property
    def description(self) -> MachineDescription:
        return self._description

    def play(self, request: PlayRequest) -> Iterator[Chunk]:
        for chunk in self._session.play(replace(request, waveform=request.waveform / self._factors["u"])):
            scaled = {name: factor * chunk.channels[name] for name, factor in self._factors.items()}
            yield replace(chunk, channels={**chunk.channels, **scaled})

    def stop(self) -> None:
        self._session.stop()

    def close(self) -> None:
        self._session.close()
