"""Each screen in both themes: its characters and colours are those of the snapshots in tests/tui/snapshots.

FRAEXP_UPDATE_SNAPSHOTS=1 writes the snapshots anew; look at the difference before it is committed.
"""

import os
import re
from collections.abc import AsyncIterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

from fraexp.tui.app import FraexpApp
from fraexp.tui.screens.measurement_page import MeasuredBode, MeasurementPage
from fraexp.tui.services.live_measurement import LimitedMotion, PlanSummary, PlayedPoint, TrackedMeasurement
from fraexp.tui.services.measurement_worker import join_responses
from fraexp.tui.services.themes import DARK, LIGHT
from tests.tui.pilots import pilot_of, settle, shows, until
from tests.tui.responses import found, loop, resonant, store_results

FOLDER = Path(__file__).with_name("snapshots")
UPDATES = os.environ.get("FRAEXP_UPDATE_SNAPSHOTS") == "1"
GRID = np.geomspace(1.0, 200.0, 60)
DURATION = r"\d+(\.\d+)? (s|ms|min)\b"
CHANGING = re.compile(rf" *(\d\d:\d\d(:\d\d)?|\d{{4}}-\d\d-\d\d|{DURATION}|--workspace \S+|/\S*/\S*) *")
"""What differs from run to run, with the blanks around it: times, durations and paths."""
Screens = dict[str, tuple[tuple[str, ...], tuple[str, ...]]]
SCREENS: Screens = {
    "studies": (("s", "slash", *"quick", "enter"), ("Quick look",)),
    "launch": (("s", "enter"), ("excitation.amplitude",)),
    "runs": (("r",), ("case",)),
    "run": (("r", "enter"), ("rows 1-3 of 3", "no log")),
    "sweeps": (("w",), ("rows 1-3 of 3",)),
    "sweep": (("w", "end", "enter"), ("To fit a plant model",)),
    "bode": (("w", "a", "c"), ("Magnitude", "case 1")),
    "difference": (("w", "a", "c", "d"), ("against case 0",)),
    "nyquist": (("w", "a", "c", "n"), ("Imaginary over real part",)),
    "coherence": (("w", "a", "c", "t"), ("distortion",)),
    "curves": (("w", "a", "c", "v"), ("Friction force",)),
    "table": (("w", "a", "c", "b", "i"), ("difference",)),
    "help": (("w", "question_mark"), ("previous row",)),
    "question": (("w", "D"), ("y yes",)),
    "empty": (("w", "A", "c"), ("No sweeps are marked",)),
    "measurement-plan": (("s", "slash", *"simulated_axis", "enter", "m"), ("Measure", "rows 1-12 of 12")),
}
"""Keys that lead to each screen, and the texts that are there when it has come."""


def screen_lines(app: FraexpApp) -> str:
    """Return the characters of the screen, and the colours and weights of each line in short."""
    lines, looks = [], []
    for strip in app.screen._compositor.render_strips():
        lines.append(CHANGING.sub(" x ", strip.text).rstrip())
        looks.append(" ".join(_look(segment) for segment in strip if segment.text.strip()))
    return "\n".join([*lines, "", *looks, ""])


def example_measurement() -> TrackedMeasurement:
    """Return a measurement in which 20 of 60 points were measured, and the next one is being recorded."""
    motions = (LimitedMotion("stroke", "m", 0.02, 0.0078, 0), LimitedMotion("force", "N", 150.0, 53.8, 3))
    plan = PlanSummary("", "simulated", motions, 0.1, (), (), 100.0, "60 points", (1.0, 200.0), 0.1, 0, False)
    live = TrackedMeasurement("axis", state="measuring", plans=(plan,), plan=plan, done=20, total=60, seconds_left=60.0)
    single = [GRID[place : place + 1] for place in range(59, 39, -1)]
    live.responses = (
        ("conventional", join_responses([resonant(at, at=60.0) for at in single])),
        ("effective_input", join_responses([resonant(at) for at in single])),
    )
    live.last_point = f"20/60  {GRID[40]:.4g} Hz: settled"
    live.notices = ("62.2 Hz: samples 177 to 265 were lost, and sent again",)
    demand, predicted = (0.0012, 0.0, 0.0, 141.0, 0.0), (0.0031, 0.0, 0.0, 52.0, 0.0)
    live.played = PlayedPoint("33 Hz", 33.0, "40 N", 1.2, True, 6, 0.21, demand, predicted)
    return live


def _look(segment) -> str:
    style = segment.style
    colours = [of.name.removeprefix("#") if of else "-" for of in (style.color, style.bgcolor)] if style else ["-", "-"]
    return "/".join(colours) + ("b" if style and style.bold else "")


def store_examples(folder: Path) -> None:
    """Store three sweeps: two with a response, one with a loop."""
    results = [found(resonant(GRID)), found(resonant(GRID, at=60.0))]
    store_results(folder, [*results, type(results[0])(results[0].outcome, curves=(loop(1e-5),))])


async def walk(app: FraexpApp, pilot: Pilot[None], screens: Screens) -> AsyncIterator[str]:
    """Show each of the screens, and that of a measurement, and yield its name."""
    for name, (keys, texts) in screens.items():
        while len(app.screen_stack) > 1:
            await pilot.press("escape")
        await pilot.press(*keys)
        await shows(pilot, *texts)
        await settle(pilot)
        yield name
    measured = MeasurementPage(example_measurement())  # type: ignore[arg-type]
    await app.push_screen(measured)
    await until(pilot, lambda: measured.query_one(MeasuredBode).has_class("-drawn"))
    await settle(pilot)
    yield "measurement"


@pytest.mark.thorough
@pytest.mark.parametrize("theme", [DARK.name, LIGHT.name])
def test_each_screen_looks_as_it_was_approved(tmp_path: Path, theme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # The run takes 100 s, whatever the machine: a duration decides how wide its column is.
    monkeypatch.setattr("fraexp.store.store.steady_time", count(0.0, 100.0).__next__)
    store_examples(tmp_path)
    drawn: dict[str, str] = {}

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        app.theme = theme
        async for name in walk(app, pilot, SCREENS):
            drawn[name] = screen_lines(app)

    pilot_of(tmp_path, steps, size=(100, 30))
    FOLDER.mkdir(exist_ok=True)
    for name, text in drawn.items():
        file = FOLDER / f"{name}-{theme}.txt"
        if UPDATES:
            file.write_text(text, encoding="utf-8")
        assert text == file.read_text(encoding="utf-8"), file.name
