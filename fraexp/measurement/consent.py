"""Consent: what a study runs or moves over a network is asked once per user, and remembered by its content."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_config_path

from fraexp.components.kinds import MachineDriver
from fraexp.data.identity import digest_of
from fraexp.errors import ConsentError

CONSENTS_VARIABLE = "FRAEXP_CONSENTS"
"""Environment variable with the path of another file of consents."""


@dataclass(frozen=True)
class Consent:
    """What a machine does beyond fraexp, which its user has to allow."""

    action: str
    """All of it, in words."""

    @property
    def key(self) -> str:
        """What it is remembered by."""
        return digest_of(self.action).hex()

    @property
    def is_given(self) -> bool:
        """Whether this user has allowed exactly this before."""
        try:
            lines = _consents_file().read_text(encoding="utf-8").splitlines()
            return any(json.loads(line).get("key") == self.key for line in lines)
        except (OSError, ValueError, AttributeError):  # a file that cannot be read allows nothing
            return False

    def remember(self) -> None:
        """Allow it from now on; ConsentError if that cannot be stored."""
        file = _consents_file()
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps({"key": self.key, "allowed": self.action}) + "\n")
        except OSError as error:
            raise ConsentError(f"{file}: the consent cannot be stored ({error.strerror or error})") from None


def missing_consent(machine: MachineDriver, folder: Path) -> Consent | None:
    """Return what the user has to allow before a machine is connected; None if there is nothing, or it is allowed."""
    action = machine.consent(folder)
    consent = Consent(action) if action else None
    return None if consent is None or consent.is_given else consent


def require_consent(machine: MachineDriver, folder: Path) -> None:
    """Raise ConsentError if the user has not allowed what a machine does."""
    if consent := missing_consent(machine, folder):
        raise ConsentError(
            f"the study would {consent.action}; allow it by an answer on a terminal, by --trust-program, or in Python "
            "by is_trusted=True"
        )


def _consents_file() -> Path:
    named = os.environ.get(CONSENTS_VARIABLE)
    return Path(named) if named else user_config_path("fraexp") / "consents"
