"""Compare: the marked sweeps in linked plots with a cursor, and a table of their differences."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.events import Click, Resize
from textual.widgets import DataTable, Static

from fraexp.data.texts import printable
from fraexp.errors import FraexpError
from fraexp.tui.dialogs import GroupingDialog
from fraexp.tui.page import ACTION_GROUP, LOAD_GROUP, Page
from fraexp.tui.plotting.compared_sweeps import (
    MAX_COMPARED_SWEEPS,
    RESPONSE_VIEWS,
    VIEW_NAMES,
    ComparedSweeps,
    MarkedSweeps,
    compare_sweeps,
    read_marked_sweeps,
    split_group,
)
from fraexp.tui.plotting.curve_styles import curve_digit
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plotted_curves import CURVE_KINDS, REFERENCE, Picture
from fraexp.tui.widgets.figure_export import FigureExport, compare_command
from fraexp.tui.widgets.readout import readout, shorten_name
from fraexp.views.words import plural, short_key

MIN_NAME_WIDTH = 16
"""Minimum width of a name; it gets a third of the table."""


class DifferenceTable(DataTable[Text]):
    """A row for each parameter, metric and fit that differs, and a column for each curve: medians of many sweeps."""

    def fill(self, compared: ComparedSweeps, width: int, beside: bool) -> None:
        """Show other curves in a width; `beside` the plots, whose readout shows the names of the curves."""
        self.clear(columns=True)
        longest = max(MIN_NAME_WIDTH, width // 3)
        self.add_column("difference")
        for place, curve in enumerate(compared.curves):
            digit = curve_digit(place)
            count = len(curve.members)
            number = f"{digit}, median of {count:,}" if count > 1 else digit
            self.add_column(Text(number if beside else f"{digit} {printable(curve.label)}"))
        for name, *values in compared.rows:
            cells = (Text(printable(text)) for text in values)
            self.add_row(Text(shorten_name(printable(name), longest).rstrip()), *cells)
        for owner, count in compared.folded.items():
            self.add_row(Text(shorten_name(f"{owner}.… ({count})", longest).rstrip()), Text("not in all"))
        if not compared.rows:
            self.add_row(Text("none" if len(compared.curves) > 1 else "only one curve; mark other sweeps"))


ZOOM_FACTOR = 1.5
"""Factor of one zoom step."""
MIN_READOUT_ROWS, MIN_HIGH_ROWS = 3, 16
"""Minimum rows of the readout in a terminal with at least so many rows; a lower one has one."""
PAN_FRACTION = 0.2
"""Fraction of the visible range by which one pan moves."""
MAX_DIGIT_KEYS = 9
"""Number of curves with a digit key; the letters of other curves are not keys."""
FAST_COLUMNS = 10
"""Columns of a fast cursor step."""


NOTHING_MARKED = """No sweeps are marked.

Mark sweeps with space: in Sweeps (w) or in a run (r, enter); c in a run marks all of its sweeps.
Marks stay until you remove them; c returns to this screen."""

TABLE_FRACTION = 0.4
"""Fraction of the screen width for the table beside the plots."""
FIRST_SWEEPS = 200
"""Number of sweeps from which the first picture is made, so that it appears at once."""


class ComparePage(Page):
    """The comparison of the marked sweeps."""

    PLACE: ClassVar[str] = "compare"
    HELP: ClassVar[str] = """
