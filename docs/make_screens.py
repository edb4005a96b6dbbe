"""Draw screens of the terminal UI: that of the README, of docs/terminal-ui.md in three sizes, and of docs/measuring.md.

python docs/make_screens.py [FOLDER]   # writes into docs/figures by default
"""

import asyncio
import contextlib
import os
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

os.environ.pop("FRAEXP_TUI_THEME", None)

from fraexp.tui.app import FraexpApp
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.services.live_measurement import LiveMeasurement
from fraexp.workspace.workspace_service import WorkspaceService

FIGURES = Path(__file__).resolve().parent / "figures"
STUDIES = FIGURES.parents[1] / "studies"
SHOWN_POINTS = 9
"""Points that are measured when the screen of a measurement is drawn, of 12."""
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


async def draw_measurement(size: tuple[int, int]) -> str:
    """Return the screen of a measurement, of which most points are measured, as SVG."""
    app = FraexpApp(".")
    async with app.run_test(size=size) as pilot:

        async def press_when(holds: Callable[[], object], *keys: str) -> None:
            while not holds():
                await pilot.pause(0.02)
            await pilot.press(*keys)

        await press_when(lambda: app.screen.query("ListTable") and app.screen.item, "slash", *"simulated_axis", "enter")
        await press_when(lambda: app.screen.entry.name == "simulated_axis", "m")
        await press_when(lambda: getattr(app.screen, "measurement", None) and app.screen.measurement.plans, "f5")
        await press_when(lambda: isinstance(app.screen, ConfirmDialog), "y")
        await press_when(lambda: isinstance(app.measurement, LiveMeasurement) and app.measurement.done >= SHOWN_POINTS)
        await press_when(lambda: app.measurement.progress and app.measurement.progress.periods)
        await pilot.pause(0.5)
        drawn = FONT.sub("", app.export_screenshot(title="fraexp tui"))
        app.measurement.stop()
        await press_when(lambda: app.measurement.has_ended)
        return drawn


def main(folder: Path = FIGURES) -> None:
    """Run the studies, and draw."""
    with tempfile.TemporaryDirectory() as workspace, contextlib.chdir(workspace):
        Path("studies").mkdir()
        Path("studies/series.toml").write_text(SERIES, encoding="utf-8")
        example = STUDIES / "simulated_axis.toml"
        lossy = example.read_text("utf-8").replace('name = "simulated"', 'name = "simulated", speed = 2, loss = 0.01')
        Path("studies/simulated_axis.toml").write_text(lossy, encoding="utf-8")
        service = WorkspaceService.open(".")
        for study in ("quick", "series"):
            for _ in service.run([study], "serial"):
                pass
        for shot in SHOTS:
            (folder / shot.file).write_text(asyncio.run(draw(shot)), encoding="utf-8")
            print(folder / shot.file)
        file = folder / "terminal-measurement.svg"
        file.write_text(asyncio.run(draw_measurement((120, 36))), encoding="utf-8")
        print(file)


if __name__ == "__main__":
    main(*(Path(name).resolve() for name in sys.argv[1:]))
