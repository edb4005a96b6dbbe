"""Jobs on a Dask cluster: each worker is checked, then given one batch at a time; any of them may come and go.

Which worker computes what is decided here and not by Dask, so that no job reaches a worker that was not checked, and
that it is known with which job a worker was lost.
"""

import asyncio
import itertools
import pickle
import queue
import threading
from collections.abc import Iterator
from concurrent import futures
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from uuid import uuid4

from fraexp.errors import StudyError, UnreachedError
from fraexp.execution.executors.dask_check import need_of, quiet, unfit
from fraexp.execution.executors.dask_place import address_of, cause, check_name, first_line
from fraexp.execution.executors.dask_remote import TOPIC, Done, Lack, compute, end
from fraexp.execution.executors.dask_work import BATCH, Batch, ClusterTask, ClusterWork
from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.job import Job

CONNECT = 10.0
"""Seconds to wait for the scheduler at first."""
PATIENCE = 120.0
"""Seconds to wait for a scheduler or for workers that are gone."""
PATIENT = 3.0
"""Seconds without a word while workers are checked."""
LOOK = 0.5
"""Seconds between two looks at which workers are there."""
FAREWELL = 5.0
"""Seconds to take leave of the cluster, at most."""
LEAVING = ("closing", "closing_gracefully", "closing-worker", "retired")
"""What Dask notes of a worker that takes its leave."""
TOLD = 5
"""Workers that are left out with a word; more would say the same."""
KEPT = "what is computed is stored, and the same command goes on from there"


@dataclass(eq=False)
class _Member:
    """A worker of the cluster."""

    address: str
    name: str
    nanny: bool
    process: str = ""
    """Tells its process from one that replaces it at the same address."""
    fit: bool = False
    refused: str = ""
    """Why it does not compute."""
    left: bool = False
    """Whether it is gone."""
    lost: bool = False
    """Whether it is gone without having taken its leave."""

    def __str__(self) -> str:
        return self.address if self.name == self.address else f"{self.name} ({self.address})"


class _DisconnectedError(Exception):
    """The scheduler cannot be reached any more."""


