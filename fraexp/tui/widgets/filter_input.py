"""The line in which a filter is written: it completes the names of fields, and some values."""

from collections.abc import Iterable, Mapping
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.suggester import Suggester
from textual.widgets import Input

from fraexp.data.results import Outcome
from fraexp.store.queries.filters import OPERATORS

EXAMPLE = "estimator=proposed excitation.amplitude>=12 state:failed tag:baseline"
VALUES = {
    "state": ("computed", "failed", "pending", "reused"),
    "outcome": tuple(outcome.name.lower() for outcome in Outcome),
}


class Fields(Suggester):
    """Completes the last term of a filter."""

    def __init__(self) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self.names: Iterable[str] = ()
        self.values: Mapping[str, Iterable[str]] = VALUES

    def know(self, names: Iterable[str], tags: Iterable[str]) -> None:
        """Take note of the fields and tags that there are."""
        self.names, self.values = tuple(names), {**VALUES, "tag": tuple(tags)}

    async def get_suggestion(self, value: str) -> str | None:
        """Return the filter with its last term completed; None if nothing fits."""
        term = value.rpartition(" ")[2]
        sign = next((sign for sign in OPERATORS if sign in term), "")
        if sign:
            field, _, begun = term.removeprefix("-").partition(sign)
            options = self.values.get(field, ())
        else:
            begun, options = term.removeprefix("-"), self.names
        found = next((option for option in options if begun and option.startswith(begun) and option != begun), None)
        return value + found[len(begun) :] if found else None


class SweepFilter(Input):
    """One line; Tab or → takes what is offered, Enter and ↓ go to the table."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "take", "complete", id="filter.take", tooltip="take the name that is offered"),
    ]

    def __init__(self) -> None:
        self.fields = Fields()
        super().__init__(placeholder=f"/ filter: {EXAMPLE}", suggester=self.fields, compact=True, select_on_focus=False)

    def action_take(self) -> None:
        """Take what is offered, or go on to the table."""
        if self._suggestion and self._suggestion != self.value:
            self.action_cursor_right()
        else:
            self.screen.focus_next()
