"""A connected machine in SI units, whatever units it counts in, watched from the first sample to the last."""

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fraexp.components.machine_session import Chunk, MachineDescription, MachineSession, PlayRequest
from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.data import units
from fraexp.data.atomic_file import process_lock
from fraexp.data.identity import digest_of
from fraexp.errors import ConnectionLostError, MachineError, ParameterError, PlanError
from fraexp.kernels.cache_folder import cache_folder
from fraexp.measurement.consent import require_consent
from fraexp.measurement.measurement_plan import joint_limits
from fraexp.measurement.motion_guard import LimitExceededError, MotionGuard, RestWatch, RunawayError
from fraexp.simulation.motion_limits import NO_DEMAND, Demand, MotionLimits

SI_UNITS = {False: {"y": ("m", "a position"), "u": ("N", "a force")}}
SI_UNITS[True] = {"y": ("rad", "an angle"), "u": ("N m", "a torque")}
"""Unit and quantity of the two channels that are compared with limits, by whether the axis is rotary."""
REST_S, MAX_RESTS = 0.5, 8
"""Time for which nothing is played before anything is, and how many times it is if the axis still drifts."""
PAUSE_S = 0.02
"""Time before a play [s]: a machine may still read signs of life of the one that has just ended."""
PACE_RATIO = 1.2
"""Samples over those that the clock counts meanwhile, or below them, from which a sample time is doubted."""
DRIVE_OFF = "the drive was switched off"
NO_DISABLE = "switch the drive off: this machine offers no disable, and a stop ends the excitation alone"


def drive_note(name: str, can_disable: bool | None) -> str:
    """Return what the user must know of a machine whose drive cannot be switched off; empty if it can be."""
    if can_disable is None:
        return f"whether '{name}' can switch its drive off is known when it is connected"
    return "" if can_disable else f"'{name}' offers no disable: if the loop runs away, switch its drive off by hand"


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


