"""A user's settings: what they change, and what is said of wrong ones before anything is shown."""

import re
from pathlib import Path

import pytest

from fraexp.errors import FraexpError
from fraexp.tui.app import FraexpApp
from fraexp.tui.services.user_settings import read_settings, settings_file
from tests.refusals import refused
from tests.tui.pilots import pilot_of

GUIDE = Path(__file__).parents[2] / "docs/terminal-ui.md"


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write settings, and let them be read."""

    def written(text: str) -> Path:
        file = tmp_path / "tui.toml"
        file.write_text(text, encoding="utf-8")
        monkeypatch.setenv("FRAEXP_TUI_SETTINGS", str(file))
        return file

    return written


def example() -> str:
    (text,) = re.findall(r"```toml\n(.*?)```", GUIDE.read_text("utf-8"), re.DOTALL)
    return text


def test_the_example_of_the_guide_is_taken(workspace, write):
    settings = read_settings(write(example()))
    assert settings.theme
    assert settings.phase == "wrapped"

    async def steps(app, pilot):
        assert app.theme == settings.theme

    pilot_of(FraexpApp(workspace), steps)


WRONG = [
    ("theme = 'nordic'", ["'nordic'", "'nord'"]),
    ("them = 'nord'", ["'them'", "'theme'"]),
    ("phase = 'up'", ["phase", "'up'", "unwrapped", "wrapped"]),
    ("theme = ", ["TOML"]),
]


@pytest.mark.parametrize(("text", "names"), WRONG)
def test_wrong_settings_are_told_in_one_line(workspace, write, text, names):
    with refused(FraexpError, write(text), *names):
        FraexpApp(workspace)


@pytest.mark.parametrize("content", [b"\xff\xfe", b"theme = 'nord'\x00"])
def test_a_file_that_is_no_text_is_told(workspace, write, content):
    file = write("")
    file.write_bytes(content)
    with refused(FraexpError, file, "TOML"):
        FraexpApp(workspace)


def test_no_file_is_as_good_as_an_empty_one(tmp_path):
    assert read_settings(tmp_path / "none.toml") == read_settings(tmp_path / "neither.toml")


def test_the_place_is_the_users_unless_told(monkeypatch, tmp_path):
    monkeypatch.delenv("FRAEXP_TUI_SETTINGS")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert settings_file().name == "tui.toml"
