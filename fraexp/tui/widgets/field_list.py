"""A form as one widget: all lines are drawn as text, and an input covers the edited one."""

from collections.abc import Sequence

from rich.style import Style
from rich.text import Text
from textual import events
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.suggester import SuggestFromList
from textual.widget import Widget
from textual.widgets import Input

from fraexp.data.terminal_text import printable
from fraexp.tui.services.launch_form import FieldGroup, FormField

PATH_WIDTH, UNIT_WIDTH = 36, 12
"""Widths of the columns beside the value."""
MIN_HINT_WIDTH = 110
"""Minimum width of the form to show the meanings beside the units."""


class FormDraft:
    """The changed values of a form, and their faults, by path."""

    def __init__(self) -> None:
        self.changes: dict[str, str] = {}
        self.faults: dict[str, str] = {}

    def text(self, field: FormField) -> str:
        """Return the current text of a field."""
        return self.changes.get(field.path, field.text)


class FieldLines(Widget):
    """The lines of a form, drawn as text."""

    DEFAULT_CSS = "FieldLines { height: auto; width: 1fr; }"
    COMPONENT_CLASSES = {"lines--title", "lines--dim", "lines--wrong"}  # noqa: RUF012 (as Textual declares it)

    def __init__(self, written: FormDraft) -> None:
        super().__init__()
        self.written = written
        self.rows: list[FormField | str] = []

    def get_content_height(self, container: object, viewport: object, width: int) -> int:
        """Return the number of lines."""
        return len(self.rows)

    def render_line(self, y: int) -> Strip:
        """Draw a line."""
        if y >= len(self.rows):
            return Strip.blank(self.size.width, self.rich_style)
        row = self.rows[y]
        text = self._title(row) if isinstance(row, str) else self._field(row)
        text.truncate(self.size.width, pad=True)
        return Strip(text.render(self.app.console, end=""), self.size.width).apply_style(self.rich_style)

    def _style(self, name: str) -> Style:
        return self.get_component_rich_style(f"lines--{name}", partial=True)

    def _title(self, title: str) -> Text:
        return Text(f" {title}", style=self._style("title") + Style(bold=True))

    def _field(self, field: FormField) -> Text:
        changed, wrong = field.path in self.written.changes, field.path in self.written.faults
        mark = "!" if wrong else "*" if changed else " "
        content, after = self.written.text(field), self.hint_width
        shown = content or (f"({field.instead})" if field.instead else "")
        style = self._style("wrong") if wrong else Style(bold=True) if changed else Style()
        line = _cell(f"{mark} {field.path}", PATH_WIDTH, style)
        line.append_text(_cell(shown, self.text_width, style if content else self._style("dim")))
        line.append_text(_cell(f" {field.unit if field.unit != '1' else ''}", UNIT_WIDTH, self._style("dim")))
        if after:
            line.append_text(_cell(field.hint, after, self._style("dim")))
        return line

    @property
    def hint_width(self) -> int:
        """Width of the meanings; 0 in a narrow terminal."""
        return (self.size.width - PATH_WIDTH - UNIT_WIDTH) // 2 if self.size.width >= MIN_HINT_WIDTH else 0

    @property
    def text_width(self) -> int:
        """Width of the values."""
        return max(self.size.width - PATH_WIDTH - UNIT_WIDTH - self.hint_width, 8)


def _cell(text: str, width: int, style: Style) -> Text:
    cell = Text(printable(text), style=style, no_wrap=True, end="")
    cell.truncate(width, overflow="ellipsis", pad=True)
    return cell


class FieldInput(Input):
    """The input over the edited line."""

    def on_paste(self, event: events.Paste) -> None:
        """Join pasted lines, as a list may span several."""
        event.text = " ".join(line.strip() for line in event.text.splitlines())


class FieldList(VerticalScroll, can_focus=False, inherit_bindings=False):
    """The lines of a form, with an input over the chosen one."""

    DEFAULT_CSS = """
    FieldList { height: 1fr; }
    FieldList .lines--title { color: $text-accent; }
    FieldList .lines--dim { color: $text-muted; }
    FieldList .lines--wrong { color: $text-error; }
    FieldList > Input { position: absolute; height: 1; display: none; background: $boost; }
    """

    class Chosen(Message):
        """A line was chosen for editing."""

        def __init__(self, field: FormField) -> None:
            super().__init__()
            self.field = field

    def __init__(self, written: FormDraft) -> None:
        super().__init__()
        self.written = written
        self.field: FormField | None = None
        """The edited field."""

    def compose(self) -> ComposeResult:
        """Yield the lines, and the input that moves over them."""
        yield FieldLines(self.written)
        yield FieldInput(compact=True, select_on_focus=False)

    @property
    def fields(self) -> list[FormField]:
        """All fields."""
        return [row for row in self.query_one(FieldLines).rows if isinstance(row, FormField)]

    def show(self, groups: Sequence[FieldGroup]) -> None:
        """Show the fields of a form; the input stays on its field."""
        lines, path = self.query_one(FieldLines), self.field.path if self.field else ""
        lines.rows = []
        for group in groups:
            lines.rows += [group.title, *group.fields]
        lines.refresh(layout=True)
        if self.field:
            self.field = next((field for field in self.fields if field.path == path), None)
            self._place()

    def redraw(self) -> None:
        """Draw the lines again."""
        self.query_one(FieldLines).refresh()

    def choose(self, field: FormField) -> None:
        """Edit a field."""
        line = self.query_one(Input)
        self.field = field
        with self.prevent(Input.Changed):
            line.suggester = SuggestFromList(field.choices, case_sensitive=False) if field.choices else None
            line.placeholder = f"({field.instead})" if field.instead else ""
            line.value = self.written.text(field)
            line.cursor_position = len(line.value)
        self._place()
        line.focus(scroll_visible=False)
        self.post_message(self.Chosen(field))

    def leave(self) -> None:
        """Stop editing."""
        self.field = None
        self._place()

    def see(self, field: FormField) -> None:
        """Scroll to a field."""
        row = self.query_one(FieldLines).rows.index(field)
        self.scroll_to_region(Region(0, max(row - 1, 0), 1, 3), animate=False)

    def _place(self) -> None:
        line, lines = self.query_one(Input), self.query_one(FieldLines)
        line.display = self.field is not None
        if self.field is not None:
            line.styles.offset = (PATH_WIDTH, lines.rows.index(self.field))
            line.styles.width = lines.text_width
            self.see(self.field)

    def on_resize(self) -> None:
        """Move the input to the new place of its line."""
        self.call_after_refresh(self._place)

    def on_click(self, event: events.Click) -> None:
        """Edit the clicked line."""
        lines = self.query_one(FieldLines)
        row = event.screen_y - lines.region.y
        if event.widget is lines and 0 <= row < len(lines.rows):
            field = lines.rows[row]
            if isinstance(field, FormField):
                self.choose(field)
