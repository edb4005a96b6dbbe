"""A form: all lines are one widget, an input covers the edited one, and the page follows what is typed."""

import asyncio
from collections.abc import Sequence
from typing import ClassVar

from rich.style import Style
from rich.text import Text
from textual import events, on, work
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.suggester import SuggestFromList
from textual.widget import Widget
from textual.widgets import Button, Input, Static

from fraexp.data.texts import printable
from fraexp.errors import FraexpError
from fraexp.tui.page import Page
from fraexp.tui.services.launch_form import FieldGroup, FormField, find_concerned

PATH_WIDTH, UNIT_WIDTH = 36, 12
"""Widths of the columns beside the value."""
MIN_FULL_WIDTH, NARROW_PATH, NARROW_UNIT_WIDTH = 64, 0.5, 7
"""Width of the form below which it has narrow columns, the part of it that is then the path, and the unit's width."""
MIN_HINT_WIDTH = 110
"""Minimum width of the form to show the meanings beside the units."""


class FormDraft:
    """The changed values of a form by path, and the line that is wrong."""

    def __init__(self) -> None:
        self.changes: dict[str, str] = {}
        self.wrong = ""
        """Path of the field that an error names; empty without one."""

    def text(self, field: FormField) -> str:
        """Return the current text of a field."""
        return self.changes.get(field.path, field.text)


class FieldLines(Widget):
    """The lines of a form, drawn as text."""

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
        path_width, text_width, unit_width, hint_width = self.widths
        changed, wrong = field.path in self.written.changes, field.path == self.written.wrong
        mark = "!" if wrong else "*" if changed else " "
        content = self.written.text(field)
        shown = content or (f"({field.instead})" if field.instead else "")
        style = self._style("wrong") if wrong else Style(bold=True) if changed else Style()
        line = _cell(f"{mark} {field.label or field.path}", path_width - 1, style).append(" ")
        line.append_text(_cell(shown, text_width, style if content else self._style("dim")))
        line.append_text(_cell(f" {field.unit if field.unit != '1' else ''}", unit_width, self._style("dim")))
        if hint_width:
            line.append_text(_cell(field.hint, hint_width, self._style("dim")))
        return line

    @property
    def widths(self) -> tuple[int, int, int, int]:
        """Widths of paths, values, units and meanings; the last is 0 in a narrow form."""
        width = self.size.width
        path, unit = (PATH_WIDTH, UNIT_WIDTH)
        if width < MIN_FULL_WIDTH:
            path, unit = int(NARROW_PATH * width), NARROW_UNIT_WIDTH
        hint = (width - path - unit) // 2 if width >= MIN_HINT_WIDTH else 0
        return path, max(width - path - unit - hint, 8), unit, hint


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

    def write(self, text: str) -> None:
        """Type a text over that of the edited field."""
        line = self.query_one(Input)
        line.value, line.cursor_position = text, len(text)

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
            path_width, text_width, *_ = lines.widths
            line.styles.offset = (path_width, lines.rows.index(self.field))
            line.styles.width = text_width
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


class FormPage(Page):
    """A page whose body has a `FieldList` of its draft, and a Static with the id ``hint`` for the meaning of a line."""

    CHECK_DELAY_S: ClassVar[float]
    """Seconds without a key after which what is written is checked."""

    def __init__(self, written: FormDraft) -> None:
        super().__init__()
        self.written = written

    @property
    def form(self) -> FieldList:
        """The lines."""
        return self.query_one(FieldList)

    def write(self, field: FormField, text: str) -> None:
        """Take note of the text of a field."""
        self.written.changes[field.path] = text

    async def check(self) -> None:
        """Check all that is written, and show what follows from it."""
        raise NotImplementedError

    @on(Input.Changed)
    def _handle_input(self, event: Input.Changed) -> None:
        field, text = self.form.field, event.value.strip()
        if field is not None and text != self.written.text(field):
            self.write(field, text)
            self.form.redraw()
            self.check_soon()

    @work(group="check", exclusive=True)
    async def check_soon(self) -> None:
        """Check what is written once no key follows."""
        await asyncio.sleep(self.CHECK_DELAY_S)
        await self.check()

    def mark_fault(self, error: Exception | None) -> FormField | None:
        """Mark the line that an error is about, and return it; without an error the mark is removed."""
        field = find_concerned(error.path, self.form.fields) if isinstance(error, FraexpError) else None
        self.written.wrong = field.path if field else ""
        self.form.redraw()
        return field

    @on(FieldList.Chosen)
    def _show_chosen_hint(self, event: FieldList.Chosen) -> None:
        self.show_hint(event.field)

    def show_hint(self, field: FormField) -> None:
        """Show the meaning of a field."""
        text = Text(printable(field.path), style="bold").append(f"  {printable(field.hint)}", style="not bold")
        self.query_one("#hint", Static).update(text)

    @on(Input.Submitted)
    def _handle_submit(self) -> None:
        self.action_next(1)

    def action_next(self, lines: int) -> None:
        """Move by lines; a button is before the first line."""
        fields = self.form.fields
        if not fields:
            return  # nothing can be edited
        at = lines + (fields.index(self.form.field) if self.form.field in fields else -1)
        if at < 0 and (button := self.query(Button)):
            button.first().focus()
        else:
            self.form.choose(fields[min(max(at, 0), len(fields) - 1)])
