"""A listing of sweeps: its columns, and those of them that a width has room for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from rich.cells import cell_len

from fraexp.figures.elements.labels import label_columns, label_texts, printable
from fraexp.store import Listed, StoredSweep
from fraexp.views.words import duration, short

GAP = 2
"""Cells between two columns."""
SHOWN = ("estimator", "estimator.name", "friction", "friction.name")
"""Labels that have a column of their own."""
RANKS = {"message": 9, "note": 8, "took": 7, "friction": 6, "created": 5, "study": 4, "tags": 3, "estimator": 2}
"""The higher, the sooner a column is left out where there is no room for all."""
MOST = {"note": 40, "message": 60, "tags": 24, "study": 28, "estimator": 28, "friction": 24}
"""Widths beyond which a column is cut."""
LAST = ("message", "note")
"""Columns that take the room that is left if they are the last."""
WIDEST = 200
"""Width beyond which any column is cut."""
LEAST = 8
"""Width to which the labels, all in one column, are cut before another column is left out for them."""


@dataclass(frozen=True)
class Column:
    """A column of a listing."""

    title: str
    cells: tuple[str, ...]
    order: str = ""
    """Field that sorts by it; empty if none does."""
    rank: int = 0
    """The higher, the sooner it is left out; 0 stays."""
    right: bool = False
    """Whether its cells stand at the right: numbers."""
    most: int = WIDEST
    """Width beyond which it is cut."""

    @property
    def width(self) -> int:
        """Cells that it takes if there is room."""
        return min(self.uncut, self.most)

    @property
    def uncut(self) -> int:
        """Cells that all of it takes."""
        return max(map(cell_len, (*self.title.splitlines(), *self.cells)), default=0)


def listing_columns(rows: Sequence[Listed], *, one_run: bool, running: Mapping[str, float]) -> list[Column]:
    """Return all columns that have something to tell of sweeps; `running` has what is done of those that run."""
    columns = [
        _column("sweep", [short(row.key) for row in rows], "key"),
        *([] if one_run else [_column("study", [_study_text(row) for row in rows], "study")]),
        *_label_columns(rows),
        _column("estimator", _component_texts(rows, "estimator"), "estimator"),
        _column("friction", _component_texts(rows, "friction"), "friction"),
        _column("outcome", [state_text(row, running.get(row.key)) for row in rows], "outcome"),
        _column("tags", [" ".join(row.tags) for row in rows]),
        _column("created", [when(row.created) for row in rows], "created"),
        _column("took", [duration(row.elapsed) if row.created else "" for row in rows], "elapsed"),
        _column("message", [row.message for row in rows], "message"),
        _column("note", [row.note for row in rows], "note"),
    ]
    return [column for column in columns if any(column.cells) or not rows]


def fitted(columns: Sequence[Column], width: int) -> list[tuple[Column, int]]:
    """Return the columns for which there is room, each with its width; what does not fit is left out or cut."""
    kept = [(column, column.width) for column in columns]
    labels = [column for column, _ in kept if _is_label(column)]
    if len(labels) > 1 and _total([pair for pair in kept if pair[0].rank < RANKS["friction"]]) > width:
        together = _together(labels)
        at = next(index for index, (column, _) in enumerate(kept) if column in labels)
        kept = [pair for pair in kept if pair[0] not in labels]
        kept.insert(at, (together, together.width))
    while _total(kept) > width:
        cut = max((pair for pair in kept if _is_label(pair[0])), key=lambda pair: pair[1], default=None)
        least = max((pair for pair in kept if pair[0].rank), key=lambda pair: pair[0].rank, default=None)
        over = _total(kept) - width
        if cut and cut[1] - over >= (3 * LEAST if least else LEAST):
            kept[kept.index(cut)] = (cut[0], cut[1] - over)
        elif least and least[0].title in LAST and least[1] - over >= 2 * LEAST:
            kept[kept.index(least)] = (least[0], least[1] - over)
        elif least:
            kept.remove(least)
        else:
            break
    spare = width - _total(kept)
    return [(of, min(of.uncut, room + spare) if of.title in LAST and of is kept[-1][0] else room) for of, room in kept]


def state_text(row: Listed | StoredSweep, fraction: float | None = None) -> str:
    """Return how it stands with a sweep: its outcome, unless the attempt failed or is still to come."""
    if fraction is not None:
        return f"running {100 * fraction:.0f} %"
    if row.state in ("pending", "failed") or row.outcome is None:
        return row.state
    return row.outcome.name.lower().replace("_", " ")


def when(time: datetime | None) -> str:
    """Return a moment in short: the time if it is today, else the date."""
    if time is None:
        return ""
    local = time.astimezone()
    return local.strftime("%H:%M:%S" if local.date() == datetime.now().astimezone().date() else "%Y-%m-%d")


def _column(title: str, cells: Sequence[str], order: str = "") -> Column:
    return Column(
        title, tuple(map(printable, cells)), order, RANKS.get(title, 0), title == "took", MOST.get(title, WIDEST)
    )


def _study_text(row: Listed) -> str:
    return f"{row.study} {row.run}" if row.run is not None else ""


def _component_texts(rows: Sequence[Listed], kind: str) -> list[str]:
    """Return a component's name, with the parameters that tell it from others of its name if labels have them."""
    return label_texts([row.labels.get(kind) or getattr(row, kind) for row in rows])


def _label_columns(rows: Sequence[Listed]) -> list[Column]:
    labels = [{path: value for path, value in row.labels.items() if path not in SHOWN} for row in rows]
    columns = []
    for path, title in label_columns(labels).items():
        values = [of.get(path) for of in labels]
        right = all(isinstance(value, int | float | None) for value in values)
        columns.append(Column(title, tuple(map(printable, label_texts(values))), path, right=right))
    return columns


def _is_label(column: Column) -> bool:
    return not column.rank and column.order not in ("key", "outcome")


def _together(labels: Sequence[Column]) -> Column:
    """Return one column for all labels."""
    cells = [
        ", ".join(f"{column.title} {column.cells[index]}" for column in labels if column.cells[index])
        for index in range(len(labels[0].cells))
    ]
    return Column("labels", tuple(cells))


def _total(columns: Sequence[tuple[Column, int]]) -> int:
    return sum(width + GAP for _, width in columns)
