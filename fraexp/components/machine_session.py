"""What a machine is to those who measure on it: what it says of itself, what it is asked to play, what it records."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import MachineError, PlanError


@dataclass(frozen=True)
class MachineDescription:
    """What a machine says of itself when it is connected."""

    channels: Mapping[str, str]
    """Unit of each recorded channel by its name; the position ``y`` and the control input ``u`` are among them.

    Both may be in any unit of a position and a force, or of an angle and a torque.
    """
    sample_time: float
    """Sample time [s]."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Limits that the machine states, by the names and in the units of the section [limits]."""
    watchdog: float = 0.5
    """Time [s] without a sign of life after which the machine stops by itself."""
    is_live: bool = True
    """Whether samples arrive while it plays, so that a play can be ended early."""
    keeps_time: bool = True
    """Whether its samples are as far apart as the sample time says: a simulation may be faster, or slower."""


@dataclass(frozen=True)
class PlayRequest:
    """A period to be played: from rest, so many times over, and out to rest again."""

    number: int
    """Number of its point in the measurement, from 0."""
    waveform: NDArray[np.float64]
    """One period in the unit of the channel ``u``, shape (n,): what is added to the control input."""
    repetitions: int
    """How many periods are played at most; the ramp out comes after them."""
    amplitude_rise: float = 0.0
    """Rise of the relative amplitude per sample, from 0 at the first one; 0 for all of it at once."""
    ramp_out: int = 1
    """Samples in which the amplitude falls to 0 at the end, and at a stop."""

    @property
    def full_samples(self) -> int:
        """Samples before the ramp out."""
        return self.repetitions * self.waveform.size

    @property
    def samples(self) -> int:
        """Samples in all."""
        return self.full_samples + self.ramp_out

    def excitation(self, begin: int, end: int, stop: int | None = None) -> NDArray[np.float64]:
        """Return the samples, in the unit of the channel ``u``, from `begin` to before `end`, shape (end - begin,).

        With `stop` the ramp out begins at that sample. After it the excitation is 0.
        """
        index = np.arange(begin, end)
        last = self.full_samples if stop is None else min(stop, self.full_samples)
        rising = np.minimum(0.0 + self.amplitude_rise * index, 1.0) if self.amplitude_rise else np.ones(index.size)
        falling = np.clip(1.0 - (index - last + 1) / self.ramp_out, 0.0, 1.0)
        return np.asarray(self.waveform[index % self.waveform.size] * (rising * falling))


@dataclass(frozen=True)
class Chunk:
    """Consecutive samples that a machine has recorded."""

    start: int
    """Its first sample, counted from the first one of the play."""
    channels: Mapping[str, NDArray[np.float64]]
    """Samples by channel, each of shape (n,), in the units of the description."""
    note: str = ""
    """What the user should know of it, such as that it had to be sent again."""

    @property
    def size(self) -> int:
        """Number of samples."""
        return int(next(iter(self.channels.values())).size)


class MachineSession(ABC):
    """A connected machine at rest; a context manager, which stops the machine at its end.

    Each chunk that is taken from `play` is a sign of life. A machine whose chunks are not taken for the time of its
    watchdog must come to rest by itself: whoever measures may have died.
    """

    @property
    @abstractmethod
    def description(self) -> MachineDescription:
        """What the machine says of itself."""

    @abstractmethod
    def play(self, request: PlayRequest) -> Iterator[Chunk]:
        """Play a period and yield what is recorded, chunk by chunk, in order and without gaps.

        It ends after the ramp out, or after `stop`. MachineError if the machine does not answer, or cannot go on.
        """

    @abstractmethod
    def stop(self) -> None:
        """Let the excitation go to 0 within the ramp out of the play; nothing happens to a machine at rest."""

    def disable(self) -> None:
        """Switch the drive off until somebody enables it again; the play that runs ends.

        A stop ends the excitation alone: it leaves a loop closed that runs away by itself. A machine that cannot
        switch its drive off leaves this out.
        """
        raise MachineError("the drive of this machine cannot be switched off over its connection")

    @property
    def can_disable(self) -> bool:
        """Whether the machine offers `disable`."""
        return offers_disable(type(self))

    def close(self) -> None:
        """Stop the machine, and release the connection."""
        self.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def offers_disable(session: type[MachineSession]) -> bool:
    """Return whether sessions of a class can switch the drive off."""
    return session.disable is not MachineSession.disable


def workspace_path(folder: Path, name: str, parameter: str) -> Path:
    """Return where a machine writes, by its name in a parameter; PlanError if that is outside of the workspace."""
    place = (folder / name).resolve()
    if not place.is_relative_to(folder.resolve()):
        raise PlanError(
            f"measurement.machine.{parameter}: {place} is outside of the workspace {folder}; expected a path in it"
        )
    return place
