"""Small questions over a screen: yes or no, and a line of text."""

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

from fraexp.figures.elements.labels import printable
from fraexp.tui.page import shortened

BOX = """
    width: 72; max-width: 96%; height: auto; padding: 1 2; background: $surface; border: round $primary;
"""


class Confirm(ModalScreen[bool]):
    """A question whose answer is yes only if that is said: Enter alone says no."""

    DEFAULT_CSS = "Confirm { align: center middle; } Confirm > Vertical {" + BOX + "}"
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


class Ask(ModalScreen[str | None]):
    """A question whose answer is a line of text; None if it was left with Esc."""

    DEFAULT_CSS = "Ask { align: center middle; } Ask > Vertical {" + BOX + "} Ask .wrong { color: $text-error; }"
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "leave", id="ask.leave")]

    def __init__(
        self,
        question: str,
        value: str = "",
        check: Callable[[str], str] = lambda _: "",
        offered: Iterable[str] = (),
    ) -> None:
        """Ask; `check` returns what is wrong with an answer, or nothing; what is offered completes what is typed."""
        super().__init__()
        self._question, self._value, self._check = question, value, check
        self._suggester = SuggestFromList(offered)

    def compose(self) -> ComposeResult:
        """Show the question, a line to write in, and what is wrong with it."""
        with Vertical():
            yield Static(Text(printable(self._question)))
            yield Input(self._value, suggester=self._suggester)
            yield Static("", classes="wrong")

    @on(Input.Changed)
    def _checked(self, event: Input.Changed) -> None:
        self.query_one(".wrong", Static).update(Text(printable(shortened(self._check(event.value)))))

    @on(Input.Submitted)
    def _answered(self, event: Input.Submitted) -> None:
        if not self._check(event.value):
            self.dismiss(event.value)

    def action_leave(self) -> None:
        """Leave without an answer."""
        self.dismiss(None)
