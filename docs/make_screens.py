"""Draw screens of the terminal UI: that of the README, and those of docs/terminal-ui.md in three sizes.

python docs/make_screens.py [FOLDER]   # writes into docs/figures by default
"""

import asyncio
import contextlib
import os
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

os.environ["FRAEXP_TUI_SETTINGS"] = os.devnull

from fraexp.tui.app import FraexpApp
from fraexp.workspace.workspace_service import WorkspaceService

FIGURES = Path(__file__).resolve().parent / "figures"
FONT = re.compile(r"\s*@font-face \{.*?\}", re.DOTALL)
"""A font that the picture would fetch from the network; the viewer uses a local one."""
SERIES = """
title = "Machines of one series"
question = "How far do conventional and proposed responses spread?"
machine = "linear_motor_table"
excitation = { name = "stepped_sine", points = 30 }

[grid]
"excitation.amplitude" = [12, 75]
"estimator" = [{ name = "conventional" }, { name = "effective_input" }]

[monte_carlo]
count = 80
seed = 1
draw = [
    { paths = "friction.curve.coulomb_force", relative = 0.1 },
    { paths = "plant.frequencies.0", relative = 0.02 },
]
"""
"""A run of 320 sweeps."""


@dataclass(frozen=True)
class ScreenShot:
    """A screen, and the keys that lead to it."""

    file: str
    size: tuple[int, int]
    """Columns and rows."""
    keys: tuple[str, ...]


SHOTS = (
    ScreenShot("terminal.svg", (112, 36), ("w", "slash", *"run=1", "enter", "a", "c", "right", "right")),
    ScreenShot("terminal-80x24.svg", (80, 24), ("r", "enter")),
    ScreenShot("terminal-120x40.svg", (120, 40), ("r", "enter", "c")),
    ScreenShot("terminal-200x50.svg", (200, 50), ("w", "slash", *"run=2", "enter", "down", "down")),
)


async def draw(shot: ScreenShot) -> str:
    """Return a screen as SVG."""
    app = FraexpApp(".")
    async with app.run_test(size=shot.size) as pilot:
        while app.current_mode != "studies" or not app.screen.is_mounted:
            await pilot.pause(0.02)
        for key in shot.keys:
            await pilot.press(key)
            await app.workers.wait_for_complete()
            await pilot.pause(0.3)
        await pilot.pause(2.0)
        return FONT.sub("", app.export_screenshot(title="fraexp tui"))


def main(folder: Path = FIGURES) -> None:
    """Run the studies, and draw."""
    with tempfile.TemporaryDirectory() as workspace, contextlib.chdir(workspace):
        Path("studies").mkdir()
        Path("studies/series.toml").write_text(SERIES, encoding="utf-8")
        service = WorkspaceService.open(".")
        for study in ("quick", "series"):
            for _ in service.run([study], "serial"):
                pass
        for shot in SHOTS:
            (folder / shot.file).write_text(asyncio.run(draw(shot)), encoding="utf-8")
            print(folder / shot.file)


if __name__ == "__main__":
    main(*(Path(name).resolve() for name in sys.argv[1:]))
