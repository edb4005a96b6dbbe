"""Tags, notes, deletion and undeletion, for all screens that show sweeps or runs."""

from collections.abc import Callable
from typing import Any, ClassVar

from textual.binding import Binding, BindingType

from fraexp.errors import StoreError
from fraexp.store import Store
from fraexp.store.queries.annotations import check_tag
from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.tui.page import Page
from fraexp.views.deletion import deletion_text, hidden_text, sweep_loss_text
from fraexp.views.words import plural, short_key


class UndeletingPage(Page):
    """A screen on which something can be deleted."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("u", "undelete", "undelete", show=False, tooltip="bring back what was deleted last"),
    ]

    async def action_undelete(self) -> None:
        """Bring back what was deleted last."""
        done = await self.fetch(self.app.backend.write(_undelete_last), self.show_refusal)
        if done is not None:
            self.app.notify(done)
            self.reload()

    def show_refusal(self, text: str) -> None:
        """Show why something was not done."""
        self.app.notify(text, title="nothing was changed", severity="error", markup=False, timeout=10)


def _undelete_last(store: Store) -> str:
    """Bring back the latest deletion of which something can come back, and return in words what did."""
    restored = store.undelete()
    if restored.runs or restored.keys:
        return f"{deletion_text(len(restored.runs), len(restored.keys))} brought back"
    return "nothing to bring back: the trash is empty, or its sweeps were computed again"


class TaggingPage(UndeletingPage):
    """A screen with a sweep under the cursor; actions apply to the marked sweeps, if there are any."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("t", "tag", "tag", tooltip="tag the marked sweeps, or this one"),
        Binding("T", "untag", "untag", show=False, tooltip="remove a tag from the marked sweeps, or this one"),
        Binding("n", "note", "note", tooltip="edit the note of this sweep"),
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

    def handle_deletion(self) -> None:
        """Update the screen after sweeps were deleted."""
        self.reload()

    async def action_tag(self) -> None:
        """Add a tag to sweeps."""
        keys, wanted = self.selected_keys(), self.filter_text()
        found = await self._ask_store(lambda store: (store.tags(), hidden_text(store, keys, wanted))) if keys else None
        if found is None:
            return
        known, hidden = found
        used = f" Existing tags: {', '.join(known)}." if known else ""
        question = f"Tag for {_sweeps_text(keys)}{hidden} (one word)?{used}"

        def apply_answer(name: str | None) -> None:
            if name:
                self._change(lambda store: store.tag(keys, name.strip()), f"{_sweeps_text(keys)} tagged {name.strip()}")

        self.app.push_screen(InputDialog(question, check=_tag_fault, offered=known), apply_answer)

    async def action_untag(self) -> None:
        """Remove a tag from sweeps."""
        keys, wanted = self.selected_keys(), self.filter_text()
        found = await self._ask_store(lambda store: (store.tags(), hidden_text(store, keys, wanted))) if keys else None
        if found is None:
            return
        known, hidden = found
        if not known:
            self.app.notify("no sweep has a tag")
            return

        def fault(name: str) -> str:
            return "" if name.strip() in known or not name.strip() else f"no sweep has the tag '{name.strip()}'"

        def apply_answer(name: str | None) -> None:
            if name and name.strip():
                done = f"{_sweeps_text(keys)}: tag {name.strip()} removed"
                self._change(lambda store: store.untag(keys, name.strip()), done)

        question = f"Remove which tag from {_sweeps_text(keys)}{hidden}? {', '.join(known)}"
        self.app.push_screen(InputDialog(question, check=fault, offered=known), apply_answer)

    async def action_note(self) -> None:
        """Edit the note of the sweep under the cursor."""
        key = self.current()
        before = await self._ask_store(lambda store: store.note(key)) if key else None
        if key is None or before is None:
            return

        def apply_answer(text: str | None) -> None:
            if text is not None and text != before:
                self._change(lambda store: store.annotate(key, text), f"{short_key(key)}: {text or 'note removed'}")

        self.app.push_screen(InputDialog(f"Note on sweep {short_key(key)} (empty: remove)", before), apply_answer)

    async def action_delete(self) -> None:
        """Delete sweeps after confirmation."""
        keys, wanted = self.selected_keys(), self.filter_text()
        loss = await self._ask_store(lambda store: sweep_loss_text(store, keys, wanted)) if keys else None
        if loss is None:
            return

        def apply_answer(yes: bool | None) -> None:
            if yes:
                done = f"{plural(len(keys), 'sweep')} deleted; u brings {'it' if len(keys) == 1 else 'them'} back"
                self._change(lambda store: store.delete(keys), done, keys)

        self.app.push_screen(ConfirmDialog(f"Delete {loss}?"), apply_answer)

    async def _ask_store(self, question: Callable[[Store], Any]) -> Any:
        return await self.fetch(self.app.backend.read(question), self.show_refusal)

    def _change(self, action: Callable[[Store], Any], done: str, deleted: list[str] | None = None) -> None:
        async def change() -> None:
            faults: list[str] = []
            await self.fetch(self.app.backend.write(action), faults.append)
            if faults:
                self.show_refusal(faults[0])
                return
            self.app.notify(done, markup=False)
            if deleted is None:
                self.reload()
            else:
                self.app.marks.remove(deleted)
                self.show_header()
                self.handle_deletion()

        changing: Callable[[], object] = change
        self.run_worker(changing, group="change")


def _tag_fault(name: str) -> str:
    try:
        check_tag(name.strip())
    except StoreError as error:
        return str(error) if name.strip() else "expected a word"
    return ""


def _sweeps_text(keys: list[str]) -> str:
    return f"sweep {short_key(keys[0])}" if len(keys) == 1 else f"{len(keys):,} sweeps"
