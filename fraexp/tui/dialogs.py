"""Dialogs over a screen: a confirmation, and a line of text."""

from collections.abc import Callable, Iterable
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.suggester import SuggestFromList
from textual.widgets import Input, Static

from fraexp.data.terminal_text import printable
from fraexp.tui.page import shorten

BOX_CSS = """
    width: 72; max-width: 96%; height: auto; padding: 1 2; background: $surface; border: round $primary;
"""


class ConfirmDialog(ModalScreen[bool]):
    """A yes-or-no question; Enter answers no."""

    DEFAULT_CSS = "ConfirmDialog { align: center middle; } ConfirmDialog > Vertical {" + BOX_CSS + "}"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer(True)", "yes", id="confirm.yes"),
        Binding("n,escape,enter", "answer(False)", "no", id="confirm.no"),
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


class InputDialog(ModalScreen[str | None]):
    """A question whose answer is a line of text; None after Esc."""

    DEFAULT_CSS = (
        "InputDialog { align: center middle; } InputDialog > Vertical {"
        + BOX_CSS
        + "} InputDialog .wrong { color: $text-error; }"
    )
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "cancel", id="ask.leave")]

    def __init__(
        self,
        question: str,
        value: str = "",
        check: Callable[[str], str] = lambda _: "",
        offered: Iterable[str] = (),
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

    def action_leave(self) -> None:
        """Close without an answer."""
        self.dismiss(None)
