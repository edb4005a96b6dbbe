"""Compare: the marked sweeps in linked plots, at a cursor, and in what they differ."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.events import Resize
from textual.widgets import DataTable, Static

from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import printable
from fraexp.figures.elements.view import View
from fraexp.tui.dialogs import Ask, Confirm
from fraexp.tui.plotting.compared_sweeps import (
    OF_RESPONSES,
    VIEWS,
    ComparedSweeps,
    Gathered,
    compare_command,
    compared,
    gather,
    plot_command,
)
from fraexp.tui.plotting.figure_export import draw, wrong_file
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plot_widget import digit
from fraexp.tui.plotting.plotted_curves import KINDS, REFERENCE, Picture
from fraexp.tui.screens.plot_page import HIGH, PlotPage
from fraexp.tui.widgets.readout import cut
from fraexp.views.words import plural

EMPTY = """Nothing is marked to be compared.

Mark sweeps with space: in Sweeps (w), in a run (r, enter), or all of a run with c there.
What is marked stays marked until you take the mark away, and c comes back here."""

BESIDE = 0.4
"""Share of the screen that the table has beside the plots."""
LEAST_NAME = 16
"""Width that a name in the table has at least; it gets a third of the table."""


class ComparePage(PlotPage):
    """The marked sweeps side by side."""

    PLACE: ClassVar[str] = "compare"
    HELP: ClassVar[str] = """
