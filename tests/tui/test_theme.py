"""The theme that a user names in the environment."""

import pytest

from fraexp.errors import FraexpError
from fraexp.tui.app import FraexpApp
from tests.refusals import refused
from tests.tui.pilots import pilot_of


def test_the_theme_of_the_environment_is_taken_if_it_exists(workspace, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("FRAEXP_TUI_THEME", "nord")

    async def steps(app, pilot):
        assert app.theme == "nord"

    pilot_of(FraexpApp(workspace), steps)
    monkeypatch.setenv("FRAEXP_TUI_THEME", "nordic")
    with refused(FraexpError, "FRAEXP_TUI_THEME", "'nordic'", "'nord'"):
        FraexpApp(workspace)
