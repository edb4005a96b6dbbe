"""Tags, notes and deletion of sweeps, on whatever screen shows them."""

from collections.abc import Callable
from typing import Any, ClassVar

from textual.binding import Binding, BindingType

from fraexp.errors import StoreError
from fraexp.store import Store
from fraexp.store.queries.annotations import check_tag
from fraexp.tui.dialogs import Ask, Confirm
from fraexp.tui.page import Page
from fraexp.views.deletion import loss_of_sweeps
from fraexp.views.words import plural, short


class CuratingPage(Page):
    """A screen with a sweep under the cursor; marked ones come first where several can be meant."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("t", "tag", "tag", id="tag", tooltip="give the marked sweeps, or this one, a tag"),
        Binding("T", "untag", "untag", show=False, id="untag", tooltip="take a tag from the marked, or this one"),
        Binding("n", "note", "note", id="note", tooltip="write a note on this sweep"),
        Binding("D", "delete", "delete", show=False, id="delete", tooltip="delete the marked sweeps, or this one"),
    ]

    def current(self) -> str | None:
        """Return the key of the sweep under the cursor."""
        raise NotImplementedError

    def chosen(self) -> list[str]:
        """Return the keys that an action is about: the marked ones, or the one under the cursor."""
        current = self.current()
        return list(self.app.marks) or ([current] if current else [])

    def gone(self) -> None:
        """Go on after sweeps have been deleted."""
        self.reload()

    async def action_tag(self) -> None:
        """Give sweeps a tag."""
        keys = self.chosen()
        known = await self._asked(lambda store: store.tags()) if keys else None
        if known is None:
            return
        used = f" Used so far: {', '.join(known)}." if known else ""
        question = f"Tag {_named(keys)} with which word?{used}"

        def answered(name: str | None) -> None:
            if name:
                self._change(lambda store: store.tag(keys, name.strip()), f"{_named(keys)} tagged {name.strip()}")

        self.app.push_screen(Ask(question, check=_tag_fault, offered=known), answered)

    async def action_untag(self) -> None:
        """Take a tag from sweeps."""
        keys = self.chosen()
        known = await self._asked(lambda store: store.tags()) if keys else None
        if known is None:
            return
        if not known:
            self.app.notify("no sweep has a tag")
            return

        def fault(name: str) -> str:
            return "" if name.strip() in known or not name.strip() else f"no sweep has the tag '{name.strip()}'"

        def answered(name: str | None) -> None:
            if name and name.strip():
                done = f"{_named(keys)}: {name.strip()} taken away"
                self._change(lambda store: store.untag(keys, name.strip()), done)

        self.app.push_screen(
            Ask(f"Take which tag from {_named(keys)}? {', '.join(known)}", check=fault, offered=known), answered
        )

    async def action_note(self) -> None:
        """Write a note on the sweep under the cursor."""
        key = self.current()
        before = await self._asked(lambda store: store.note(key)) if key else None
        if key is None or before is None:
            return

        def answered(text: str | None) -> None:
            if text is not None and text != before:
                self._change(lambda store: store.annotate(key, text), f"{short(key)}: {text or 'note taken away'}")

        self.app.push_screen(Ask(f"Note on sweep {short(key)} (empty: none)", before), answered)

    async def action_delete(self) -> None:
        """Delete sweeps, if that is confirmed."""
        keys = self.chosen()
        loss = await self._asked(lambda store: loss_of_sweeps(store, keys)) if keys else None
        if loss is None:
            return

        def answered(yes: bool | None) -> None:
            if yes:
                self._change(lambda store: store.delete_sweeps(keys), f"{plural(len(keys), 'sweep')} deleted", keys)

        self.app.push_screen(Confirm(f"Delete {loss}?"), answered)

    async def _asked(self, question: Callable[[Store], Any]) -> Any:
        return await self.fetch(self.app.desk.read(question), self._tell_fault)

    def _change(self, action: Callable[[Store], Any], done: str, deleted: list[str] | None = None) -> None:
        async def change() -> None:
            faults: list[str] = []
            await self.fetch(self.app.desk.write(action), faults.append)
            if faults:
                self._tell_fault(faults[0])
                return
            self.app.notify(done, markup=False)
            if deleted is None:
                self.reload()
            else:
                self.app.marks.remove(deleted)
                self.head()
                self.gone()

        changing: Callable[[], object] = change
        self.run_worker(changing, group="change")

    def _tell_fault(self, text: str) -> None:
        self.app.notify(text, severity="error", markup=False, timeout=10)


def _tag_fault(name: str) -> str:
    try:
        check_tag(name.strip())
    except StoreError as error:
        return str(error) if name.strip() else "a word is needed"
    return ""


def _named(keys: list[str]) -> str:
    return f"sweep {short(keys[0])}" if len(keys) == 1 else f"{len(keys):,} sweeps"