The marked sweeps over each other: response, difference, complex plane, coherence and distortion, or other curves.
Each curve has a digit, which hides or shows it; beyond nine focus it and press the full stop. The focused one (>)
lies above the others, and the cursor follows it. Other curves are shown one kind at a time.
Dots around a line are its 95 % limits; hollow points had not settled, and no line goes through them.
The table has only what differs. A file has the visible curves as 'fraexp plot' draws them: unwrapped, and all of them.
"""
    AUTO_FOCUS: ClassVar[str | None] = ""
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (160, "-wide")]  # noqa: RUF012 - as Textual declares it
    VERTICAL_BREAKPOINTS = [(0, "-flat"), (HIGH, "-low"), (32, "-high")]  # noqa: RUF012
    DEFAULT_CSS: ClassVar[str] = (
        """
    ComparePage #both { height: 1fr; }
    ComparePage #left { width: 1fr; }
    ComparePage #readout { height: 1; padding: 0 1; text-wrap: nowrap; }
    ComparePage #notes { height: auto; max-height: 2; padding: 0 1; color: $text-muted; }
    ComparePage #differs { width: """
        + f"{BESIDE:.0%}"
        + """; display: none; border-left: solid $panel; }
    ComparePage.-flat #notes { max-height: 1; }
    ComparePage.-narrow.-table #left { display: none; }
    ComparePage.-narrow.-table #differs { display: block; width: 1fr; border-left: none; }
    ComparePage.-wide.-beside #differs { display: block; }
    """
    )
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("b", "view('bode')", "Bode", id="compare.bode", tooltip="magnitude and phase over frequency"),
        Binding("d", "view('difference')", "diff", id="compare.difference", tooltip="difference to the reference"),
        Binding("n", "view('nyquist')", "Nyquist", id="compare.nyquist", tooltip="responses in the complex plane"),
        Binding("t", "view('coherence')", "THD", id="compare.coherence", tooltip="coherence and harmonic distortion"),
        Binding("v", "view('curves')", "curves", id="compare.curves", tooltip="loops, motions and other curves"),
        Binding("i", "table", "table", id="compare.table", tooltip="in what they differ, as a table"),
        Binding("tab", "table", show=False, id="compare.table-tab", tooltip="in what they differ, as a table"),
        Binding("R", "reference", "ref", id="compare.reference", tooltip="differences are from the focused curve"),
        Binding("e", "export", "export", id="compare.export", tooltip="write what is seen as PNG, SVG or PDF"),
        Binding("space", "unmark", show=False, id="compare.unmark", tooltip="take the focused sweep's mark away"),
        Binding("enter", "open", show=False, id="compare.open", tooltip="all of the focused sweep"),
        Binding("g", "group", show=False, id="compare.group", tooltip="responses in the next unit, or next curves"),
    ]  # fmt: skip

    def __init__(self) -> None:
        super().__init__()
        self.compared: ComparedSweeps | None = None
        self.view, self.unit, self.kind = "", "", ""
        self.first = 0
        """Place of the sweep that differences are from."""
        self._gathered: Gathered | None = None
        self._pictures: dict[tuple[str, str, int], Picture] = {}
        self._turn = asyncio.Lock()
        """Held by the view that is being made: what is asked for later is shown later."""

    def body(self) -> ComposeResult:
        """Show plots over the readout, and a table beside them."""
        with Horizontal(id="both"):
            with Vertical(id="left"):
                yield PlotStack()
                yield Static(id="readout")
                yield Static(id="notes")
            yield DataTable(id="differs", cursor_type="row", zebra_stripes=True)

    def on_mount(self) -> None:
        """Take the user's choice of phase."""
        super().on_mount()
        self.add_class("-beside")
        self.stack.sight.wrapped = self.app.settings.phase == "wrapped"
        self.query_one("#both").display = False

    async def load(self) -> None:
        """Read the marked sweeps; what has not changed is not drawn again."""
        marked = list(self.app.marks)
        if not marked:
            self._empty()
            return
        if self.compared is None:
            self.tell("Reading the marked sweeps …")
            self.command = compare_command(self.app.desk.workspace, marked)
        gathered = await self.fetch(self.app.desk.read(lambda store: gather(store, marked)), self._failed)
        if gathered is None:
            return
        self.app.marks.remove(gathered.gone)
        if not gathered.sweeps:
            self._empty("; ".join(gathered.left_out))
            return
        if _same(self._gathered, gathered):
            self.head()
            return
        found = await self.fetch(self.app.desk.work(lambda workspace: compared(workspace, gathered)), self._failed)
        if found is not None:
            await self._take(found, gathered)

    def _failed(self, error: str) -> None:
        self._forget()
        self.tell_error(error)

    def _empty(self, why: str = "") -> None:
        self._forget()
        self.command = "fraexp compare ID ID"
        self.tell(f"{why}\n\n{EMPTY}".strip())

    def _forget(self) -> None:
        self.compared, self._gathered, self.heading = None, None, ""
        self.query_one("#both").display = False

    async def _take(self, found: ComparedSweeps, gathered: Gathered) -> None:
        """Show other sweeps; what is hidden, focused or the reference stays so if it is still there."""
        before = self.compared.sweeps if self.compared else ()
        kept = {sweep.key: place for place, sweep in enumerate(found.sweeps)}
        old = {place: kept[sweep.key] for place, sweep in enumerate(before) if sweep.key in kept} | {
            REFERENCE: REFERENCE
        }
        sight = self.stack.sight
        sight.hidden = {old[place] for place in sight.hidden if place in old}
        sight.focus, self.first = old.get(sight.focus, 0), old.get(self.first, 0)
        self.compared, self._pictures = found, {}
        self.query_one("#both").display = True  # laid out while the picture is made
        self._fill_table()
        if not await self._show() and self.view not in ("", _usual(found)):
            await self._show(_usual(found))
        self._gathered = gathered  # not before: if other sweeps come meanwhile, these have not been shown

    async def _show(self, view: str = "", group: str = "") -> bool:
        """Show a view, or the last one, and return whether it can be shown.

        If not it says why, and the one before stays. If other sweeps come meanwhile, it is shown of them.
        """
        async with self._turn:
            while (found := self.compared) is not None:
                key, pictures = self._asked_for(found, view, group), self._pictures
                if key not in pictures:
                    try:
                        pictures[key] = await asyncio.to_thread(found.picture, *key)
                    except FraexpError as error:
                        self.app.notify(printable(str(error)), severity="warning", markup=False)
                        if self._gathered is None:
                            self.tell_error(str(error))  # there is no view before
                        return False
                if found is self.compared:
                    self._display(key, pictures[key])
                    return True
            return False

    def _asked_for(self, found: ComparedSweeps, view: str, group: str) -> tuple[str, str, int]:
        """Return view, group and reference of what is to be shown."""
        view = view or (self.view if self.view and found.groups(self.view) else _usual(found))
        group = group if group in found.groups(view) else self._group(found, view)
        first = self.first
        if view == "difference" and first != REFERENCE and found.unit_of(first) != group:
            first = next(iter(found.places(view, group)), 0)
        return view, group, first

    def _display(self, key: tuple[str, str, int], picture: Picture) -> None:
        self.view, group, self.first = key
        if self.view in OF_RESPONSES:
            self.unit = group
        else:
            self.kind = group
        labels = self.labels()
        if self.stack.sight.focus not in labels:
            self.stack.sight.focus = next(iter(labels), 0)
        self.tell()
        self.stack.display_picture(picture)
        self.tell_view()

    def _group(self, found: ComparedSweeps, view: str) -> str:
        """Return the group of a view that was shown last, else the first one."""
        last, groups = self.unit if view in OF_RESPONSES else self.kind, found.groups(view)
        return last if last in groups else next(iter(groups), "")

    @property
    def group(self) -> str:
        """Unit of the responses that are shown, or kind of the curves."""
        return self.unit if self.view in OF_RESPONSES else self.kind

    def labels(self) -> dict[int, str]:
        """Return the names of what the view can show, by place."""
        return self.compared.labels(self.view, self.group) if self.compared else {}

    def tell_view(self) -> None:
        """Tell what the view is called, which command gives the same, and what is at the cursor."""
        found, picture = self.compared, self.stack.picture
        if found is None or picture is None:
            return
        self.heading = VIEWS[self.view] if self.view in OF_RESPONSES else f"{VIEWS[self.view]}: {KINDS[self.kind]}"
        keys = self._keys() or [found.sweeps[place].key for place in found.places(self.view, self.group)]
        workspace = self.app.desk.workspace
        self.command = (
            compare_command(workspace, keys)
            if self.has_class("-table") and len(keys) > 1
            else plot_command(workspace, keys, picture.kind, self._file(), self.stack.view())
        )
        notes = [f"against {self._reference()}"] if self.view == "difference" else []
        notes += [*self.hints(self.labels()), *found.notes(self.view, self.group), picture.note]
        place, text = self.query_one("#notes", Static), printable("; ".join(note for note in notes if note))
        if str(place.content) != text:
            place.update(Text(text))
            place.display = bool(text)
        self.tell_cursor()

    def _reference(self) -> str:
        assert self.compared is not None
        return "P(jω)" if self.first == REFERENCE else self.compared.shown[self.first].label

    def _keys(self) -> list[str]:
        """Return the keys of what is seen; of differences the reference comes first."""
        assert self.compared is not None
        hidden = self.stack.sight.hidden
        seen = [place for place in self.compared.places(self.view, self.group) if place not in hidden]
        if self.view == "difference" and self.first != REFERENCE:
            seen = [self.first, *(place for place in seen if place != self.first)]
        return [self.compared.sweeps[place].key for place in seen]

    def _file(self) -> str:
        picture = self.stack.picture
        return f"{picture.kind if picture else 'figure'}.png"

    def _fill_table(self) -> None:
        assert self.compared is not None
        table = self.query_one("#differs", DataTable)
        table.clear(columns=True)
        beside = self.has_class("-wide")
        longest = max(LEAST_NAME, int((BESIDE if beside else 1) * self.size.width) // 3)
        table.add_column("what differs")
        for place, shown in enumerate(self.compared.shown):  # beside the plots the readout has the names
            table.add_column(Text(digit(place) if beside else f"{digit(place)} {printable(shown.label)}"))
        for name, *values in self.compared.rows:
            table.add_row(Text(cut(printable(name), longest).rstrip()), *(Text(printable(text)) for text in values))
        if not self.compared.rows:
            table.add_row(Text("nothing" if len(self.compared.sweeps) > 1 else "one sweep: mark another one"))

    @on(Resize)
    def _table_resized(self) -> None:
        if self.compared is not None:
            self.call_after_refresh(self._fill_table)

    async def action_view(self, view: str) -> None:
        """Show another view of the same sweeps; while they are read it is remembered."""
        self.remove_class("-table")
        if self.compared is None and self.app.marks:
            self.view = view
        await self._show(view)

    def action_table(self) -> None:
        """Show the table of what differs, or the plots; beside each other if there is room."""
        if self.compared is None:
            return
        self.toggle_class("-beside" if self.has_class("-wide") else "-table")
        table = self.query_one("#differs", DataTable)
        self.set_focus(table if self.has_class("-table") and not self.has_class("-wide") else None)
        self.call_after_refresh(self.tell_view)

    def action_back(self) -> None:
        """Leave the table, then the page."""
        if self.has_class("-table") and not self.has_class("-wide"):
            self.action_table()
        else:
            super().action_back()

    async def action_reference(self) -> None:
        """Let differences be from the focused curve."""
        if self.compared is None:
            return
        self.first = self.stack.sight.focus
        await self._show("difference")

    async def action_group(self) -> None:
        """Show the responses in the next unit, or the curves of the next kind, which can be shown."""
        groups = self.compared.groups(self.view) if self.compared else []
        at = groups.index(self.group) if self.group in groups else 0
        for group in groups[at + 1 :] + groups[:at]:
            if await self._show(self.view, group):
                break

    def action_unmark(self) -> None:
        """Leave the focused sweep out from now on."""
        if self.compared and 0 <= self.stack.sight.focus < len(self.compared.sweeps):
            self.app.marks.remove([self.compared.sweeps[self.stack.sight.focus].key])
            self.reload()

    def action_open(self) -> None:
        """Show all of the focused sweep."""
        from fraexp.tui.screens.sweep_page import SweepPage

        if self.compared and 0 <= self.stack.sight.focus < len(self.compared.sweeps):
            self.app.push_screen(SweepPage(self.compared.sweeps[self.stack.sight.focus].key))

    async def action_export(self) -> None:
        """Write what is seen as a figure, as ``fraexp plot`` does."""
        if self.compared is None or self.stack.picture is None:
            return
        kind, keys, view = self.stack.picture.kind, self._keys(), self.stack.view()
        if not keys:
            self.app.notify("All curves are hidden; 0 shows them", severity="warning")
            return
        question = f"Write {plural(len(keys), 'curve')} as a {kind} figure to a file (.png, .svg or .pdf):"

        def named(answer: str | None) -> None:
            file = Path(answer.strip()).expanduser() if answer else None
            if file and file.exists():
                self.app.push_screen(
                    Confirm(f"{file} exists. Replace it?"), lambda yes: self._write(keys, kind, file, yes, view)
                )
            elif file:
                self._write(keys, kind, file, True, view)

        self.app.push_screen(Ask(question, self._file(), wrong_file), named)

    def _write(self, keys: Sequence[str], kind: str, file: Path, wanted: bool | None, view: View) -> None:
        if wanted:
            self.app.notify(f"drawing {printable(str(file))} …", timeout=3, markup=False)
            self.run_worker(self._drawn(keys, kind, file, view), group="export")

    async def _drawn(self, keys: Sequence[str], kind: str, file: Path, view: View) -> None:
        ended, text = await draw(self.app.desk.workspace, keys, kind, file, view)
        self.app.notify(printable(text), title="written" if ended else "not written",
                        severity="information" if ended else "error", markup=False)  # fmt: skip


def _usual(found: ComparedSweeps) -> str:
    return "bode" if found.units else "curves"


def _same(before: Gathered | None, now: Gathered) -> bool:
    """Return whether the same is compared as before."""
    if before is None or before.left_out != now.left_out:
        return False
    return [(s.key, s.created, s.labels) for s in before.sweeps] == [(s.key, s.created, s.labels) for s in now.sweeps]
