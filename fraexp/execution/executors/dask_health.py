"""The health of a Dask cluster: who is silent for how long, what the user reads of it, and when the run gives up.

Times are those of ``time.monotonic`` in seconds. The event loop's thread writes, the run's thread reads.
"""

import os
import queue
import time
from math import inf

from fraexp.data.sweep import Plain
from fraexp.execution.executors.dask_member import WORKER_SILENCE_S, Member
from fraexp.execution.executors.limits import parse_duration

DEFAULT_TIMEOUT_S = 120.0
"""Time to wait for a scheduler, or for workers, that have disappeared or are silent."""
TIMEOUT_VARIABLE = "FRAEXP_DASK_TIMEOUT"
"""Environment variable that replaces it, such as ``10min`` or ``none``."""
NOTICE_DELAY_S = 5.0
"""Time for which something is missing before the user reads for how long; also the step of that time."""
PAUSE_S = 5.0
"""Interval between two looks after which somebody else than a worker has stood still: nobody is blamed for it."""
MAX_SILENCES_SHOWN = 10
"""Maximum number of silent workers that are reported one by one."""
RESUME_HINT = "what is computed is stored, and the same command goes on from there"


def cluster_timeout() -> float:
    """Return the time to wait for a scheduler, or for workers [s]; StudyError if the variable is invalid."""
    text = os.environ.get(TIMEOUT_VARIABLE, "")
    return parse_duration(text, TIMEOUT_VARIABLE) if text else DEFAULT_TIMEOUT_S


class ClusterHealth:
    """Watches a scheduler and its workers."""

    def __init__(self, address: str) -> None:
        self.address, self.timeout = address, cluster_timeout()
        self.members: dict[str, Member] = {}
        self.notes: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.failure = ""
        """Why nothing more can be computed; empty while something can."""
        self.is_unreached = False
        """Whether the run ends because nobody is there to compute, not because of an error."""
        self._is_gone = self._is_silence_told = False
        self._silences_told = 0
        self._looked = self._answered = self.resumed = self._promised = self._ready = time.monotonic()

    @property
    def ready_count(self) -> int:
        """Number of workers that can be given work."""
        return sum(member.is_ready for member in list(self.members.values()))

    @property
    def silence(self) -> float:
        """Time for which the scheduler has not answered [s]."""
        return time.monotonic() - self._answered

    def fail(self, reason: str, is_unreached: bool = False) -> None:
        """End the run, for the first reason that is given."""
        if not self.failure:
            self.failure, self.is_unreached = reason, is_unreached

    def note_connection(self) -> None:
        """Note that the scheduler has been reached: all waiting begins anew."""
        self._tell_return()
        self._is_gone = False
        self._looked = self._answered = self.resumed = self._promised = time.monotonic()

    def note_disconnection(self) -> None:
        """Note that the connection to the scheduler is lost."""
        self._is_gone = self._is_silence_told = True
        self.notes.put(f"the Dask scheduler at {self.address} is gone; {self._patience}")

    def note_answer(self, workers: Plain) -> None:
        """Note what the scheduler says about its workers."""
        now = time.monotonic()
        pause = now - self._answered
        if pause > PAUSE_S:
            self._tell_return()
            self.resumed = now
        self._answered = now
        for address, member in self.members.items():
            if pause > PAUSE_S:
                member.excuse_silence(pause)
            if member.note_heartbeat(workers[address]["last_seen"], now):
                self._tell_silence(member)
        if any(member.is_promising for member in self.members.values()):
            self._promised = now
        if self.ready_count:
            self._ready = now

    def look(self, has_work: bool) -> None:
        """Tell the user what is missing; end the run if it has been for too long and there is work."""
        now = time.monotonic()
        if now - self._looked > PAUSE_S:  # this process has stood still, as after Ctrl-Z
            pause = now - self._looked
            self._answered, self._promised, self._ready = (
                min(instant + pause, now) for instant in (self._answered, self._promised, self._ready)
            )
        self._looked = now
        if self.silence > NOTICE_DELAY_S and not self._is_silence_told:
            self._is_silence_told = True
            self.notes.put(f"the Dask scheduler at {self.address} is silent; {self._patience}")
        if has_work and self.silence > self.timeout:
            silent = f"the Dask scheduler at {self.address} was silent for {self.timeout:g} s"
            self.fail(f"{silent}; {RESUME_HINT}", is_unreached=True)
        elif has_work and self._answered - max(self._promised, self.resumed) > self.timeout:
            silent = ", ".join(str(member) for member in self.members.values() if member.is_silent)
            remedy = f"silent: {silent[:200]}" if silent else "start one: dask worker"
            self.fail(
                f"Dask at {self.address} had no worker for {self.timeout:g} s; {remedy}; {RESUME_HINT}",
                is_unreached=True,
            )

    def status(self) -> str:
        """Return what the run waits for, such as ``Dask scheduler silent for 20 s``; empty if all is well."""
        if self.silence >= NOTICE_DELAY_S:
            return f"Dask scheduler {'gone' if self._is_gone else 'silent'}{_for_seconds(self.silence)}"
        if self._is_gone:
            return "Dask scheduler gone"
        members = list(self.members.values())
        silent = sum(member.is_silent for member in members)
        if not self.ready_count:
            words = "no workers ready" if any(member.is_promising for member in members) else "no workers"
            return f"{words}{_for_seconds(time.monotonic() - self._ready)}{f', {silent} silent' if silent else ''}"
        return f"{silent} Dask worker{'s' if silent > 1 else ''} silent" if silent else ""

    @property
    def _patience(self) -> str:
        return "waiting for it" + (f" up to {self.timeout:g} s" if self.timeout < inf else "")

    def _tell_return(self) -> None:
        if self._is_silence_told:
            self._is_silence_told = False
            self.notes.put(f"the Dask scheduler at {self.address} answers again after {self.silence:.0f} s")

    def _tell_silence(self, member: Member) -> None:
        self._silences_told += member.is_silent
        if self._silences_told > MAX_SILENCES_SHOWN:
            return
        if member.is_silent:
            self.notes.put(
                f"Dask worker {member} has been silent for {WORKER_SILENCE_S:g} s; its work is sent to others, too"
            )
        else:
            self.notes.put(f"Dask worker {member} answers again")


def _for_seconds(duration: float) -> str:
    """Return ``for 20 s`` in steps that do not flicker; empty for a moment."""
    whole = int(duration // NOTICE_DELAY_S * NOTICE_DELAY_S)
    return f" for {whole} s" if whole else ""
