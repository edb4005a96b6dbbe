"""A form as one widget: its lines are drawn, and only the one that is written in is an input."""

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

from fraexp.figures.elements.labels import printable
from fraexp.tui.services.launch_form import FieldGroup, FormField

PATH, UNIT = 36, 12
"""Widths of the columns beside the text."""
HINTS = 110
"""Width from which on the meanings stand beside the units."""


class Written:
    """The texts of a form's fields, by path, where they are not as at first, and what is wrong with them."""

    def __init__(self) -> None:
        self.changes: dict[str, str] = {}
        self.faults: dict[str, str] = {}

    def text(self, field: FormField) -> str:
        """Return what stands in a field."""
        return self.changes.get(field.path, field.text)


class FieldLines(Widget):
    """The drawn lines."""

    DEFAULT_CSS = "FieldLines { height: auto; width: 1fr; }"
    COMPONENT_CLASSES = {"lines--title", "lines--dim", "lines--wrong"}  # noqa: RUF012 (as Textual declares it)

    def __init__(self, written: Written) -> None:
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
        line = _cell(f"{mark} {field.path}", PATH, style)
        line.append_text(_cell(shown, self.text_width, style if content else self._style("dim")))
        line.append_text(_cell(f" {field.unit if field.unit != '1' else ''}", UNIT, self._style("dim")))
        if after:
            line.append_text(_cell(field.hint, after, self._style("dim")))
        return line

    @property
    def hint_width(self) -> int:
        """Cells for the meanings; none in a narrow terminal."""
        return (self.size.width - PATH - UNIT) // 2 if self.size.width >= HINTS else 0

    @property
    def text_width(self) -> int:
        """Cells for what is written."""
        return max(self.size.width - PATH - UNIT - self.hint_width, 8)


def _cell(text: str, width: int, style: Style) -> Text:
    cell = Text(printable(text), style=style, no_wrap=True, end="")
    cell.truncate(width, overflow="ellipsis", pad=True)
    return cell


class Line(Input):
    """The line that is written in."""

    def _on_paste(self, event: events.Paste) -> None:
        """Take all lines of what is pasted: a list may stand in several."""
        event.text = " ".join(line.strip() for line in event.text.splitlines())


class FieldList(VerticalScroll, can_focus=False, inherit_bindings=False):
    """A form's lines, with an input over the one that is chosen."""

    DEFAULT_CSS = """
    FieldList { height: 1fr; }
    FieldList .lines--title { color: $text-accent; }
    FieldList .lines--dim { color: $text-muted; }
    FieldList .lines--wrong { color: $text-error; }
    FieldList > Input { position: absolute; height: 1; display: none; background: $boost; }
    """

    class Chosen(Message):
        """A line is to be written in."""

        def __init__(self, field: FormField) -> None:
            super().__init__()
            self.field = field

    def __init__(self, written: Written) -> None:
        super().__init__()
        self.written = written
        self.field: FormField | None = None
        """The one that is written in."""

    def compose(self) -> ComposeResult:
        """Draw the lines, and an input that is moved over them."""
        yield FieldLines(self.written)
        yield Line(compact=True, select_on_focus=False)

    @property
    def fields(self) -> list[FormField]:
        """All fields."""
        return [row for row in self.query_one(FieldLines).rows if isinstance(row, FormField)]

    def show(self, groups: Sequence[FieldGroup]) -> None:
        """Show the fields of a form; the input stays at its path."""
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
        """Write in a field from now on."""
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
        """Write in none."""
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
            line.styles.offset = (PATH, lines.rows.index(self.field))
            line.styles.width = lines.text_width
            self.see(self.field)

    def on_resize(self) -> None:
        """Put the input where its line is now."""
        self.call_after_refresh(self._place)

    def on_click(self, event: events.Click) -> None:
        """Write in the line that is clicked."""
        lines = self.query_one(FieldLines)
        row = event.screen_y - lines.region.y
        if event.widget is lines and 0 <= row < len(lines.rows):
            field = lines.rows[row]
            if isinstance(field, FormField):
                self.choose(field)
