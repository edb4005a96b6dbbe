"""The user's settings of the terminal UI: theme and phase, in an optional TOML file."""

import os
from pathlib import Path

from platformdirs import user_config_path

from fraexp.components.parameters import Parameters, param
from fraexp.data import toml
from fraexp.errors import FraexpError

SETTINGS_VARIABLE = "FRAEXP_TUI_SETTINGS"
"""Environment variable with the path of another settings file."""


class Settings(Parameters):
    """The settings of the terminal UI."""

    theme: str = param("", "theme, as listed in the command palette; empty for the default", "")
    phase: str = param("", "phase in Bode plots: unwrapped or wrapped", "unwrapped")


def settings_file() -> Path:
    """Return the path of the settings file, which may not exist."""
    named = os.environ.get(SETTINGS_VARIABLE)
    return Path(named) if named else user_config_path("fraexp") / "tui.toml"


def read_settings(file: Path) -> Settings:
    """Read settings; FraexpError names a fault."""
    try:
        settings = Settings.parse(toml.loads(file.read_text("utf-8")) if file.is_file() else {}, "settings")
    except (OSError, ValueError) as error:  # invalid TOML or encoding
        raise FraexpError(f"{file}: cannot be read as TOML: {error}") from None
    except FraexpError as error:
        raise FraexpError(f"{file}: {error}") from None
    if settings.phase not in ("unwrapped", "wrapped"):
        raise FraexpError(f"{file}: phase is '{settings.phase}'; expected unwrapped or wrapped")
    return settings
