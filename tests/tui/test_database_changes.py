"""Screens that follow the database at their own pace, not at each change of it."""

import pytest

from fraexp.tui.page import DatabaseChanged
from fraexp.tui.screens.run_page import show_run
from tests.tui.pilots import pilot_of, settle

CHANGES = 5


@pytest.mark.parametrize("place", ["run", "plugins", "runs"])
def test_a_screen_sets_the_pace_at_which_it_reads(workspace, monkeypatch, place):
    async def steps(app, pilot):
        if place == "run":
            await show_run(app, 1).wait()
        else:
            app.action_place(place)
        await settle(pilot)
        page, reads = app.screen, []
        monkeypatch.setattr(page, "reload", lambda: reads.append(1))
        page.live = place == "run"
        for _ in range(CHANGES):
            page.post_message(DatabaseChanged(True))
        await pilot.pause()
        if place == "runs":
            assert len(reads) >= CHANGES
        else:
            assert len(reads) <= 1  # a timer of the screen may have gone off meanwhile

    pilot_of(workspace, steps)