class Dask(Workers):
    """The workers of a cluster that are fit for it. A thread with an event loop does all that concerns Dask."""

    def __init__(self, name: str, limits: ResourceLimits) -> None:
        self._place = check_name(name)
        self._limits = limits
        self._notes: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._broken = ""
        self._left_alone = False
        """Whether nobody is there to do the work: an end that is no fault of what was asked for."""
        self._members: dict[str, _Member] = {}
        self._batches: dict[int, Batch] = {}
        self._numbers = itertools.count()
        self._run = uuid4().hex[:12]
        self._left_out = 0
        self._ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._work = ClusterWork()
        self._main: asyncio.Task[None] = self._loop.create_task(self._serve())
        self._thread = threading.Thread(target=self._turn, daemon=True, name="fraexp dask")
        self._thread.start()
        try:
            self._ready.wait()
        except BaseException:
            self.stop()
            raise
        if self._broken:
            self._thread.join(FAREWELL)
            raise StudyError(self._broken)

    @property
    def count(self) -> int:  # type: ignore[override]  # it changes
        """How many workers compute; one if there is none yet, so that there is work when one comes."""
        return max(sum(member.fit for member in list(self._members.values())), 1)

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        task = ClusterTask(number, *need_of(job))
        with suppress(RuntimeError):  # the loop has ended, which `reports` tells of
            self._loop.call_soon_threadsafe(self._work.add, task)
        return task.future

    def reports(self) -> Iterator[tuple[int, float]]:
        if self._broken:
            raise (UnreachedError if self._left_alone else StudyError)(self._broken)
        while not self._work.reports.empty():
            yield self._work.reports.get()

    def notes(self) -> Iterator[str]:
        while not self._notes.empty():
            yield self._notes.get()

    def stop(self) -> None:
        with suppress(RuntimeError):  # the loop has ended already
            self._loop.call_soon_threadsafe(self._main.cancel)
        self._thread.join(2 * FAREWELL)

    def close(self) -> None:
        self.stop()

    def _turn(self) -> None:
        """Run the event loop; this is the thread."""
        try:
            self._loop.run_until_complete(self._main)
        except asyncio.CancelledError:
            pass
        except Exception as error:  # it must not be waited for in vain
            self._broken = self._broken or f"Dask at {self._place}: {type(error).__name__}: {first_line(error)}"
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

    async def _serve(self) -> None:
        """Have the work done, over as many connections as it takes."""
        quiet()
        client = await self._connected(
            CONNECT, f"no Dask scheduler answers at {self._place}; start one: dask scheduler"
        )
        while not self._broken and client is not None:
            try:
                await self._session(client)
            except _DisconnectedError:
                self._left_alone = True
                self._notes.put(f"the Dask scheduler at {self._place} is gone; waiting for it up to {PATIENCE:g} s")
                gone = f"the Dask scheduler at {self._place} was gone for {PATIENCE:g} s; {KEPT}"
                client = await self._connected(PATIENCE, gone)
                self._left_alone = client is None

    async def _connected(self, patience: float, otherwise: str) -> Any:
        """Return a connection to the scheduler; None if there is none after some time, which breaks all off."""
        from distributed import Client

        deadline = self._loop.time() + patience
        while True:
            client = None
            left = deadline - self._loop.time()
            try:
                address = address_of(self._place)  # the file may be another by now
                client = Client(  # type: ignore[no-untyped-call]
                    address, asynchronous=True, set_as_default=False, timeout=max(left, 1.0), name="fraexp"
                )
                return await client
            except OSError as error:
                reason = cause(error)
            except StudyError as error:
                otherwise, reason = str(error), ""
            except Exception as error:  # such as an unknown protocol, or a certificate that does not fit
                self._broken = f"Dask at {self._place}: {type(error).__name__}: {first_line(error)}"
                return None
            finally:
                if client is not None and client.status != "running":
                    await self._left(client)
            if self._loop.time() + 1.0 > deadline:
                self._broken = otherwise + reason
                return None
            await asyncio.sleep(1.0)

    async def _left(self, client: Any) -> None:
        with suppress(Exception):
            await asyncio.wait_for(client._close(fast=True), FAREWELL)

    async def _session(self, client: Any) -> None:
        """Attend to the workers that are there, until all is over or the scheduler is gone."""
        attending: dict[str, asyncio.Task[None]] = {}
        client.subscribe_topic(TOPIC, self._hear)
        scheduler, began = None, self._loop.time()
        alone_since = began
        try:
            while not self._broken:
                seen = await self._identity(client)
                if scheduler not in (None, seen["id"]):
                    raise _DisconnectedError  # it is another one already
                scheduler = seen["id"]
                await self._part(client, seen["workers"], attending)
                self._meet(client, seen["workers"], attending)
                if any(member.fit or not member.refused for member in self._members.values()):
                    alone_since = self._loop.time()
                self._judge(self._loop.time() - alone_since)
                if not self._ready.is_set() and self._loop.time() - began > PATIENT:
                    self._notes.put(f"waiting for a worker of Dask at {self._place}")
                    self._ready.set()
                await asyncio.sleep(LOOK)
        finally:
            for task in attending.values():
                task.cancel()
            await asyncio.gather(*attending.values(), return_exceptions=True)
            self._members.clear()
            await self._left(client)

    async def _identity(self, client: Any) -> Any:
        """Return what the scheduler says of itself and its workers."""
        asked = asyncio.ensure_future(client.scheduler.identity(n_workers=-1))
        try:
            while client.status == "running":
                done, _ = await asyncio.wait({asked}, timeout=LOOK)
                if done:
                    return asked.result()
        except OSError:
            pass
        finally:
            asked.cancel()
        raise _DisconnectedError

    async def _part(self, client: Any, seen: dict[str, Any], attending: "dict[str, asyncio.Task[None]]") -> None:
        """Part with workers that are gone; one that took its leave, as at the end of its time, has not been lost."""
        for address in set(self._members) - set(seen):
            member = self._members.pop(address)
            member.left = True
            with suppress(OSError, TimeoutError):
                events = await asyncio.wait_for(client.get_events(address), FAREWELL)
                words = [event.get(word) for _, event in events for word in ("action", "status")]
                member.lost = not set(LEAVING).intersection(words)
            attending.pop(address).cancel()

    def _meet(self, client: Any, seen: dict[str, Any], attending: "dict[str, asyncio.Task[None]]") -> None:
        """Begin with workers that have come."""
        for address in sorted(set(seen) - set(self._members)):
            member = _Member(address, str(seen[address]["name"]), bool(seen[address]["nanny"]))
            self._members[address] = member
            attending[address] = self._loop.create_task(self._attend(client, member))

    def _judge(self, alone: float) -> None:
        """Break off if there is nobody who could do the work; `alone` is for how long there has been nobody [s]."""
        members = list(self._members.values())
        if members and all(member.refused for member in members):
            told = "; ".join(f"{member} {member.refused}" for member in members[:TOLD])
            more = f"; and {len(members) - TOLD} more" if len(members) > TOLD else ""
            self._broken = f"no worker of Dask at {self._place} can compute this study: {told}{more}"
        elif alone > PATIENCE and self._work.open:
            self._left_alone = True
            self._broken = f"Dask at {self._place} had no worker for {PATIENCE:g} s; start one: dask worker; {KEPT}"

    async def _attend(self, client: Any, member: _Member) -> None:
        """Check a worker, then give it one batch after another."""
        try:
            while not member.refused:
                if member.process or await self._check(client, member):
                    sharers = sum(other.fit for other in self._members.values())
                    await self._give(client, member, await self._work.take(sharers))
        except Exception as error:  # it must not be waited for in vain
            self._broken = f"Dask at {self._place}: {type(error).__name__}: {first_line(error)}"

    async def _check(self, client: Any, member: _Member) -> bool:
        """Say whether a worker is fit, and take note of it."""
        try:
            member.process, reason = await unfit(client, member.address)
        except (OSError, futures.CancelledError):  # a broken connection
            await asyncio.sleep(LOOK)
            return False
        if reason:
            self._refuse(member, reason)
            return False
        member.fit = True
        self._ready.set()
        return True

    def _refuse(self, member: _Member, reason: str) -> None:
        member.fit, member.refused = False, reason
        self._left_out += 1
        if self._left_out <= TOLD:
            self._notes.put(f"Dask worker {member} is left out: it {reason}")

    async def _give(self, client: Any, member: _Member, batch: Batch) -> None:
        """Have a worker compute a batch, and take what comes of it."""
        number = next(self._numbers)
        sent = batch.sent(member.process)
        try:
            future = client.submit(
                compute, sent, self._run, number, 2 * BATCH,
                key=f"fraexp-{self._run}-{number}", workers=[member.address], allow_other_workers=False, pure=False,
            )  # fmt: skip
        except Exception:  # a connection that has just been lost
            self._work.give_back(batch)
            await asyncio.sleep(LOOK)
            return
        self._batches[number] = batch
        waiting = asyncio.ensure_future(future._result())
        try:
            while not waiting.done() and not batch.overdue(self._limits):
                await asyncio.wait({waiting}, timeout=LOOK)
        except asyncio.CancelledError:
            if member.lost or (member.left and not batch.spared()):
                self._work.lose(batch, WorkerLostError(_lost(member)))
            else:
                self._work.give_back(batch)
            raise
        finally:
            del self._batches[number]
            overdue = not waiting.done()
            waiting.cancel()
            future.release()
        if overdue:
            await self._end_overdue(client, member, batch)
        else:
            await self._take(member, batch, _came(waiting))

    async def _take(self, member: _Member, batch: Batch, came: "bytes | BaseException") -> None:
        from distributed import KilledWorker

        said = _opened(came)
        if isinstance(said, Done):
            self._work.answer(batch, said)
        elif isinstance(said, Lack):
            self._refuse(member, said.reason)
            self._work.give_back(batch)
        elif said is None or isinstance(said, KilledWorker):  # another process is there in its place
            member.fit, member.process = False, ""
            self._work.lose(batch, WorkerLostError(_lost(member)))
        elif isinstance(said, OSError | asyncio.CancelledError | futures.CancelledError):  # a broken connection
            self._work.give_back(batch)
            await asyncio.sleep(LOOK)
        else:
            self._refuse(member, f"cannot compute ({type(said).__name__}: {first_line(said)})")
            self._work.give_back(batch)

    async def _end_overdue(self, client: Any, member: _Member, batch: Batch) -> None:
        """End a worker that takes too long; Dask can end no job without it."""
        member.fit = False
        self._work.lose(batch, WorkerLostError(self._limits.overdue(), again=False))
        with suppress(Exception):
            if member.nanny:
                ending = client.restart_workers([member.address], timeout=PATIENCE, raise_for_error=False)
            else:
                ending = client.run(end, workers=[member.address], on_error="ignore")
            await asyncio.wait_for(ending, PATIENCE)
        await asyncio.sleep(FAREWELL)  # by when it is gone, and this with it
        member.process = ""

    def _hear(self, event: tuple[float, Any]) -> None:
        said = event[1]
        batch = self._batches.get(said.get("batch")) if said.get("run") == self._run else None
        if batch is not None:
            self._work.hear(batch, said["place"], said["done"])


def _came(waiting: "asyncio.Future[bytes]") -> "bytes | BaseException":
    try:
        return waiting.result()
    except (Exception, asyncio.CancelledError) as error:
        return error


def _opened(came: "bytes | BaseException") -> Any:
    try:
        return pickle.loads(came) if isinstance(came, bytes) else came
    except Exception as error:  # what only the worker can import
        return error


def _lost(member: _Member) -> str:
    return f"its Dask worker {member} was lost, as by a crash or for lack of memory; the worker's log may tell more"
