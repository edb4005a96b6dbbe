"""What fraexp raises: one sentence naming place, finding, expectation and the nearest name or remedy."""

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Self

MIN_SIMILARITY = 0.6
"""Share of equal letters from which a name is taken for another one's misspelling."""
BEGINNING = 3
"""Letters from which the beginning of a name stands for it."""


class FraexpError(Exception):
    """Base of all errors that a user can mend; its text is one line.

    Parts of it may be quantities, whose units are others for a rotary axis.
    """

    path = ""
    """Path of the parameter that does not fit, such as ``excitation.points``, or its section; empty for none."""

    def at(self, place: str, path: str = "") -> Self:
        """Return the error with its place before the text, and a path in which its own one lies."""
        self.args = (place, *self.args)
        self.path = ".".join(filter(None, (path, self.path)))
        return self

    def __str__(self) -> str:
        """Return the text in one line, whatever a plugin's own error that it quotes looks like."""
        return " ".join("".join(map(str, self.args)).split("\n"))


@contextmanager
def errors_within(path: str) -> Iterator[None]:
    """Put a section before the path of an error that is raised inside."""
    try:
        yield
    except FraexpError as error:
        raise error.at("", path) from None


class StudyError(FraexpError):
    """A study file asks for something that does not exist or does not fit."""


class ParameterError(FraexpError):
    """A parameter has a wrong name, type, unit or range."""


class PluginError(FraexpError):
    """A plugin cannot be loaded, or two plugins provide the same name."""


class RecordError(FraexpError):
    """A measured record cannot be read or is not what the study says."""


class MachineError(FraexpError):
    """A machine cannot be reached, has stopped, or may not play what it was asked to."""


class ConnectionLostError(MachineError):
    """The connection to a machine broke while it played: the same play may succeed later."""


class LimitError(MachineError):
    """A machine was stopped, because it moved beyond a limit."""


class BusyError(MachineError):
    """Another process uses the machine, or measures into the same files."""


class PlanError(MachineError):
    """A study asks for what its machine or the limits do not allow: nothing has moved."""


class ConsentError(PlanError):
    """A study would run a program, or move a machine over a network, that its user has not allowed."""


class UnreachedError(FraexpError):
    """Those who compute are gone for good, in mid-run: sweeps are left that were not reached."""


class StoreError(FraexpError):
    """A database is locked, foreign, newer, or lacks what was asked for."""


class BeginError(FraexpError):
    """A background process has ended before its run began."""

    def __init__(self, text: str, code: int) -> None:
        super().__init__(text)
        self.code = code
        """Exit code of the process."""


class FilterError(StoreError):
    """A filter of sweeps is invalid: the database is sound, and the user's text is not."""


class UnavailableError(StoreError):
    """A database cannot be reached for now, or is locked: the same call may succeed later."""


def did_you_mean(name: str, options: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest option, else the list of what exists."""
    known = sorted(options)
    near = difflib.get_close_matches(name, known, n=1, cutoff=MIN_SIMILARITY)
    near = near or [option for option in known if len(name) >= BEGINNING and option.startswith(name)]
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; known: {', '.join(known)}" if known else ""
