"""Plugins: every component with its parameters, its source and its state; what is broken stands first."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, VerticalScroll
from textual.css.query import NoMatches
from textual.widgets import DataTable, Input, Static

from fraexp.components.kinds import FrictionModel
from fraexp.figures.elements.labels import printable
from fraexp.tui.page import Changed, Page
from fraexp.tui.services.plugin_watch import PluginsChanged
from fraexp.tui.widgets.sweep_table import PagedTable, TableRows
from fraexp.views.components import Offer, component_document, offers, paragraphs, parameter_row, uses_text
from fraexp.views.listing import Column
from fraexp.workspace.workspace import Workspace

LATER = 3.0
"""Seconds after a change of the database in which others may follow, until stored sweeps are counted again."""
FIRST = 2
"""Paragraphs of a component's description beside the list."""
Sources = Mapping[str, Mapping[str, int]]


def _offers(workspace: Workspace) -> list[Offer]:
    found = offers(workspace.registry)
    for offer in found:
        if offer.supply:
            _ = offer.supply.source_hash  # reads the file, here and not while keys wait
    return found


class PluginTable(PagedTable):
    """Components and broken plugins that a filter lets through."""

    def __init__(self) -> None:
        super().__init__()
        self.offers: list[Offer] = []
        self.sources: Sources = {}

    async def ask(self, first: int, most: int) -> TableRows:
        """Return rows from a place on."""
        seen = self.offers[first : first + most]
        columns = [
            Column("kind", tuple(printable(of.kind) for of in seen), "key"),
            Column("name", tuple(printable(of.name) for of in seen), "key"),
            Column("v", tuple(printable(of.version) for of in seen), rank=3),
            Column("state", tuple(of.state(self.sources) for of in seen), rank=1),
            Column("from", tuple(printable(of.origin) for of in seen), rank=2, most=30),
        ]
        return TableRows(tuple(f"{of.kind} {of.name} {of.origin}" for of in seen), columns, len(self.offers))

    def is_marked(self, key: str) -> bool:
        """Nothing has a mark here."""
        return False

    def position(self) -> str:
        """Return what is seen, and how much is broken."""
        broken = sum(bool(of.reason) for of in self.offers)
        return f"{super().position()}, {broken} broken" if broken else super().position()

    @property
    def current(self) -> Offer | None:
        """What is under the cursor."""
        place = self._place()
        return self.offers[place] if 0 <= place < len(self.offers) else None


def described(offer: Offer, sources: Sources, most: int | None = None) -> RenderableType:
    """Return what there is to know of a component: the first paragraphs alone, or all."""
    head = Text(printable(f"{offer.kind} {offer.name}"), style="bold")
    head.append(printable(f"  version {offer.version}, {offer.origin}" if offer.version else f"  {offer.origin}"))
    lines: list[RenderableType] = [head]
    if offer.reason:
        lines.append(Text(printable(f"broken: {offer.reason}"), style="bold"))
    if offer.supply is None:
        return Group(*lines, Text("\nWhen the file is saved again it is loaded anew, here too."))
    lines += [Text(printable(part)) for part in paragraphs(offer.supply, most)]
    document = component_document(offer.supply)
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for title in ("parameter", "unit", "default", "bounds", "meaning"):
        table.add_column(title)
    for parameter in document["parameters"]:
        table.add_row(*(Text(printable(cell.strip())) for cell in parameter_row(parameter)))
    lines += [Text(), table] if document["parameters"] else []
    presets = ", ".join(offer.supply.component.presets)
    lines += [Text(), Text(printable(f"presets: {presets}"))] if presets else []
    lines += [Text(f"\n{uses_text(*offer.uses(sources))}"), Text(printable(f"file: {offer.supply.file}"), style="dim")]
    return Group(*lines)


