"""Draw the terminal UI for the README: the four sweeps of the quick study compared."""

import asyncio
import contextlib
import os
import re
import tempfile
from pathlib import Path

os.environ["FRAEXP_TUI_SETTINGS"] = os.devnull

from fraexp.store import Store
from fraexp.tui.app import FraexpApp
from fraexp.workspace.workspace_service import WorkspaceService

TARGET = Path(__file__).resolve().parent / "figures" / "terminal.svg"
SIZE = (112, 36)


FONT = re.compile(r"\s*@font-face \{.*?\}", re.DOTALL)
"""A font that the picture would fetch from the network; the viewer uses a local one."""


async def draw() -> str:
    """Return the screen as SVG."""
    app = FraexpApp(".")
    async with app.run_test(size=SIZE) as pilot:
        while app.current_mode != "studies" or not app.screen.is_mounted:
            await pilot.pause(0.02)
        with Store.open("results.db", read_only=True) as store:
            app.marks.add(sweep.key for sweep in store.sweeps(1))
        await pilot.press("c")
        await app.workers.wait_for_complete()
        await pilot.press("right", "right")
        await pilot.pause(1.0)
        return FONT.sub("", app.export_screenshot(title="fraexp tui"))


def main() -> None:
    """Run the study, and draw."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for _ in WorkspaceService.open(".").run(["quick"], "serial"):
            pass
        TARGET.write_text(asyncio.run(draw()), encoding="utf-8")
    print(TARGET)


if __name__ == "__main__":
    main()