The marked sweeps in one plot: Bode, difference, Nyquist, coherence and distortion, or other curves.
The digit of a curve hides or shows it; beyond nine, focus it and press the full stop. The cursor follows the focused
curve (>). Where curves overlap, their colours alternate. Other curves are shown one kind at a time.
Random draws at one point of the grid are one curve: their median in a band of 5 to 95 %. Enter opens them, Esc returns.
G chooses the labels that make groups; g shows the next part of what does not fit into one view.
Hatching around other curves is their 95 % limits; hollow points had not reached steady state, and are not joined.
The wheel zooms around the pointer, with Shift in y; dragging moves the curves. The table lists differences only.
An exported figure shows the visible curves and frequencies.
"""
    AUTO_FOCUS: ClassVar[str | None] = ""
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (160, "-wide")]  # noqa: RUF012 - as Textual declares it
    VERTICAL_BREAKPOINTS = [(0, "-flat"), (MIN_HIGH_ROWS, "-low"), (32, "-high")]  # noqa: RUF012
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("b", "view('bode')", "Bode", tooltip="magnitude and phase over frequency"),
        Binding("d", "view('difference')", "diff", tooltip="difference from the reference"),
        Binding("n", "view('nyquist')", "Nyquist", tooltip="responses in the complex plane"),
        Binding("t", "view('coherence')", "THD", tooltip="coherence and harmonic distortion"),
        Binding("v", "view('curves')", "curves", tooltip="loops, motions and other curves"),
        Binding("i", "table", "table", tooltip="table of the differences"),
        Binding("tab", "table", show=False, tooltip="table of the differences"),
        Binding("R", "reference", "ref", tooltip="use the focused curve as the reference"),
        Binding("e", "export", "export", tooltip="export the plot as PNG, SVG or PDF"),
        Binding("space", "unmark", show=False, tooltip="unmark the focused sweep"),
        Binding("enter", "open", show=False, tooltip="open the focused sweep"),
        Binding("g", "group", show=False, tooltip="next unit, facet, or kind of curves"),
        Binding("G", "group_by", "group", tooltip="choose the labels that make groups"),
        Binding("left,h", "step(-1)", show=False, tooltip="cursor left"),
        Binding("right,l", "step(1)", show=False, tooltip="cursor right"),
        Binding("ctrl+left", f"step(-{FAST_COLUMNS})", show=False, tooltip="cursor left, fast"),
        Binding("ctrl+right", f"step({FAST_COLUMNS})", show=False, tooltip="cursor right, fast"),
        Binding("left_square_bracket,up,k", "focus_curve(-1)", show=False, tooltip="previous curve"),
        Binding("right_square_bracket,down,j", "focus_curve(1)", show=False, tooltip="next curve"),
        *(Binding(str(n), f"curve({n - 1})", show=False, tooltip="hide or show this curve")
          for n in range(1, 10)),
        Binding("full_stop", "hide", show=False, tooltip="hide or show the focused curve"),
        Binding("0", "all", show=False, tooltip="show all curves"),
        Binding("x", "zoom(True,False,True)", show=False, tooltip="zoom into x"),
        Binding("X", "zoom(True,False,False)", show=False, tooltip="zoom out of x"),
        Binding("z", "zoom(False,True,True)", show=False, tooltip="zoom into y"),
        Binding("Z", "zoom(False,True,False)", show=False, tooltip="zoom out of y"),
        Binding("plus", "zoom(True,True,True)", show=False, tooltip="zoom in"),
        Binding("minus", "zoom(True,True,False)", show=False, tooltip="zoom out"),
        Binding("H,shift+left", "pan(-1,0)", show=False, tooltip="move left"),
        Binding("L,shift+right", "pan(1,0)", show=False, tooltip="move right"),
        Binding("J,shift+down", "pan(0,-1)", show=False, tooltip="move down"),
        Binding("K,shift+up", "pan(0,1)", show=False, tooltip="move up"),
        Binding("equals_sign", "home", show=False, tooltip="show all again"),
        Binding("pageup", "panels(-1)", show=False, tooltip="previous panels"),
        Binding("pagedown", "panels(1)", show=False, tooltip="next panels"),
        Binding("u", "bands", show=False, tooltip="show or hide 95 % limits"),
        Binding("W", "wrap", show=False, tooltip="wrap or unwrap the phase"),
    ]  # fmt: skip

    def __init__(self) -> None:
        super().__init__()
        self.compared: ComparedSweeps | None = None
        self.view, self.unit, self.kind = "", "", ""
        self.first: int | None = None
        """Place of the reference of differences; None until one is chosen: P(jω) if it is known, else the first."""
        self.against = REFERENCE
        """Place of the reference of the differences that are shown."""
        self._by: list[str] | None = None
        """Labels that make groups; None: all."""
        self._opened: list[str] = []
        """Keys of the sweeps of one curve, if they are shown alone."""
        self._loaded: list[str] = []
        """Keys of the sweeps that were read last."""
        self._gathered: MarkedSweeps | None = None
        self._pictures: dict[tuple[str, str, int], Picture] = {}
        self._names: dict[tuple[int, ...], tuple[list[str], list[str]]] = {}
        """What names the sweeps of curves, kept as there may be thousands of sweeps."""
        self._turn = asyncio.Lock()
        """Held while a view is made, so that views are shown in the order of the keys."""

    def body(self) -> ComposeResult:
        """Put the plots above the readout, and a table beside them."""
        with Horizontal(id="both"):
            with Vertical(id="left"):
                yield PlotStack()
                yield Static(id="readout")
                yield Static(id="notes")
            yield DifferenceTable(id="differs", cursor_type="row", zebra_stripes=True)

    def on_mount(self) -> None:
        """Put the table beside the plots, which appear with their curves."""
        self.add_class("-beside")
        self.query_one("#both").display = False

    async def load(self) -> None:
        """Read the marked sweeps; draw only if they have changed."""
        marked = self._opened or list(self.app.marks)
        if not marked:
            self._show_empty()
            return
        if self.compared is None:
            self.show_notice("loading the marked sweeps …")
            named = self.app.marks.origin or list(map(short_key, marked[:FIRST_SWEEPS]))
            self.command = compare_command(self.app.backend.workspace, named)
            if len(marked) > FIRST_SWEEPS:
                await self._load_some(marked, FIRST_SWEEPS)
                await self.wait_for_paint()  # reading all sweeps would take the processor from it
        elif len(marked) > FIRST_SWEEPS and marked == self._loaded:
            self.show_header()  # reading thousands of sweeps again at each change would slow down a run
            return
        await self._load_some(marked, MAX_COMPARED_SWEEPS)
        self._loaded = marked

    async def _load_some(self, marked: list[str], most: int) -> None:
        """Show the sweeps, or distributed ones of them."""
        gathered = await self.read(lambda store: read_marked_sweeps(store, marked, most), self._show_failure)
        if gathered is None:
            return
        self.app.marks.remove(gathered.gone)
        if not gathered.sweeps:
            self._show_empty("; ".join(gathered.left_out))
            return
        if gathered.is_same(self._gathered):
            self.show_header()
            return
        await self._compare(gathered)

    async def _compare(self, gathered: MarkedSweeps) -> None:
        by, apart = self._by, bool(self._opened)
        found = await self.compute(lambda workspace: compare_sweeps(workspace, gathered, by, apart), self._show_failure)
        if found is not None:
            await self._set_sweeps(found, gathered)

    def _show_failure(self, error: str) -> None:
        self._forget()
        self.show_error(error)

    def _show_empty(self, why: str = "") -> None:
        self._forget()
        self.command = "fraexp compare ID ID"
        self.show_notice(f"{why}\n\n{NOTHING_MARKED}".strip())

    def _forget(self) -> None:
        self.compared, self._gathered, self.heading = None, None, ""
        self.query_one("#both").display = False

    async def _set_sweeps(self, found: ComparedSweeps, gathered: MarkedSweeps) -> None:
        """Show other sweeps; hidden curves, focus and reference are kept where they still exist."""
        before = self.compared.curve_names if self.compared else []
        kept = {name: place for place, name in enumerate(found.curve_names)}
        old = {place: kept[name] for place, name in enumerate(before) if name in kept} | {REFERENCE: REFERENCE}
        view_range = self.stack.view_range
        view_range.hidden = {old[place] for place in view_range.hidden if place in old}
        view_range.focus, self.first = (
            old.get(view_range.focus, 0),
            old.get(self.first) if self.first is not None else None,
        )
        self.compared, self._pictures, self._names = found, {}, {}
        self.query_one("#both").display = True  # it is laid out while the picture is made
        self._fill_table()
        if not await self._show() and self.view not in ("", found.default_view):
            await self._show(found.default_view)
        self._gathered = gathered  # not earlier: other sweeps may come before these are shown

    async def _show(self, view: str = "", group: str = "") -> bool:
        """Show a view, by default the last one, and return whether that was possible.

        If not, report why and keep the previous view. If the sweeps change meanwhile, show the view of the new ones.
        """
        async with self._turn:
            while (found := self.compared) is not None:
                key, pictures = self._view_key(found, view, group), self._pictures
                if key not in pictures:
                    try:
                        pictures[key] = await asyncio.to_thread(found.picture, *key)
                    except FraexpError as error:
                        self.app.notify(str(error), severity="warning")
                        if self._gathered is None:
                            self.show_error(str(error))  # there is no previous view
                        return False
                if found is self.compared:
                    self._display(key, pictures[key])
                    return True
            return False

    def _view_key(self, found: ComparedSweeps, view: str, group: str) -> tuple[str, str, int]:
        """Return the view, group and reference to show."""
        view = view or (self.view if self.view and found.groups(self.view) else found.default_view)
        group = group if group in found.groups(view) else self._group(found, view)
        return view, group, found.first_place(group, self.first) if view == "difference" else REFERENCE

    def _display(self, key: tuple[str, str, int], picture: Picture) -> None:
        self.view, group, self.against = key
        if self.view in RESPONSE_VIEWS:
            self.unit = group
        else:
            self.kind = group
        labels = self.labels()
        if self.stack.view_range.focus not in labels:
            self.stack.view_range.focus = next(iter(labels), 0)
        self.show_notice()
        self.stack.display_picture(picture)
        self.show_view()

    def _group(self, found: ComparedSweeps, view: str) -> str:
        """Return the last shown group of a view, else its first."""
        last, groups = self.unit if view in RESPONSE_VIEWS else self.kind, found.groups(view)
        return last if last in groups else next(iter(groups), "")

    @property
    def group(self) -> str:
        """Unit of the shown responses, or kind of the shown curves."""
        return self.unit if self.view in RESPONSE_VIEWS else self.kind

    def labels(self) -> dict[int, str]:
        """Return the names of the curves in the view, by place."""
        return self.compared.labels(self.view, self.group) if self.compared else {}

    def show_view(self) -> None:
        """Show the name of the view, the equivalent command, notes, and the readout."""
        found, picture = self.compared, self.stack.picture
        if found is None or picture is None:
            return
        self.heading = (
            VIEW_NAMES[self.view]
            if self.view in RESPONSE_VIEWS
            else f"{VIEW_NAMES[self.view]}: {CURVE_KINDS[split_group(self.kind)[0]]}"
        )
        facet = split_group(self.group)[1]
        self.heading += f", {facet}" if facet else ""
        places = self._visible_places() or found.places(self.view, self.group)
        keys, named = self._named_by(found, tuple(places))
        workspace = self.app.backend.workspace
        self.command = (
            compare_command(workspace, named)
            if self.has_class("-table") and len(keys) > 1
            else self._export(len(keys), named, picture).command(workspace, self._file())
        )
        notes = [f"against {self._reference()}"] if self.view == "difference" else []
        notes += [*self.hints(self.labels()), *found.notes(self.view, self.group), picture.note]
        place, text = self.query_one("#notes", Static), printable("; ".join(note for note in notes if note))
        if str(place.content) != text:
            place.update(Text(text))
            place.display = bool(text)
        self.show_readout()

    def _named_by(self, found: ComparedSweeps, places: tuple[int, ...]) -> tuple[list[str], list[str]]:
        """Return the keys of the curves' sweeps, and the arguments that name them: a run and a filter, or keys."""
        if places not in self._names:
            keys, origin = found.keys_of(places), self.app.marks.origin
            is_whole = bool(origin) and set(keys) == set(self.app.marks)
            self._names[places] = keys, list(origin) if is_whole else list(map(short_key, keys))
        return self._names[places]

    def _reference(self) -> str:
        assert self.compared is not None
        return "P(jω)" if self.against == REFERENCE else self.compared.curves[self.against].label

    def _visible_places(self) -> list[int]:
        """Return the places of the visible curves; the reference of differences comes first."""
        assert self.compared is not None
        hidden = self.stack.view_range.hidden
        seen = [place for place in self.compared.places(self.view, self.group) if place not in hidden]
        if self.view == "difference" and self.against != REFERENCE:
            seen = [self.against, *(place for place in seen if place != self.against)]
        return seen

    def _export(self, count: int, named: Sequence[str], picture: Picture) -> FigureExport:
        return FigureExport(count, named, picture.kind, self.stack.view(), self._by)

    def _file(self) -> str:
        return f"{self.stack.picture.kind if self.stack.picture else 'figure'}.png"

    def _fill_table(self) -> None:
        assert self.compared is not None
        beside = self.has_class("-wide")
        width = int((TABLE_FRACTION if beside else 1) * self.size.width)
        self.query_one(DifferenceTable).fill(self.compared, width, beside)

    @on(Resize)
    def _handle_resize(self) -> None:
        self.call_after_refresh(self.show_view)
        if self.compared is not None:
            self.call_after_refresh(self._fill_table)

    async def action_view(self, view: str) -> None:
        """Show another view of the same sweeps; while they are loading, remember it."""
        self.remove_class("-table")
        if self.compared is None and self.app.marks:
            self.view = view
        await self._show(view)

    def action_table(self) -> None:
        """Show the table of differences, or the plots; side by side if there is room."""
        if self.compared is None:
            return
        self.toggle_class("-beside" if self.has_class("-wide") else "-table")
        table = self.query_one(DifferenceTable)
        self.set_focus(table if self.has_class("-table") and not self.has_class("-wide") else None)
        self.call_after_refresh(self.show_view)

    def action_back(self) -> None:
        """Close the table, then the sweeps of one curve, then the screen."""
        if self.has_class("-table") and not self.has_class("-wide"):
            self.action_table()
        elif self._opened:
            self._opened = []
            self._reload_all()
        else:
            super().action_back()

    async def action_reference(self) -> None:
        """Use the focused curve as the reference of differences."""
        if self.compared is None:
            return
        self.first = self.stack.view_range.focus
        await self._show("difference")

    async def action_group(self) -> None:
        """Show the next group that can be shown: responses in another unit, or curves of another kind."""
        groups = self.compared.groups(self.view) if self.compared else []
        at = groups.index(self.group) if self.group in groups else 0
        for group in groups[at + 1 :] + groups[:at]:
            if await self._show(self.view, group):
                break

    def action_unmark(self) -> None:
        """Remove the marks of the focused curve's sweeps."""
        self.app.marks.remove(self._focused_keys())
        self.reload()

    def _focused_keys(self) -> list[str]:
        focus = self.stack.view_range.focus
        known = self.compared is not None and 0 <= focus < len(self.compared.curves)
        return self.compared.keys_of([focus]) if known and self.compared else []

    def action_open(self) -> None:
        """Open the focused sweep, or the sweeps of the focused curve."""
        from fraexp.tui.screens.sweep_page import SweepPage

        keys = self._focused_keys()
        if len(keys) == 1:
            self.app.push_screen(SweepPage(keys[0]))
        elif keys:
            self._opened = keys
            self._reload_all()

    def _reload_all(self) -> None:
        self._gathered = None
        self.stack.view_range.hidden, self.stack.view_range.focus, self.first = set(), 0, None
        self.reload()

    @work(group=ACTION_GROUP)
    async def action_group_by(self) -> None:
        """Ask for the labels that make groups."""
        if self.compared is None or self._opened:
            return
        offered = self.compared.varying_labels()
        if not offered:
            self.app.notify("these sweeps have one group: they share all labels of the grid")
            return
        by = await self.app.push_screen_wait(GroupingDialog(offered, self._by))
        if by is not None and self._gathered is not None:
            self._by = by
            self.run_worker(self._compare(self._gathered), group=LOAD_GROUP)

    @work(group=ACTION_GROUP)
    async def action_export(self) -> None:
        """Export the visible curves as a figure by ``fraexp plot``."""
        if self.compared is None or self.stack.picture is None:
            return
        keys, named = self._named_by(self.compared, tuple(self._visible_places()))
        export = self._export(len(keys), named, self.stack.picture)
        file = await export.ask(self.app, self._file())
        if file is not None:
            self.run_worker(export.draw(self.app, file), group="export")

    @property
    def stack(self) -> PlotStack:
        """The plots."""
        return self.query_one(PlotStack)

    def rows(self, labels: Mapping[int, str]) -> int:
        """Return the number of rows of the readout."""
        return min(
            len(labels), max(MIN_READOUT_ROWS, self.size.height // 4) if self.size.height >= MIN_HIGH_ROWS else 1
        )

    def hints(self, labels: Mapping[int, str]) -> list[str]:
        """Return hints on hidden curves and panels, with the keys that show them."""
        stack = self.stack
        before, after = stack.beyond()
        keys = [key for count, key in ((before, "page up"), (after, "page down")) if count]
        hints = [f"{plural(before + after, 'more panel')}: {', '.join(keys)}"] if keys else []
        if labels and stack.view_range.hidden >= labels.keys():
            hints.append("all curves are hidden: 0 shows them")
        if self.rows(labels) < len(labels):
            hints.append(f"{self.rows(labels)} of {len(labels)} curves listed: up, down")
        if max(labels, default=0) >= MAX_DIGIT_KEYS:
            hints.append(". hides or shows the focused curve")
        return hints

    def show_readout(self) -> None:
        """Show the values at the cursor, those of visible panels first."""
        labels, stack = self.labels(), self.stack
        if not labels or stack.picture is None:
            return
        place, rows = self.query_one("#readout", Static), self.rows(labels)
        if place.styles.height is None or place.styles.height.value != rows:
            place.styles.height = rows
        columns = place.content_size.width or self.size.width - 2
        panels = stack.picture.panels
        picture = replace(stack.picture, panels=panels[stack.first :] + panels[: stack.first])
        place.update(readout(picture, labels, stack.view_range, stack.curve_styles, (columns, rows)), layout=False)

    @on(PlotStack.Moved)
    def _handle_move(self) -> None:
        self.show_readout()

    @on(PlotStack.Fitted)
    def _handle_fit(self) -> None:
        self.show_view()

    @on(Click, "#readout")
    def _handle_click(self, event: Click) -> None:
        """Focus the curve of the clicked line; a second click hides or shows it."""
        shown = str(self.query_one("#readout", Static).content).splitlines()
        if 0 <= event.y < len(shown):
            labels = self.labels()
            sign = shown[event.y][1:2]
            of = next(
                (of for of in labels if (sign == " ") == (of == REFERENCE) and sign in (curve_digit(of), " ")), None
            )
            if of is not None and of == self.stack.view_range.focus:
                self._toggle(of)
            elif of is not None:
                self._focus(of)

    def action_curve(self, place: int) -> None:
        """Hide or show a curve."""
        if place in self.labels():
            self._toggle(place)

    def _toggle(self, place: int) -> None:
        self.stack.view_range.hidden ^= {place}
        self._redraw()

    def action_hide(self) -> None:
        """Hide or show the focused curve, also beyond the digit keys."""
        if self.stack.view_range.focus in self.labels():
            self._toggle(self.stack.view_range.focus)

    def action_all(self) -> None:
        """Show all curves."""
        self.stack.view_range.hidden = set()
        self._redraw()

    def action_focus_curve(self, by: int) -> None:
        """Focus the next curve."""
        places = list(self.labels())
        at = places.index(self.stack.view_range.focus) if self.stack.view_range.focus in places else 0
        if places:
            self._focus(places[(at + by) % len(places)])

    def _focus(self, place: int) -> None:
        self.stack.view_range.focus = place
        self._redraw()

    def action_step(self, columns: int) -> None:
        """Move the cursor."""
        self.stack.step(columns)

    def action_zoom(self, x: bool, y: bool, closer: bool) -> None:
        """Zoom."""
        factor = ZOOM_FACTOR if closer else 1 / ZOOM_FACTOR
        self.stack.zoom(factor if x else 1.0, factor if y else 1.0)
        self.show_view()

    def action_pan(self, x: int, y: int) -> None:
        """Move the visible range."""
        self.stack.pan(PAN_FRACTION * x, PAN_FRACTION * y)
        self.show_view()

    def action_home(self) -> None:
        """Show all again."""
        self.stack.home()
        self.show_view()

    def action_panels(self, by: int) -> None:
        """Show other panels."""
        self.stack.turn(by)
        self.show_view()

    def action_bands(self) -> None:
        """Show or hide 95 % limits."""
        self.stack.view_range.bands ^= True
        self.stack.draw()

    def action_wrap(self) -> None:
        """Wrap or unwrap the phase."""
        self.stack.view_range.wrapped ^= True
        self._redraw()

    def _redraw(self) -> None:
        self.stack.draw()
        self.show_view()
