"""A user's settings of the terminal UI: keys, theme, characters; a TOML file that need not be there."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from platformdirs import user_config_path

from fraexp.components.parameters import Parameters, param
from fraexp.data import toml
from fraexp.errors import FraexpError
from fraexp.views.words import flat

PLACE = "FRAEXP_TUI_SETTINGS"
"""Environment variable that names another file."""


class Settings(Parameters):
    """What a user may choose."""

    theme: str = param("", "theme, as the command palette lists them; empty for the terminal's kind", "")
    ascii: bool | None = param("", "draw with ASCII characters alone; without it, where the terminal needs it", None)
    phase: str = param("", "phase in Bode plots: unwrapped or wrapped", "unwrapped")
    keys: dict[str, str] = param("", "other keys for a binding, by its name: keys.mark = 'space,m'", {})


def place() -> Path:
    """Return the file with the settings, whether it is there or not."""
    named = os.environ.get(PLACE)
    return Path(named) if named else user_config_path("fraexp") / "tui.toml"


def read(file: Path) -> Settings:
    """Read settings; FraexpError says what is wrong with them."""
    try:
        data: Mapping[str, Any] = toml.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        keys = data.get("keys")
        if isinstance(keys, Mapping):  # table.mark = "m" is a table in a table, where it is not in quotes
            data = {**data, "keys": flat(keys)}
        if not isinstance(data.get("ascii", False), bool):
            raise FraexpError(f"settings.ascii is {data['ascii']!r}; expected true or false")
        settings = Settings.parse(data, "settings")
    except (OSError, ValueError) as error:  # no TOML, or no text
        raise FraexpError(f"{file}: cannot be read as TOML: {error}") from None
    except FraexpError as error:
        raise FraexpError(f"{file}: {error}") from None
    if settings.phase not in ("unwrapped", "wrapped"):
        raise FraexpError(f"{file}: phase is '{settings.phase}'; expected unwrapped or wrapped")
    return settings


def plain_terminal(environment: Mapping[str, str]) -> bool:
    """Return whether the terminal is said to know ASCII alone; where nothing is said it is taken to know Unicode."""
    said = next((environment[name] for name in ("LC_ALL", "LC_CTYPE", "LANG") if environment.get(name)), "UTF-8")
    encoding = said.upper().replace("-", "")
    return "UTF8" not in encoding or environment.get("TERM") in ("dumb", "linux", "vt100", "vt220")
