"""Service of one Dask worker: it is checked, then given one batch after another; a batch may go to several workers."""

import asyncio
import itertools
import pickle
import time
from concurrent import futures
from contextlib import suppress
from uuid import uuid4

from fraexp.data.sweep import Plain
from fraexp.execution.executors.dask_address import first_line
from fraexp.execution.executors.dask_check import DaskClient, check_worker
from fraexp.execution.executors.dask_connection import POLL_INTERVAL_S
from fraexp.execution.executors.dask_health import ClusterHealth
from fraexp.execution.executors.dask_member import WORKER_SILENCE_S, Member
from fraexp.execution.executors.dask_remote import BatchAnswer, MissingRequirement, compute_batch, end_process
from fraexp.execution.executors.dask_work import BATCH_DURATION_S, Batch, ClusterWork
from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import WorkerLostError

CHECK_TIMEOUT_S = 60.0
"""Time in which a worker must answer what it is asked in its check; then it is asked again."""
RESTART_TIMEOUT_S = 120.0
"""Time to wait for the end of a worker that is ended."""
REMOVAL_DELAY_S = 5.0
"""Time after which a worker that has ended has left the cluster's list."""
MAX_REFUSALS_SHOWN = 5
"""Maximum number of refused workers that are reported one by one."""


class WorkerService:
    """Gives work to the workers of a cluster."""

    def __init__(self, health: ClusterHealth, tasks: ClusterWork, limits: ResourceLimits) -> None:
        self._health, self._tasks, self._limits = health, tasks, limits
        self._batches: dict[int, Batch] = {}
        self._numbers = itertools.count()
        self._run_id = uuid4().hex[:12]
        self._refused_count = 0

    async def serve(self, client: DaskClient, member: Member) -> None:
        """Check a worker, then send it one batch after another, unless it is silent."""
        try:
            while not member.refused:
                if member.is_silent:
                    await asyncio.sleep(POLL_INTERVAL_S)
                elif member.process or await self._check(client, member):
                    await self._send_next(client, member)
        except Exception as error:  # nobody must wait in vain
            self._health.fail(f"Dask at {self._health.address}: {type(error).__name__}: {first_line(error)}")

    async def _check(self, client: DaskClient, member: Member) -> bool:
        """Check a worker, note the finding, and return whether it may compute."""
        try:
            member.process, reason = await asyncio.wait_for(check_worker(client, member.address), CHECK_TIMEOUT_S)
        except (OSError, futures.CancelledError):  # a broken connection, or no answer
            await asyncio.sleep(POLL_INTERVAL_S)
            return False
        if reason:
            self._refuse(member, reason)
            return False
        member.fit = True
        return True

    def _refuse(self, member: Member, reason: str) -> None:
        member.fit, member.refused = False, reason
        self._refused_count += 1
        if self._refused_count <= MAX_REFUSALS_SHOWN:
            self._health.notes.put(f"Dask worker {member} is left out: it {reason}")

    async def _send_next(self, client: DaskClient, member: Member) -> None:
        """Wait for work and send it, unless the worker has fallen silent in the meantime."""
        batch = await self._tasks.take(self._health.ready_count)
        if member.is_silent:
            self._tasks.give_back(batch)
        else:
            await self._send_batch(client, member, batch)

    async def _send_batch(self, client: DaskClient, member: Member, batch: Batch) -> None:
        """Have a worker compute a batch, and accept its answer."""
        number = next(self._numbers)
        payload = batch.payload(member.process)
        try:
            future = client.submit(
                compute_batch, payload, self._run_id, number, 2 * BATCH_DURATION_S,
                key=f"fraexp-{self._run_id}-{number}", workers=[member.address], allow_other_workers=False, pure=False,
            )  # fmt: skip
        except Exception:  # the connection has just been lost
            self._tasks.give_back(batch)
            await asyncio.sleep(POLL_INTERVAL_S)
            return
        self._batches[number] = batch
        waiting = asyncio.ensure_future(future.result())
        try:
            await self._wait_for_answer(member, batch, waiting)
        except asyncio.CancelledError:
            if member.lost or (member.left and not batch.note_departure()):
                self._tasks.lose(batch, WorkerLostError(member.loss_reason))
            else:
                self._tasks.give_back(batch)
            raise
        finally:
            del self._batches[number]
            has_answer = waiting.done()
            waiting.cancel()
            future.release()
        if has_answer:
            await self._accept(member, batch, _result_of(waiting))
        elif batch.is_settled:
            pass
        elif self._is_given_up(member):
            silent = f"its Dask worker {member} was silent for {self._health.timeout:g} s"
            self._tasks.lose(batch, WorkerLostError(silent))
        else:
            await self._kill_overdue(client, member, batch)

    async def _wait_for_answer(self, member: Member, batch: Batch, waiting: "asyncio.Future[bytes]") -> None:
        """Wait until a batch has its answer, from this worker or from others, is overdue, or its worker is given up."""
        while not (waiting.done() or batch.is_settled or batch.is_overdue(self._limits) or self._is_given_up(member)):
            await asyncio.wait({waiting}, timeout=POLL_INTERVAL_S)
            if not waiting.done() and (member.is_silent or self._has_not_begun(batch)):
                self._tasks.send_again(batch)

    def _is_given_up(self, member: Member) -> bool:
        """Return whether a worker has been silent for so long that it counts as lost; without others the run ends."""
        others = [other for other in self._health.members.values() if other is not member]
        return member.silence > self._health.timeout and any(other.is_promising for other in others)

    def _has_not_begun(self, batch: Batch) -> bool:
        """Return whether a worker lets its batch wait, as one does that Dask has paused."""
        return batch.began is None and time.monotonic() - max(batch.sent, self._health.resumed) > WORKER_SILENCE_S

    async def _accept(self, member: Member, batch: Batch, came: "bytes | BaseException") -> None:
        from distributed import KilledWorker

        said = _unpickle(came)
        if isinstance(said, BatchAnswer):
            self._tasks.answer(batch, said)
        elif isinstance(said, MissingRequirement):
            self._refuse(member, said.reason)
            self._tasks.give_back(batch)
        elif said is None or isinstance(said, KilledWorker):  # another process has taken its place
            member.fit, member.process = False, ""
            self._tasks.lose(batch, WorkerLostError(member.loss_reason))
        elif isinstance(said, OSError | asyncio.CancelledError | futures.CancelledError):  # a broken connection
            self._tasks.give_back(batch)
            await asyncio.sleep(POLL_INTERVAL_S)
        else:
            self._refuse(member, f"cannot compute ({type(said).__name__}: {first_line(said)})")
            self._tasks.give_back(batch)

    async def _kill_overdue(self, client: DaskClient, member: Member, batch: Batch) -> None:
        """End a worker that exceeds the time limit: Dask cannot stop a job in any other way."""
        member.fit = False
        self._tasks.lose(batch, WorkerLostError(self._limits.overdue_message(), is_retryable=False))
        with suppress(Exception):
            if member.nanny:
                ending = client.restart_workers([member.address], timeout=RESTART_TIMEOUT_S, raise_for_error=False)
            else:
                ending = client.run(end_process, workers=[member.address], on_error="ignore")
            await asyncio.wait_for(ending, RESTART_TIMEOUT_S)
        await asyncio.sleep(REMOVAL_DELAY_S)  # until then it is gone, and this task is cancelled
        member.process = ""

    def note_event(self, event: tuple[float, Plain]) -> None:
        """Note what a worker reports about a batch."""
        said = event[1]
        batch = self._batches.get(said.get("batch", -1)) if said.get("run") == self._run_id else None
        if batch is not None:
            self._tasks.note_progress(batch, said["place"], said.get("done"), said.get("compiling", ""))


def _result_of(waiting: "asyncio.Future[bytes]") -> "bytes | BaseException":
    try:
        return waiting.result()
    except (Exception, asyncio.CancelledError) as error:
        return error


def _unpickle(came: "bytes | BaseException") -> object:
    try:
        return pickle.loads(came) if isinstance(came, bytes) else came
    except Exception as error:  # only the worker can import its type
        return error