class WatchedMachine:
    """A connected machine whose every sample is compared with what a sound axis does; a context manager.

    Its position, control input and limits are in SI units. Nothing is played before it is known to be at rest.
    """

    def __init__(self, session: MachineSession, rotary: bool, stated: MotionLimits, share: float = 1.0) -> None:
        """Take a session, the limits that the study states, and the part of them that may be reached."""
        self._session, found = session, session.description
        self.at_close = ExitStack()
        """What is released with the connection."""
        self._factors = si_factors(found.channels, rotary)
        limits = MotionLimits.parse(found.limits, "limits of the machine", rotary=rotary).plain()
        limits = {name: value for name, value in limits.items() if value is not None}
        channels = {**found.channels, **{name: unit for name, (unit, _) in SI_UNITS[rotary].items()}}
        self.description: MachineDescription = replace(found, channels=channels, limits=limits)
        self.guard = MotionGuard(joint_limits(stated, limits), found.sample_time, share)
        self.rest: NDArray[np.float64] = np.empty(0)
        """Positions while nothing was played [m], shape (n,)."""
        self.fault: MachineError | None = None
        """What ended the play that runs, or the last one."""
        self._is_stopped, self._paced, self._elapsed = False, 0, 0.0

    @property
    def can_disable(self) -> bool:
        """Whether its drive can be switched off."""
        return self._session.can_disable

    def play(self, request: PlayRequest, highest_frequency: float, expected: Demand = NO_DEMAND) -> Iterator[Chunk]:
        """Play a period whose highest frequency [Hz] and motion are given; yield what is recorded, to a stop's end.

        What is wrong ends the play, and is raised as soon as all is recorded: LimitExceededError after a stop,
        RunawayError after the drive was switched off.
        """
        self.fault = None
        self.guard.begin(highest_frequency, request.ramp_out, expected)
        for chunk in self._chunks(request):
            excitation = request.excitation(chunk.start, chunk.start + chunk.size)
            self._end_play(self.guard.look(chunk, excitation))
            yield chunk
        if self.description.is_live and isinstance(fault := self.fault, LimitExceededError):
            self.await_rest()
            self.fault = fault
        self._raise_fault()

    def await_rest(self) -> None:
        """Play nothing until the axis is at rest; RunawayError, and the drive is off, if it moves by itself."""
        watch = RestWatch(self.guard.limits, self.description.sample_time, self.guard.of_play.stroke)
        silence = PlayRequest(0, np.zeros(max(round(REST_S / self.description.sample_time), 1)), 1)
        self.fault = None
        for _ in range(MAX_RESTS if self.description.is_live else 1):
            for chunk in self._paced_chunks(silence):
                self._end_play(watch.look(chunk))
            self._raise_fault()
            if watch.is_at_rest:
                break
        if watch.goes_on:
            self._end_play(watch.error())
            self._raise_fault()
        self.rest = watch.position
        self.guard.rest_force, self.guard.rest_power = watch.force, watch.power

    def remarks(self, name: str) -> list[str]:
        """Return what the user must know of a machine of that name: its drive stays on, or its clock is another one."""
        found = [drive_note(name, self.can_disable)]
        expected, rate = 1 / self.description.sample_time, self._paced / max(self._elapsed, 1e-9)
        if self.description.keeps_time and self._elapsed and not 1 / PACE_RATIO < rate / expected < PACE_RATIO:
            found.append(
                f"'{name}' records {rate:.4g} samples per second of the clock, where its sample time means "
                f"{expected:.4g}: correct loop.sample_time, unless '{name}' is a simulation"
            )
        return [*filter(None, found)]

    def _paced_chunks(self, request: PlayRequest) -> Iterator[Chunk]:
        """Play, and count the samples after the first chunk, and their time by the clock."""
        begun = None
        for chunk in self._chunks(request):
            now = time.monotonic()
            if begun is not None:
                self._paced, self._elapsed = self._paced + chunk.size, self._elapsed + now - begun
            begun = now
            yield chunk

    def stop(self) -> None:
        """Let the excitation go to 0 within the ramp out of the play."""
        self._is_stopped = True
        self._session.stop()

    def _chunks(self, request: PlayRequest) -> Iterator[Chunk]:
        """Play, and yield what is recorded, in SI units and without gaps.

        ConnectionLostError if samples are missing or come twice: a machine ends a play early when it is stopped, and by
        nothing else.
        """
        count, self._is_stopped = 0, False
        time.sleep(PAUSE_S if self.description.is_live else 0.0)
        for chunk in self._session.play(replace(request, waveform=request.waveform / self._factors["u"])):
            end = chunk.start + chunk.size
            if chunk.start != count or end > request.samples:
                expected = f"expected those from {count} on, of {request.samples} in all"
                raise ConnectionLostError(f"the machine sent samples {chunk.start} to {end}; {expected}")
            count = end
            scaled = {name: factor * chunk.channels[name] for name, factor in self._factors.items()}
            yield replace(chunk, channels={**chunk.channels, **scaled})
        if count < request.samples and not self._is_stopped:
            raise ConnectionLostError(
                f"the machine ended the play after {count} of {request.samples} samples, without a stop and without an "
                "error: check what it can store and play"
            )

    def _end_play(self, fault: MachineError | None) -> None:
        """Stop the play for a fault, and switch the drive off if the axis moves by itself."""
        is_worse = isinstance(fault, RunawayError) and not isinstance(self.fault, RunawayError)
        if fault is None or not (self.fault is None or is_worse):
            return
        self.fault = fault
        if isinstance(fault, RunawayError):
            self.fault = RunawayError(*fault.args, f"; {DRIVE_OFF if self.can_disable else NO_DISABLE}")
            if self.can_disable:
                self._session.disable()
        self.stop()

    def _raise_fault(self) -> None:
        if self.fault is not None:
            raise self.fault

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop the machine, and release the connection."""
        self.at_close.close()


def connect_watched(
    settings: MeasurementSettings,
    folder: Path,
    rotary: bool,
    stated: MotionLimits,
    share: float = 1.0,
    is_trusted: bool = False,
) -> WatchedMachine:
    """Return the machine of a study, connected, and at rest if it shows its samples while it plays.

    MachineError if it cannot be reached, PlanError if its units are not those of such an axis, BusyError if another
    process of this user measures on it, ConsentError if the user has not allowed what it does unless it is trusted, and
    RunawayError if it moves by itself.
    """
    machine = settings.machine
    if not is_trusted:
        require_consent(machine, folder)
    with ExitStack() as stack:
        if address := machine.address(folder):
            file = cache_folder() / "machines" / f"{digest_of([machine.name, address]).hex()}.lock"
            with suppress(OSError):  # a cache that cannot be written locks nothing
                stack.enter_context(process_lock(file, f"{machine.name} {address}", "on this machine"))
        session = machine.connect(folder)
        stack.callback(session.close)
        found = WatchedMachine(session, rotary, stated, share)
        if found.description.is_live:
            found.await_rest()
        found.at_close = stack.pop_all()
    return found
