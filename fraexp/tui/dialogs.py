"""Dialogs over a screen: a confirmation, and a line of text."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import ClassVar, TypeVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.suggester import SuggestFromList
from textual.widgets import Input, SelectionList, Static
from textual.widgets.selection_list import Selection

from fraexp.data.texts import printable
from fraexp.tui.page import shorten

Answered = TypeVar("Answered")


class Dialog(ModalScreen[Answered]):
    """A box over a screen."""

    def action_leave(self) -> None:
        """Close without an answer."""
        self.dismiss(None)


class ConfirmDialog(Dialog[bool]):
    """A yes-or-no question; Enter answers no."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer(True)", "yes"),
        Binding("n,escape,enter", "answer(False)", "no"),
    ]

    def __init__(self, question: str) -> None:
        super().__init__()
        self._question = question

    def compose(self) -> ComposeResult:
        """Show the question."""
        with Vertical():
            yield Static(Text(printable(self._question)))
            yield Static(Text("\ny yes    n no", style="bold"))

    def action_answer(self, answer: bool) -> None:
        """Return the answer."""
        self.dismiss(answer)


class InputDialog(Dialog[str | None]):
    """A question whose answer is a line of text; None after Esc."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "leave", "cancel"),
        Binding("tab", "take", "complete", priority=True, tooltip="accept the completion"),
    ]

    def __init__(
        self, question: str, value: str = "", check: Callable[[str], str] = lambda _: "", offered: Iterable[str] = ()
    ) -> None:
        """Ask; `check` returns the fault of an answer, or an empty text; `offered` answers complete the typed text."""
        super().__init__()
        self._question, self._value, self._check = question, value, check
        self._suggester = SuggestFromList(offered)

    def compose(self) -> ComposeResult:
        """Show the question, an input, and the fault of its text."""
        with Vertical():
            yield Static(Text(printable(self._question)))
            yield Input(self._value, suggester=self._suggester)
            yield Static("", classes="wrong")

    @on(Input.Changed)
    def _show_fault(self, event: Input.Changed) -> None:
        self.query_one(".wrong", Static).update(Text(printable(shorten(self._check(event.value)))))

    @on(Input.Submitted)
    def _submit(self, event: Input.Submitted) -> None:
        if not self._check(event.value):
            self.dismiss(event.value)

    async def action_take(self) -> None:
        """Accept the completion."""
        line = self.query_one(Input)
        offered = await self._suggester.get_suggestion(line.value) if line.value else None
        if offered:
            line.value, line.cursor_position = offered, len(offered)


class GroupingDialog(Dialog[list[str] | None]):
    """The labels that make groups: without one of them, its values share a colour; None after Esc."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "leave", "cancel"),
        Binding("enter", "answer", "show", priority=True),
    ]

    def __init__(self, labels: Mapping[str, str], chosen: Sequence[str] | None) -> None:
        """Offer labels by path, with the texts to show; `chosen` are those at first, by default all."""
        super().__init__()
        self._labels, self._chosen = labels, chosen

    def compose(self) -> ComposeResult:
        """Show the labels with their checkmarks."""
        with Vertical():
            yield Static(Text("One group for each value of:", style="bold"))
            yield SelectionList[str](
                *(
                    Selection(Text(printable(text)), path, self._chosen is None or path in self._chosen)
                    for path, text in self._labels.items()
                )
            )
            yield Static(Text("\nSpace split or merge    Enter show    Esc cancel"))

    def action_answer(self) -> None:
        """Return the chosen labels."""
        self.dismiss(list(self.query_one(SelectionList).selected))