class PluginsPage(Page):
    """What plugins offer."""

    PLACE: ClassVar[str] = "plugins"
    AUTO_FOCUS: ClassVar[str | None] = "PluginTable"
    HELP: ClassVar[str] = """
Components are what studies are made of: friction models, plants, controllers, excitations, estimators, and readers of
records. fraexp brings many; a Python file in the folder plugins/ adds yours (fraexp new friction NAME writes one).
Files are loaded anew when they change. What cannot be loaded is broken and stands first, with its reason.
"stale" counts stored sweeps that were computed when the component's source was another one.
Enter on a friction model tries it: force loop and describing function, as you change its parameters.
"""
    DEFAULT_CSS = """
    PluginsPage #filter { display: none; }
    PluginsPage #filter.-shown { display: block; }
    PluginsPage #split { layout: vertical; height: 1fr; }
    PluginsPage #detail { height: 45%; padding: 0 1; }
    PluginsPage.-wide #split { layout: horizontal; }
    PluginsPage.-wide PluginTable { width: 50%; }
    PluginsPage.-wide #detail { height: 1fr; width: 50%; border-left: solid $panel-lighten-2; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "filter", "filter", id="plugins.filter", tooltip="show what has these words alone"),
        Binding("d", "scroll(1)", "", show=False, id="plugins.down", tooltip="scroll the description down"),
        Binding("u", "scroll(-1)", "", show=False, id="plugins.up", tooltip="scroll the description up"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._all: list[Offer] = []
        self._later = False
        self._words: list[str] = []

    def body(self) -> ComposeResult:
        """Show a line for the filter, the list, and what is under its cursor."""
        self.command = "fraexp plugins"
        yield Input(placeholder="words, such as: friction stribeck", id="filter", compact=True)
        with Container(id="split"):
            yield PluginTable()
            yield VerticalScroll(Static(), id="detail", can_focus=False)

    def on_mount(self) -> None:
        """Tell why nothing is there yet."""
        self.tell("Looking for plugins ...")

    async def load(self) -> None:
        """Read what plugins offer, then how often it was used."""
        found = await self.fetch(self.app.desk.work(_offers))
        if found is None:
            return
        self._all = found
        self.tell()
        self._choose()
        used = await self.fetch(self.app.desk.read(lambda store: store.sources()), lambda _: None)
        self.query_one(PluginTable).sources = used or {}  # none without a database
        self._choose()

    def on_changed(self, event: Changed) -> None:
        """Count again soon: while a run writes, not at each sweep."""
        if event.data and not self._later:
            self._later = True
            self.set_timer(LATER, self._soon)

    def _soon(self) -> None:
        self._later = False
        self.reload()

    @on(PluginsChanged)
    def _loaded_anew(self) -> None:
        self.reload()

    def _choose(self) -> None:
        """Show what the filter lets through; from the top if it is another one."""
        words = self.query_one("#filter", Input).value.lower().split()
        anew, self._words = words != self._words, words
        table = self.query_one(PluginTable)
        table.offers = [of for of in self._all if all(word in _searched(of) for word in words)]
        table.restart() if anew else table.reload()
        self.call_after_refresh(self._describe)

    @on(DataTable.RowHighlighted)
    @on(PagedTable.Shown)
    def _describe(self) -> None:
        try:
            table, detail = self.query_one(PluginTable), self.query_one("#detail", VerticalScroll)
        except NoMatches:  # on the way out
            return
        offer = table.current
        nothing = Text("Nothing has these words; Esc takes the filter away." if self._all else "")
        detail.query_one(Static).update(described(offer, table.sources, FIRST) if offer else nothing)

    @on(DataTable.RowSelected)
    def _open(self, event: DataTable.RowSelected) -> None:
        event.stop()
        offer = self.query_one(PluginTable).current
        if offer is None:
            return
        if offer.kind == FrictionModel.kind and not offer.reason:
            from fraexp.tui.screens.trial_page import TrialPage

            self.app.push_screen(TrialPage(offer.name))
        else:
            self.app.push_screen(ComponentPage(offer, self.query_one(PluginTable).sources))

    @on(Input.Changed, "#filter")
    def _filtered(self) -> None:
        self._choose()

    @on(Input.Submitted, "#filter")
    def _to_the_list(self) -> None:
        self.query_one(PluginTable).focus()

    def action_filter(self) -> None:
        """Write a filter."""
        line = self.query_one("#filter", Input)
        line.add_class("-shown")
        line.focus()

    def action_back(self) -> None:
        """Take the filter away first."""
        line = self.query_one("#filter", Input)
        if line.has_class("-shown"):
            line.value = ""
            line.remove_class("-shown")
            self.query_one(PluginTable).focus()
        else:
            super().action_back()

    def action_scroll(self, lines: int) -> None:
        """Scroll the description."""
        self.query_one("#detail", VerticalScroll).scroll_relative(y=lines * 3, animate=False)


def _searched(offer: Offer) -> str:
    meaning = " ".join(paragraphs(offer.supply, 1)) if offer.supply else ""
    return f"{offer.kind} {offer.name} {offer.origin} {offer.reason} {meaning}".lower()


class ComponentPage(Page):
    """All that there is to know of one component."""

    PLACE: ClassVar[str] = "plugins"
    HELP: ClassVar[str] = "What a component is, in the words of its author, and its parameters."
    DEFAULT_CSS = "ComponentPage VerticalScroll { padding: 0 1; }"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("j", "scroll(1)", show=False, id="component.down", tooltip="scroll down"),
        Binding("k", "scroll(-1)", show=False, id="component.up", tooltip="scroll up"),
    ]

    def __init__(self, offer: Offer, sources: Sources) -> None:
        super().__init__()
        self._offer, self._sources = offer, sources

    def body(self) -> ComposeResult:
        """Show it."""
        yield VerticalScroll(Static())
        self._show()

    def _show(self) -> None:
        offer = self._offer
        self.heading = f"{offer.kind} {offer.name}"
        named = f"{offer.name} --kind {offer.kind}" if offer.supply else f"plugins/{offer.name}"
        self.command = f"fraexp check {named}"

    async def load(self) -> None:
        """Show it as it is now: its file may have been mended, broken or removed."""
        found = await self.fetch(self.app.desk.work(_offers))
        if found is None:
            return
        now = _same(self._offer, found)
        self.tell("" if now else "It is not there any more. Esc leads to the list.")
        self._offer = now or self._offer
        self._show()
        self.query_one(VerticalScroll).display = now is not None
        self.query_one(VerticalScroll).query_one(Static).update(described(self._offer, self._sources))

    @on(PluginsChanged)
    def _loaded_anew(self) -> None:
        self.reload()

    def action_scroll(self, lines: int) -> None:
        """Scroll by lines."""
        self.query_one(VerticalScroll).scroll_relative(y=lines, animate=False)


def _same(offer: Offer, found: Sequence[Offer]) -> Offer | None:
    """Return what has become of an offer: itself, what is in its file by now, or why that is broken."""
    file = offer.supply.file.name if offer.supply else offer.name

    def of_file(one: Offer) -> bool:
        return one.origin == f"plugins/{file}" if one.supply else one.name == file

    same = [one for one in found if (one.kind, one.name) == (offer.kind, offer.name)]
    return next((one for one in [*same, *filter(of_file, found)]), None)
