"""Jobs on a Dask cluster: each worker is checked, then given one batch at a time; workers may come and go.

fraexp assigns jobs to workers, not Dask: no job reaches a worker that has not been checked, and the job with which
a worker was lost is known.
"""

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import suppress

from fraexp.data.sweep import Plain
from fraexp.errors import StudyError, UnreachedError
from fraexp.execution.executors.dask_address import check_executor_name, first_line
from fraexp.execution.executors.dask_check import DaskClient, silence_dask, split_requirements
from fraexp.execution.executors.dask_connection import (
    CONNECT_TIMEOUT_S,
    POLL_INTERVAL_S,
    ConnectError,
    DisconnectedError,
    ask_identity,
    close,
    connect,
)
from fraexp.execution.executors.dask_health import RESUME_HINT, ClusterHealth
from fraexp.execution.executors.dask_member import Member
from fraexp.execution.executors.dask_remote import TOPIC
from fraexp.execution.executors.dask_service import MAX_REFUSALS_SHOWN, WorkerService
from fraexp.execution.executors.dask_work import ClusterTask, ClusterWork
from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, Workers
from fraexp.execution.job import Job

QUIET_CHECK_S = 3.0
"""Time for which workers are checked before the user is told that none is ready."""
EVENTS_TIMEOUT_S = 5.0
"""Time in which the scheduler must tell why a worker has left."""
STOP_TIMEOUT_S = 0.8
"""Time in which the thread must end; it ends with the process otherwise, as the user must not wait for a cluster."""
LEAVING_WORDS = ("closing", "closing_gracefully", "closing-worker", "retired")
"""Actions and states that Dask logs for a worker that leaves on purpose."""


