"""Changes of a study, written as values by path, as the texts that the command line takes."""

import json
from collections.abc import Mapping

from fraexp.interface.study_source import plain_value


def override_texts(changes: Mapping[str, object]) -> list[str]:
    """Return each change as ``path=value`` with the value as TOML has it."""
    return [f"{path}={toml_text(plain_value(value))}" for path, value in changes.items()]


def toml_text(value: object) -> str:
    """Return plain data as the right side of a TOML line."""
    match value:
        case str():
            return json.dumps(value, ensure_ascii=False)  # a TOML text in double quotes has JSON's escapes
        case bool():
            return str(value).lower()
        case Mapping():
            return f"{{{', '.join(f'{toml_text(key)} = {toml_text(item)}' for key, item in value.items())}}}"
        case list():
            return f"[{', '.join(map(toml_text, value))}]"
    return repr(value)
