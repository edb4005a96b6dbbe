"""The input of a sweep filter, which completes field names and some values."""

from collections.abc import Iterable, Mapping
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.suggester import Suggester
from textual.widgets import Input

from fraexp.data.results import Outcome
from fraexp.store.queries.filters import OPERATORS
from fraexp.store.queries.known_names import METRIC_PREFIX

FILTER_EXAMPLE = "estimator=effective_input excitation.amplitude>=12 state:unusable tag:baseline"
FIELD_VALUES = {
    "state": ("computed", "failed", "pending", "reused", "unusable"),
    "outcome": tuple(outcome.name.lower() for outcome in Outcome),
}


class FieldSuggester(Suggester):
    """Completes the last term of a filter."""

    def __init__(self) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self.names: Iterable[str] = ()
        self.values: Mapping[str, Iterable[str]] = FIELD_VALUES

    def know(self, names: Iterable[str], tags: Iterable[str]) -> None:
        """Set the known fields and tags; the headings of fields, their last parts, complete as well."""
        known = tuple(names)
        headings = (name.rpartition(".")[2] for name in known if not name.startswith(METRIC_PREFIX))
        self.names = tuple(dict.fromkeys([*known, *headings]))
        self.values = {**FIELD_VALUES, "tag": tuple(tags)}

    async def get_suggestion(self, value: str) -> str | None:
        """Return the filter with its last term completed; None without a match."""
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
    """The input; Tab or → accepts the completion, Enter and ↓ move to the table."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "take", "complete", tooltip="accept the completion"),
    ]

    def __init__(self) -> None:
        self.fields = FieldSuggester()
        super().__init__(
            placeholder=f"/ filter: {FILTER_EXAMPLE}", suggester=self.fields, compact=True, select_on_focus=False
        )

    async def action_take(self) -> None:
        """Accept the completion, or move to the table."""
        offered = await self.fields.get_suggestion(self.value)
        if offered is None:
            self.screen.focus_next()
        else:
            self.value = offered
            self.cursor_position = len(offered)
