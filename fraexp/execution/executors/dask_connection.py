"""The connection to a Dask scheduler: made within a time, asked with a deadline, and closed without waiting."""

import asyncio
from collections.abc import Callable
from contextlib import suppress

from fraexp.data.sweep import Plain
from fraexp.errors import StudyError
from fraexp.execution.executors.dask_address import cause_text, first_line, scheduler_address
from fraexp.execution.executors.dask_check import DaskClient

CONNECT_TIMEOUT_S = 10.0
"""Time to wait for the scheduler at the start, and in one attempt later on."""
CLOSE_TIMEOUT_S = 0.4
"""Timeout for closing a connection: a scheduler that is silent would keep the user waiting."""
POLL_INTERVAL_S = 0.5
"""Interval at which the list of workers is read."""


class DisconnectedError(Exception):
    """The scheduler cannot be reached any more."""


class ConnectError(Exception):
    """The scheduler cannot be reached within the time, or never; the text is the reason as the user reads it."""


async def connect(address: str, timeout: float, finding: str, remedy: str) -> DaskClient:
    """Return a connection to the scheduler; ConnectError with `finding` and `remedy` after `timeout` [s]."""
    loop = asyncio.get_running_loop()
    deadline = loop.time() + timeout
    while True:
        try:
            return await _attempt(scheduler_address(address), deadline - loop.time())  # the file may have changed
        except OSError as error:
            failure = f"{finding}{cause_text(error)}; {remedy}"
        except StudyError as error:
            failure = str(error)
        except Exception as error:  # such as an unknown protocol, or a certificate that does not fit
            raise ConnectError(f"Dask at {address}: {type(error).__name__}: {first_line(error)}") from error
        if loop.time() + 1.0 > deadline:
            raise ConnectError(failure)
        await asyncio.sleep(1.0)


async def _attempt(address: str, left: float) -> DaskClient:
    """Return a connection, for which one attempt is made."""
    from distributed import Client

    client = Client(  # type: ignore[no-untyped-call]
        address, asynchronous=True, set_as_default=False, timeout=min(max(left, 1.0), CONNECT_TIMEOUT_S), name="fraexp"
    )
    try:
        return await client
    finally:
        if client.status != "running":
            await close(client)


async def close(client: DaskClient) -> None:
    """Close a connection."""
    with suppress(Exception):
        await client.close(timeout=CLOSE_TIMEOUT_S)


async def ask_identity(client: DaskClient, may_wait: Callable[[], bool]) -> Plain:
    """Return the scheduler's identity with its workers; wait while `may_wait`, which is called at short intervals."""
    asked = asyncio.ensure_future(client.scheduler.identity(n_workers=-1))
    try:
        while client.status == "running" and may_wait():
            done, _ = await asyncio.wait({asked}, timeout=POLL_INTERVAL_S)
            if done:
                return asked.result()
    except OSError:
        pass
    finally:
        asked.cancel()
    raise DisconnectedError
