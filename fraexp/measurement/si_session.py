"""A connected machine in SI units, whatever units it counts in: limits mean nothing beside any others."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path

from fraexp.components.kinds import MachineDriver
from fraexp.components.machine_session import Chunk, MachineDescription, MachineSession, PlayRequest
from fraexp.data import units
from fraexp.data.identity import digest_of
from fraexp.errors import ParameterError, PlanError
from fraexp.kernels.cache_folder import cache_folder
from fraexp.measurement.process_lock import process_lock
from fraexp.simulation.motion_limits import MotionLimits

SI_UNITS = {False: {"y": ("m", "a position"), "u": ("N", "a force")}}
SI_UNITS[True] = {"y": ("rad", "an angle"), "u": ("N m", "a torque")}
"""Unit and quantity of the two channels that are compared with limits, by whether the axis is rotary."""


def connect_in_si(machine: MachineDriver, folder: Path, rotary: bool) -> MachineSession:
    """Return a machine, connected, whose position, control input and limits are in SI units.

    MachineError if it cannot be reached, PlanError if its units are not those of such an axis, and BusyError if another
    process of this user measures on it; nothing has moved then.
    """
    with ExitStack() as stack:
        if address := machine.address(folder):
            file = cache_folder() / "machines" / f"{digest_of([machine.name, address]).hex()}.lock"
            with suppress(OSError):  # a cache that cannot be written locks nothing
                stack.enter_context(process_lock(file, f"{machine.name} {address}", "on this machine"))
        session = machine.connect(folder)
        stack.callback(session.close)
        found = SiSession(session, rotary)
        found.at_close = stack.pop_all()
    return found


def si_factors(channels: Mapping[str, str], rotary: bool) -> dict[str, float]:
    """Return what samples of ``y`` and ``u`` are multiplied by to be in SI units; PlanError if they cannot be."""
    found = {}
    for name, (unit, quantity) in SI_UNITS[rotary].items():
        if name not in channels:
            known = ", ".join(channels)
            raise PlanError(f"the machine records no channel '{name}'; expected y and u among {known}")
        try:
            found[name] = units.factor(channels[name], unit)
        except ParameterError as error:
            raise PlanError(
                f"channel {name} of the machine: {error}; expected {quantity}, because limits are compared with it"
            ) from None
    return found


class SiSession(MachineSession):
    """A session whose position and control input are converted, as is what it is asked to play."""

    def __init__(self, session: MachineSession, rotary: bool) -> None:
        self._session, found = session, session.description
        self.at_close = ExitStack()
        """What is released with the connection."""
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
        self.at_close.close()