class Dask(Workers):
    """The suitable workers of a cluster. A thread with an event loop handles the communication with Dask."""

    def __init__(self, name: str, limits: ResourceLimits) -> None:
        self._address = check_executor_name(name)
        self._health = ClusterHealth(self._address)
        self._ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._tasks = ClusterWork()
        self._service = WorkerService(self._health, self._tasks, limits)
        self._main: asyncio.Task[None] = self._loop.create_task(self._serve_cluster())
        self._thread = threading.Thread(target=self._run_loop, daemon=True, name="fraexp dask")
        self._thread.start()
        try:
            self._ready.wait()
        except BaseException:
            self.stop()
            raise
        if self._health.failure:
            self._thread.join(STOP_TIMEOUT_S)
            raise StudyError(self._health.failure)

    @property
    def count(self) -> int:  # type: ignore[override]  # it changes
        """Number of workers that compute."""
        return self._health.ready_count

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        task = ClusterTask(number, *split_requirements(job))
        with suppress(RuntimeError):  # the loop has ended, which `reports` raises
            self._loop.call_soon_threadsafe(self._tasks.add, task)
        return task.future

    def reports(self) -> Iterator[tuple[int, float]]:
        if self._health.failure:
            raise (UnreachedError if self._health.is_unreached else StudyError)(self._health.failure)
        while not self._tasks.reports.empty():
            yield self._tasks.reports.get()

    def compilations(self) -> Iterator[tuple[int, str]]:
        while not self._tasks.compilations.empty():
            yield self._tasks.compilations.get()

    def notes(self) -> Iterator[str]:
        while not self._health.notes.empty():
            yield self._health.notes.get()

    def status(self) -> str:
        return self._health.status()

    def stop(self) -> None:
        with suppress(RuntimeError):  # the loop has ended already
            self._loop.call_soon_threadsafe(self._main.cancel)
        self._thread.join(STOP_TIMEOUT_S)

    def close(self) -> None:
        self.stop()

    def _run_loop(self) -> None:
        """Run the event loop; this is what the thread runs."""
        try:
            self._loop.run_until_complete(self._main)
        except asyncio.CancelledError:
            pass
        except Exception as error:  # nobody must wait in vain
            self._health.fail(f"Dask at {self._address}: {type(error).__name__}: {first_line(error)}")
        finally:
            self._ready.set()
            with suppress(Exception):
                self._end_loop()

    def _end_loop(self) -> None:
        left = asyncio.all_tasks(self._loop)
        for task in left:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        self._loop.close()

    async def _serve_cluster(self) -> None:
        """Have the tasks computed; connect again whenever the scheduler disappears."""
        silence_dask()
        missing = f"no Dask scheduler answers at {self._address}"
        client = await self._connect(CONNECT_TIMEOUT_S, missing, "start one: dask scheduler")
        while not self._health.failure and client is not None:
            try:
                await self._serve_session(client)
            except DisconnectedError:
                client = await self._reconnect()

    async def _reconnect(self) -> DaskClient | None:
        """Return a new connection; None if the run has failed, or fails because there is none in time."""
        if self._health.failure:
            return None
        self._health.note_disconnection()
        left = self._health.timeout - self._health.silence
        gone = f"the Dask scheduler at {self._address} was gone for {self._health.timeout:g} s"
        return await self._connect(left, gone, RESUME_HINT, is_unreached=True)

    async def _connect(
        self, timeout: float, finding: str, remedy: str, is_unreached: bool = False
    ) -> DaskClient | None:
        """Return a connection; None if there is none in time, which fails the run with `finding` and `remedy`."""
        try:
            client = await connect(self._address, timeout, finding, remedy)
        except ConnectError as error:
            self._health.fail(str(error), is_unreached)
            return None
        self._health.note_connection()
        return client

    async def _serve_session(self, client: DaskClient) -> None:
        """Serve the workers of a connected cluster, until the end or until the scheduler disappears."""
        serving: dict[str, asyncio.Task[None]] = {}
        client.subscribe_topic(TOPIC, self._service.note_event)
        scheduler, began = None, self._loop.time()
        try:
            while not self._health.failure:
                seen = await ask_identity(client, lambda: self._may_wait(began))
                if scheduler not in (None, seen["id"]):
                    raise DisconnectedError  # another scheduler runs at the address
                scheduler = seen["id"]
                await self._remove_gone(client, seen["workers"], serving)
                self._add_new(client, seen["workers"], serving)
                self._health.note_answer(seen["workers"])
                self._check_refusals()
                if self._may_wait(began):
                    await asyncio.sleep(POLL_INTERVAL_S)
        finally:
            for task in serving.values():
                task.cancel()
            await asyncio.gather(*serving.values(), return_exceptions=True)
            self._health.members.clear()
            await close(client)

    def _may_wait(self, began: float) -> bool:
        """Watch the cluster's health, and return whether it is worth waiting for."""
        self._health.look(has_work=self._tasks.open > 0)
        if self._health.ready_count:
            self._ready.set()
        elif not self._ready.is_set() and self._loop.time() - began > QUIET_CHECK_S:
            self._health.notes.put(f"waiting for a worker of Dask at {self._address}")
            self._ready.set()
        return not self._health.failure

    async def _remove_gone(self, client: DaskClient, seen: Plain, serving: "dict[str, asyncio.Task[None]]") -> None:
        """Remove workers that have disappeared; one that left on purpose, as when its time is over, is not lost."""
        gone = [self._health.members.pop(address) for address in set(self._health.members) - set(seen)]
        await asyncio.gather(*(_note_departure(client, member) for member in gone))
        for member in gone:
            serving.pop(member.address).cancel()

    def _add_new(self, client: DaskClient, seen: Plain, serving: "dict[str, asyncio.Task[None]]") -> None:
        """Start to serve workers that have joined."""
        for address in sorted(set(seen) - set(self._health.members)):
            member = Member(address, str(seen[address]["name"]), bool(seen[address]["nanny"]))
            self._health.members[address] = member
            serving[address] = self._loop.create_task(self._service.serve(client, member))

    def _check_refusals(self) -> None:
        """End the run if all workers are refused."""
        members = list(self._health.members.values())
        if members and all(member.refused for member in members):
            listed = "; ".join(f"{member} {member.refused}" for member in members[:MAX_REFUSALS_SHOWN])
            more = f"; and {len(members) - MAX_REFUSALS_SHOWN} more" if len(members) > MAX_REFUSALS_SHOWN else ""
            self._health.fail(f"no worker of Dask at {self._address} can compute this study: {listed}{more}")


async def _note_departure(client: DaskClient, member: Member) -> None:
    """Note that a worker has left, and whether it did so on purpose."""
    member.left = True
    with suppress(OSError, TimeoutError):
        events = await asyncio.wait_for(client.get_events(member.address), EVENTS_TIMEOUT_S)
        words = [event.get(word) for _, event in events for word in ("action", "status")]
        member.lost = not set(LEAVING_WORDS).intersection(words)
