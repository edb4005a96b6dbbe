"""Plugins: every component with its parameters, source and state; broken plugins come first."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container

from fraexp.components.kinds import FrictionModel
from fraexp.data.texts import printable
from fraexp.tui.services.plugin_watch import PluginsChanged
from fraexp.tui.widgets.filter_line import FilterLine, ListPage
from fraexp.tui.widgets.paged_table import ListTable
from fraexp.tui.widgets.text_section import TextSection
from fraexp.views.components import Offer, component_document, list_offers, parameter_row, usage_text
from fraexp.views.listing import Column
from fraexp.workspace.workspace_service import WorkspaceService

RECOUNT_DELAY_S = 3.0
"""Seconds from a change of the database, which others may follow, until stored sweeps are counted again."""
PREVIEW_PARAGRAPHS = 2
"""Paragraphs of a component's description shown beside the list."""
SourceCounts = Mapping[str, Mapping[str, int]]


def _load_offers(workspace: WorkspaceService) -> list[Offer]:
    found = list_offers(workspace.registry)
    for offer in found:
        if offer.provider:
            _ = offer.provider.source_hash  # reads the file in this thread, not while keys wait
    return found


HEADS = [
    Column("kind", (), "key"),
    Column("name", (), "key"),
    Column("v", (), rank=3),
    Column("state", (), rank=1),
    Column("from", (), rank=2, max_width=30),
]
"""Columns of the components."""


def description(offer: Offer, sources: SourceCounts, most: int | None = None) -> RenderableType:
    """Return what there is to know of a component: the first paragraphs alone, or all."""
    head = Text(printable(f"{offer.kind} {offer.name}"), style="bold")
    head.append(printable(f"  version {offer.version}, {offer.origin}" if offer.version else f"  {offer.origin}"))
    lines: list[RenderableType] = [head]
    if offer.reason:
        lines.append(Text(printable(f"broken: {offer.reason}"), style="bold"))
    if offer.provider is None:
        return Group(*lines, Text("\nThe file is reloaded when it is saved."))
    lines += [Text(printable(part)) for part in offer.provider.paragraphs[:most]]
    document = component_document(offer.provider)
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for title in ("parameter", "unit", "default", "bounds", "meaning"):
        table.add_column(title)
    for parameter in document["parameters"]:
        table.add_row(*(Text(printable(cell.strip())) for cell in parameter_row(parameter)))
    lines += [Text(), table] if document["parameters"] else []
    presets = ", ".join(offer.provider.component.presets)
    lines += [Text(), Text(printable(f"presets: {presets}"))] if presets else []
    lines += [
        Text(f"\n{usage_text(*offer.uses(sources))}"),
        Text(printable(f"file: {offer.provider.file}"), style="dim"),
    ]
    return Group(*lines)


class PluginsPage(ListPage[Offer]):
    """The list of plugins."""

    PLACE: ClassVar[str] = "plugins"
    AUTO_FOCUS: ClassVar[str | None] = "ListTable"
    HELP: ClassVar[str] = """
Studies are made of components: friction models, plants, controllers, excitations, estimators, and readers of
records. fraexp provides many; a Python file in plugins/ adds your own (fraexp new friction NAME creates one).
Files are reloaded when they change. Broken plugins come first, with the reason.
"stale" counts stored sweeps that were computed with a different source of the component.
Enter on a friction model opens a trial: force loop and describing function, updated as you edit its parameters.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("d", "scroll(1)", "", show=False, tooltip="scroll the description down"),
        Binding("u", "scroll(-1)", "", show=False, tooltip="scroll the description up"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self.sources: SourceCounts = {}
        self._later = False
        self._described: object = None

    def body(self) -> ComposeResult:
        """Show the filter, the list, and the description of the selected row."""
        self.command = "fraexp plugins"
        yield FilterLine("words, such as: friction stribeck")
        with Container(id="split"):
            yield ListTable("", HEADS, self._cells, lambda offer: f"{offer.kind} {offer.name} {offer.origin}")
            yield TextSection(id="detail")

    def on_mount(self) -> None:
        """Show that plugins are being loaded."""
        self.show_notice("loading plugins ...")

    async def load(self) -> None:
        """Load the components, then how often they were used."""
        found = await self.compute(_load_offers)
        if found is None:
            return
        self.items = found
        self.show_notice()
        self.show()
        used = await self.read(lambda store: store.sources(), lambda _: None)
        self.sources = used or {}  # empty without a database
        self.show()

    def follow(self, changed: bool) -> None:
        """Count again after a delay, not at each sweep of a run."""
        if changed and not self._later:
            self._later = True
            self.set_timer(RECOUNT_DELAY_S, self._reload_later)

    def _reload_later(self) -> None:
        self._later = False
        self.reload()

    @on(PluginsChanged)
    def _handle_reload(self) -> None:
        self.reload()

    def texts(self, item: Offer) -> Sequence[str]:
        """Return the text of a component in which the filter looks for words."""
        meaning = " ".join(item.provider.paragraphs[:1]) if item.provider else ""
        return (f"{item.kind} {item.name} {item.origin} {item.reason} {meaning}",)

    def _cells(self, offer: Offer) -> list[str]:
        return [offer.kind, offer.name, offer.version, offer.state(self.sources), offer.origin]

    def show(self) -> None:
        """Show the components that match the filter, and how many of them are broken."""
        super().show()
        broken = sum(bool(offer.reason) for offer in self.table.items or ())
        self.table.note = f"{broken} broken" if broken else ""
        if self.items and not self.table.items:
            self._described = None
            self.query_one(TextSection).show_parts("No component matches; Esc clears the filter.")

    def preview(self, item: Offer) -> None:
        """Show what there is to know of a component."""
        most = None if self.has_class("-whole") else PREVIEW_PARAGRAPHS
        shown = item, item.uses(self.sources), most
        if shown != self._described:  # an update lays out the whole screen
            self._described = shown
            self.query_one(TextSection).show_parts(description(item, self.sources, most))

    def open(self, item: Offer) -> None:
        """Open the trial of a friction model, or the description of any other component."""
        if item.kind == FrictionModel.kind and not item.reason:
            from fraexp.tui.screens.trial_page import TrialPage

            self.app.push_screen(TrialPage(item.name))
        else:
            self._show_whole(item, True)

    def _show_whole(self, item: Offer, is_whole: bool) -> None:
        """Show all of the description in place of the list, or both."""
        self.set_class(is_whole, "-whole")
        named = f"{item.name} --kind {item.kind}" if item.provider else f"plugins/{item.name}"
        self.heading = f"{item.kind} {item.name}" if is_whole else ""
        self.command = f"fraexp check {named}" if is_whole else "fraexp plugins"
        self.preview(item)
        self.query_one(TextSection).scroll_home(animate=False)
        self.query_one(TextSection if is_whole else ListTable).focus()

    def action_back(self) -> None:
        """Show the list again, or go back."""
        if self.has_class("-whole") and self.item is not None:
            self._show_whole(self.item, False)
        else:
            super().action_back()

    def action_scroll(self, lines: int) -> None:
        """Scroll the description."""
        self.query_one(TextSection).scroll_relative(y=lines * 3, animate=False)
