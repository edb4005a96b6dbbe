"""The user's settings of the terminal UI: keys, theme and characters, in an optional TOML file."""

import os
from collections.abc import Mapping
from pathlib import Path

from platformdirs import user_config_path

from fraexp.components.parameters import Parameters, param
from fraexp.data import toml
from fraexp.errors import FraexpError
from fraexp.views.words import flatten

SETTINGS_VARIABLE = "FRAEXP_TUI_SETTINGS"
"""Environment variable with the path of another settings file."""


class Settings(Parameters):
    """The settings of the terminal UI."""

    theme: str = param("", "theme, as listed in the command palette; empty for the default", "")
    ascii: bool | None = param("", "draw with ASCII characters only; by default if the terminal needs it", None)
    phase: str = param("", "phase in Bode plots: unwrapped or wrapped", "unwrapped")
    keys: dict[str, str] = param("", "keys of a binding, by its name: keys.mark = 'space,m'", {})


def settings_file() -> Path:
    """Return the path of the settings file, which may not exist."""
    named = os.environ.get(SETTINGS_VARIABLE)
    return Path(named) if named else user_config_path("fraexp") / "tui.toml"


def read_settings(file: Path) -> Settings:
    """Read settings; FraexpError names a fault."""
    try:
        data: Mapping[str, object] = toml.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        keys = data.get("keys")
        if isinstance(keys, Mapping):  # without quotes, table.mark = "m" is a nested table
            data = {**data, "keys": flatten(keys)}
        if not isinstance(data.get("ascii", False), bool):
            raise FraexpError(f"settings.ascii is {data['ascii']!r}; expected true or false")
        settings = Settings.parse(data, "settings")
    except (OSError, ValueError) as error:  # invalid TOML or encoding
        raise FraexpError(f"{file}: cannot be read as TOML: {error}") from None
    except FraexpError as error:
        raise FraexpError(f"{file}: {error}") from None
    if settings.phase not in ("unwrapped", "wrapped"):
        raise FraexpError(f"{file}: phase is '{settings.phase}'; expected unwrapped or wrapped")
    return settings


def is_ascii_terminal(environment: Mapping[str, str]) -> bool:
    """Return whether the environment declares an ASCII terminal; Unicode is assumed by default."""
    said = next((environment[name] for name in ("LC_ALL", "LC_CTYPE", "LANG") if environment.get(name)), "UTF-8")
    encoding = said.upper().replace("-", "")
    return "UTF8" not in encoding or environment.get("TERM") in ("dumb", "linux", "vt100", "vt220")
