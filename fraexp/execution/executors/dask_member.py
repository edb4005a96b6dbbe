"""A worker of a Dask cluster as a run sees it: whether it may compute, and when it was last heard."""

from dataclasses import dataclass

WORKER_SILENCE_S = 15.0
"""Silence after which a worker counts as hung: its batch is sent to another one as well."""


@dataclass(eq=False)
class Member:
    """A worker of the cluster."""

    address: str
    name: str
    nanny: bool
    process: str = ""
    """Identifier of its process, which another one may replace at the same address; empty until it is checked."""
    fit: bool = False
    refused: str = ""
    """Why it must not compute; empty if it may."""
    left: bool = False
    """Whether it has disappeared."""
    lost: bool = False
    """Whether it has disappeared without leaving on purpose."""
    silence: float = 0.0
    """Time for which it has sent no heartbeat [s]."""
    _heartbeat: float = 0.0
    """Time of its last heartbeat by the scheduler's clock, which is only compared with itself [s]."""
    _heard: float = 0.0
    """Time at which the run learned of this heartbeat, by the run's own clock [s]."""

    def __str__(self) -> str:
        return self.address if self.name == self.address else f"{self.name} ({self.address})"

    @property
    def is_silent(self) -> bool:
        """Whether it has sent no heartbeat for so long that it counts as hung."""
        return self.silence > WORKER_SILENCE_S

    @property
    def is_ready(self) -> bool:
        """Whether it can be given work."""
        return self.fit and not self.is_silent

    @property
    def is_promising(self) -> bool:
        """Whether it computes, or may be found able to."""
        return not self.refused and not self.is_silent

    @property
    def loss_reason(self) -> str:
        """Why a job that it was computing has no answer."""
        return f"its Dask worker {self} was lost, as by a crash or for lack of memory; see the worker's log"

    def note_heartbeat(self, heartbeat: float, now: float) -> bool:
        """Note its last heartbeat, and return whether it has fallen silent, or is heard again."""
        if heartbeat != self._heartbeat:
            self._heartbeat, self._heard = heartbeat, now
        was_silent, self.silence = self.is_silent, now - self._heard
        return self.is_silent != was_silent

    def excuse_silence(self, duration: float) -> None:
        """Do not count a time [s] in which its heartbeats could not be learned of."""
        self._heard += duration
