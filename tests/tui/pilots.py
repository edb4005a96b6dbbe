"""Driving the terminal UI without a terminal."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from textual.pilot import Pilot

from fraexp.tui.app import FraexpApp

Steps = Callable[[FraexpApp, Pilot[None]], Awaitable[None]]
PATIENCE = 60.0
"""Seconds to wait for what must come."""


def pilot_of(app: FraexpApp | Path, steps: Steps, size: tuple[int, int] = (80, 24), notices: bool = False) -> None:
    """Run an application, or one on a workspace folder, in a terminal of a size, and take steps in it.

    `notices`: messages are drawn, too.
    """

    async def drive() -> None:
        shown = FraexpApp(app) if isinstance(app, Path) else app
        async with shown.run_test(size=size, notifications=notices) as pilot:
            await until(pilot, lambda: shown.current_mode == "studies" and shown.screen.is_mounted)
            await steps(shown, pilot)

    asyncio.run(drive())


async def until(pilot: Pilot[None], holds: Callable[[], object]) -> None:
    """Wait until something holds."""
    loop = asyncio.get_running_loop()
    deadline = loop.time() + PATIENCE
    while not holds():
        assert loop.time() < deadline, screen_text(pilot.app)
        await pilot.pause(0.02)


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
