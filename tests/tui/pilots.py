"""Driving the terminal UI without a terminal."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from textual.app import App
from textual.pilot import Pilot
from textual.timer import Timer
from textual.widgets._toast import Toast

from fraexp.tui.app import FraexpApp
from fraexp.tui.page import ACTION_GROUP
from tests.waiting import HANG_TIMEOUT_S

Steps = Callable[[FraexpApp, Pilot[None]], Awaitable[None]]


def pilot_of(app: FraexpApp | Path, steps: Steps, size: tuple[int, int] = (80, 24), notices: bool = False) -> None:
    """Run an application, or one on a workspace folder, in a terminal of a size, and take steps in it.

    `notices`: messages are drawn, too.
    """

    async def drive() -> None:
        shown = FraexpApp(app) if isinstance(app, Path) else app
        async with shown.run_test(size=size, notifications=notices) as pilot:
            await until(pilot, lambda: shown.current_mode == "studies" and shown.screen.is_mounted)
            await steps(shown, pilot)
            if not shown._exit:  # keys that are still on their way would find no screen as all ends
                await until(pilot, lambda: not shown._key_queue._held)
                await pilot.pause()

    asyncio.run(drive())


async def until(pilot: Pilot[None], holds: Callable[[], object]) -> None:
    """Wait until something holds."""
    loop = asyncio.get_running_loop()
    deadline = loop.time() + HANG_TIMEOUT_S
    while not holds():
        assert loop.time() < deadline, screen_text(pilot.app)
        await pilot.pause(0.02)


async def settle(pilot: Pilot[None]) -> None:
    """Wait until all that has been asked for is done: no key, message, worker or timer is left that would change it."""
    await pilot.pause()
    await until(pilot, lambda: not is_busy(pilot.app))
    await pilot.pause()


def is_busy(app: App[None]) -> bool:
    """Say whether something is still to come: what repeats itself and what takes messages away do not count."""
    nodes = [app, *app.screen.walk_children(with_self=True)]
    return (
        bool(getattr(app, "_key_queue", None) and app._key_queue._held)
        or any(node.message_queue_size for node in nodes)
        or any(not worker.is_finished for worker in app.workers if worker.group not in ("survey", ACTION_GROUP))
        or any(is_pending(timer) for node in nodes if not isinstance(node, Toast) for timer in node._timers)
    )


def is_pending(timer: Timer) -> bool:
    """Say whether a timer will go off, once."""
    task = timer._task
    return timer._repeat == 0 and task is not None and not task.done()


async def shows(pilot: Pilot[None], *texts: str) -> None:
    """Wait until all texts are on the screen, wherever their lines are broken."""

    def shown() -> bool:
        lines = screen_text(pilot.app)
        joined = " ".join(lines.split())
        return all(text in lines or text in joined for text in texts)

    await until(pilot, shown)


def screen_text(app) -> str:
    """Return what is on the screen, a line each."""
    return "\n".join(strip.text for strip in app.screen._compositor.render_strips())
