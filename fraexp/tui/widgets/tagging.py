"""Tags, deletion and undeletion, for all screens that show sweeps or runs."""

from collections.abc import Callable, Sequence
from typing import ClassVar

from textual import work
from textual.binding import Binding, BindingType

from fraexp.errors import FraexpError, StoreError
from fraexp.store import Store
from fraexp.store.queries.tags import check_tag
from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.tui.page import ACTION_GROUP, Page
from fraexp.views.deletion import deletion_text, hidden_text, sweep_loss_text
from fraexp.views.words import plural, short_key


class ChangingPage(Page):
    """A screen on which something can be changed in the database, and brought back after a deletion."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("u", "undelete", "undelete", show=False, tooltip="bring back what was deleted last")
    ]

    def action_undelete(self) -> None:
        """Bring back what was deleted last."""
        self.change(_undelete_last)

    @work(group="change")
    async def change(self, action: Callable[[Store], object], done: str = "", deleted: Sequence[str] = ()) -> None:
        """Change the database, and tell what was `done`, by default what `action` returns, or why nothing was."""
        try:
            answer = await self.wait_for(self.app.backend.write(action))
        except FraexpError as error:
            self.show_refusal(str(error))
            return
        self.app.notify(done or str(answer))
        self.app.marks.remove(deleted)
        self.show_header()
        self.handle_deletion() if deleted else self.reload()

    def handle_deletion(self) -> None:
        """Update the screen after sweeps were deleted."""
        self.reload()

    def show_refusal(self, text: str) -> None:
        """Show why something was not done."""
        self.app.notify(text, title="nothing was changed", severity="error", timeout=10)


def _undelete_last(store: Store) -> str:
    """Bring back the latest deletion of which something can come back, and return in words what did."""
    restored = store.undelete()
    if restored.runs or restored.keys:
        return f"{deletion_text(len(restored.runs), len(restored.keys))} brought back"
    return "nothing to bring back: the trash is empty, or its sweeps were computed again"


class TaggingPage(ChangingPage):
    """A screen with a sweep under the cursor; actions apply to the marked sweeps, if there are any."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("t", "tag", "tag", tooltip="tag the marked sweeps, or this one"),
        Binding("T", "tag(True)", "untag", show=False, tooltip="remove a tag from the marked sweeps, or this one"),
        Binding("D", "delete", "delete", show=False, tooltip="delete the marked sweeps, or this one"),
    ]

    def current(self) -> str | None:
        """Return the key of the sweep under the cursor."""
        raise NotImplementedError

    def selected_keys(self) -> list[str]:
        """Return the keys that an action applies to: the marked ones, or the one under the cursor."""
        current = self.current()
        return list(self.app.marks) or ([current] if current else [])

    def filter_text(self) -> str:
        """Return the filter of the list, which may hide marked sweeps; empty without one."""
        return ""

    @work(group=ACTION_GROUP)
    async def action_tag(self, removes: bool = False) -> None:
        """Add a tag to sweeps, or remove one."""
        keys, wanted = self.selected_keys(), self.filter_text()
        found = await self.read(lambda store: (store.tags(), hidden_text(store, keys, wanted)), self.show_refusal)
        if found is None or not keys:
            return
        known, hidden = found
        what, listed = f"{_sweeps_text(keys)}{hidden}", ", ".join(known)
        if removes and not known:
            self.app.notify("no sweep has a tag")
            return
        question = f"Tag for {what} (one word)?" + (f" Existing tags: {listed}." if known else "")
        question = f"Remove which tag from {what}? {listed}" if removes else question

        def fault(name: str) -> str:
            if not removes:
                return _tag_fault(name.strip())
            return "" if name.strip() in (*known, "") else f"no sweep has the tag '{name.strip()}'"

        answer = await self.app.push_screen_wait(InputDialog(question, check=fault, offered=known))
        name = (answer or "").strip()
        if name and removes:
            self.change(lambda store: store.untag(keys, name), f"{_sweeps_text(keys)}: tag {name} removed")
        elif name:
            self.change(lambda store: store.tag(keys, name), f"{_sweeps_text(keys)} tagged {name}")

    @work(group=ACTION_GROUP)
    async def action_delete(self) -> None:
        """Delete sweeps after confirmation."""
        keys, wanted = self.selected_keys(), self.filter_text()
        loss = await self.read(lambda store: sweep_loss_text(store, keys, wanted), self.show_refusal) if keys else None
        if loss is not None and await self.app.push_screen_wait(ConfirmDialog(f"Delete {loss}?")):
            done = f"{plural(len(keys), 'sweep')} deleted; u brings {'it' if len(keys) == 1 else 'them'} back"
            self.change(lambda store: store.delete(keys), done, keys)


def _tag_fault(name: str) -> str:
    try:
        check_tag(name)
    except StoreError as error:
        return str(error) if name else "expected a word"
    return ""


def _sweeps_text(keys: list[str]) -> str:
    return f"sweep {short_key(keys[0])}" if len(keys) == 1 else f"{len(keys):,} sweeps"
