"""A listing of sweeps: its columns, how they fit into a width, and what it can be sorted by."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

from rich.cells import cell_len

from fraexp.data.sweep import DRAW
from fraexp.data.texts import printable
from fraexp.errors import FraexpError, did_you_mean
from fraexp.figures.elements.labels import label_columns, label_texts
from fraexp.store import StoredSweep
from fraexp.views.fields import sweep_units
from fraexp.views.words import duration_text, scale_values, short_key, with_unit

if TYPE_CHECKING:
    from fraexp.components.registry import Registry

COLUMN_GAP = 2
"""Cells between two columns."""
LABELS_WITH_COLUMN = ("estimator", "estimator.name", "friction", "friction.name")
"""Labels that have a column of their own."""
COLUMN_RANKS = {"message": 9, "took": 7, "friction": 6, "created": 5, "study": 4, "tags": 3, "estimator": 2}
"""The higher the rank, the sooner a column is dropped if not all fit."""
MAX_WIDTHS = {"message": 60, "tags": 24, "study": 28, "estimator": 28, "friction": 24}
"""Maximum widths of columns, by title."""
STRETCHED_COLUMNS = ("message",)
"""Columns that use the remaining width if they are last."""
MAX_COLUMN_WIDTH = 200
"""Maximum width of any other column."""
MIN_LABEL_WIDTH = 8
"""Width to which labels are cut if no other column can be dropped."""
MIN_LABEL_WIDTHS = {COLUMN_RANKS["created"]: 5 * MIN_LABEL_WIDTH, 1: 3 * MIN_LABEL_WIDTH}
"""Widths to which labels are cut before another column is dropped, by the least rank of the column."""


@dataclass(frozen=True)
class Column:
    """A column of a listing."""

    title: str
    cells: tuple[str, ...]
    order: str = ""
    """Field that sorts by it; empty if it cannot be sorted."""
    rank: int = 0
    """The higher, the sooner it is dropped; 0 is never dropped."""
    right_aligned: bool = False
    """Whether its cells are right-aligned, as numbers are."""
    max_width: int = MAX_COLUMN_WIDTH
    """Maximum width."""
    is_label: bool = False
    """Whether it shows a label of the sweeps: labels are cut or merged before another column is dropped."""
    unit: str = ""
    """Unit of its numbers, which its title contains."""
    is_named: bool = False
    """Whether its values mean nothing without its title or a unit, as numbers do and names do not."""

    @property
    def width(self) -> int:
        """Wanted width in terminal cells."""
        return min(self.full_width, self.max_width)

    @property
    def full_width(self) -> int:
        """Width without cutting, in terminal cells."""
        return max(map(cell_len, (*self.title.splitlines(), *self.cells)), default=0)


def listing_columns(
    rows: Sequence[StoredSweep], *, one_run: bool, running: Mapping[str, float], registry: "Registry | None" = None
) -> list[Column]:
    """Return all columns with any content; `running` holds the finished fraction of running sweeps by key."""
    columns = [
        _column("sweep", [short_key(row.key) for row in rows], "key"),
        *([] if one_run else [_column("study", [_study_text(row) for row in rows], "study")]),
        *_label_columns(rows, sweep_units(rows, registry) if registry else {}),
        _column("estimator", _component_texts(rows, "estimator"), "estimator"),
        _column("friction", _component_texts(rows, "friction"), "friction"),
        _column("outcome", [state_text(row, running.get(row.key)) for row in rows], "outcome"),
        _column("tags", [" ".join(row.tags) for row in rows]),
        _column("created", [time_text(row.created) for row in rows], "created"),
        _column("took", [duration_text(row.elapsed) if row.created else "" for row in rows], "elapsed"),
        _column("message", [row.message for row in rows], "message"),
    ]
    return [column for column in columns if any(column.cells) or not rows]


def fit_columns(columns: Sequence[Column], width: int) -> list[tuple[Column, int]]:
    """Return the columns that fit, each with its width; others are dropped or cut."""
    kept = [(column, column.width) for column in columns]
    labels = [column for column, _ in kept if column.is_label or column.title == "estimator"]
    if len(labels) > 1 and _total_width([pair for pair in kept if pair[0].rank < COLUMN_RANKS["friction"]]) > width:
        together = _merge_labels(labels)
        at = next(index for index, (column, _) in enumerate(kept) if column in labels)
        kept = [pair for pair in kept if pair[0] not in labels]
        kept.insert(at, (together, together.width))
    while _total_width(kept) > width:
        cut = max((pair for pair in kept if pair[0].is_label), key=lambda pair: pair[1], default=None)
        least = max((pair for pair in kept if pair[0].rank), key=lambda pair: pair[0].rank, default=None)
        over = _total_width(kept) - width
        wanted = next((MIN_LABEL_WIDTHS[rank] for rank in MIN_LABEL_WIDTHS if least and least[0].rank >= rank), 0)
        if cut and cut[1] - over >= (wanted or MIN_LABEL_WIDTH):
            kept[kept.index(cut)] = (cut[0], cut[1] - over)
        elif least and least[0].title in STRETCHED_COLUMNS and least[1] - over >= 2 * MIN_LABEL_WIDTH:
            kept[kept.index(least)] = (least[0], least[1] - over)
        elif least:
            kept.remove(least)
        else:
            break
    spare = width - _total_width(kept)
    return [
        (of, min(of.full_width, room + spare) if of.title in STRETCHED_COLUMNS and of is kept[-1][0] else room)
        for of, room in kept
    ]


def state_text(row: StoredSweep, fraction: float | None = None) -> str:
    """Return the state of a sweep: its outcome, unless the attempt failed or is pending."""
    if fraction is not None:
        return f"running {100 * fraction:.0f} %"
    if row.state in ("pending", "failed"):
        return row.state
    if row.outcome is None:  # it was damaged, and merging left it out
        return "no result"
    return row.outcome.words


def time_text(time: datetime | None) -> str:
    """Return a time in short: the time of day if it is today, else the date."""
    if time is None:
        return ""
    local = time.astimezone()
    return local.strftime("%H:%M:%S" if local.date() == datetime.now().astimezone().date() else "%Y-%m-%d")


def _column(title: str, cells: Sequence[str], order: str = "") -> Column:
    return Column(
        title,
        tuple(map(printable, cells)),
        order,
        COLUMN_RANKS.get(title, 0),
        title == "took",
        MAX_WIDTHS.get(title, MAX_COLUMN_WIDTH),
    )


def _study_text(row: StoredSweep) -> str:
    return f"{row.study} {row.run}" if row.run is not None else ""


def _component_texts(rows: Sequence[StoredSweep], kind: str) -> list[str]:
    """Return the name of a component, with the labels that distinguish it from others of its name."""
    return label_texts([row.labels.get(kind) or row.component(kind) for row in rows])


def _label_columns(rows: Sequence[StoredSweep], units: Mapping[str, str]) -> list[Column]:
    labels = [{path: value for path, value in row.labels.items() if path not in LABELS_WITH_COLUMN} for row in rows]
    columns = []
    for path, title in label_columns(labels).items():
        values = [of.get(path) for of in labels]
        right = all(isinstance(value, int | float | None) for value in values)
        has_texts = any(isinstance(value, str) for value in values)  # such as 10 nm, which name their unit themselves
        scaled, unit = scale_values(values, "" if has_texts else units.get(path, ""))
        cells = tuple(map(printable, label_texts(scaled)))
        named = not any(isinstance(value, str | Mapping) for value in values)
        heading = with_unit(title, f"[{unit}]" if unit else "")
        columns.append(Column(heading, cells, path, 0, right, is_label=True, unit=unit, is_named=named))
    return columns


def _merge_labels(labels: Sequence[Column]) -> Column:
    """Return one column for all labels: a number needs no title if no other one has its unit."""
    drawn = next((index for index, column in enumerate(labels) if column.order == DRAW), len(labels))
    labels = sorted(labels, key=lambda column: column in labels[drawn:] and column.is_label)  # random values come last
    counts = Counter(column.unit for column in labels)
    cells = [
        ", ".join(_label_part(column, text, counts) for column in labels if (text := column.cells[index]))
        for index in range(len(labels[0].cells))
    ]
    return Column("labels", tuple(cells), is_label=True)


def _label_part(column: Column, text: str, counts: Mapping[str, int]) -> str:
    is_named = column.is_named and (not column.unit or counts[column.unit] > 1)
    return with_unit(f"{column.title.partition(' [')[0]} {text}" if is_named else text, column.unit)


def _total_width(columns: Sequence[tuple[Column, int]]) -> int:
    return sum(width + COLUMN_GAP for _, width in columns)


HEADINGS = {"sweep": "key", "took": "elapsed"}
"""Headings of a listing of sweeps that are not the name of their field."""


def complete_field(
    wanted: str, fields: Collection[str], headings: Mapping[str, str] = HEADINGS, place: str = "list: --sort"
) -> str:
    """Return the field that a name stands for, with the ``-`` of descending order that it may begin with.

    The name is a field, a heading, the last part of a field, or the beginning of one of them. FraexpError, which names
    the `place` of the input, otherwise.
    """
    sign, name = ("-", wanted[1:]) if wanted.startswith("-") else ("", wanted)
    columns = {field: field for field in fields if "." not in field} | dict(headings)
    whole = {**columns, **{field: field for field in fields}}
    if name in whole:
        return sign + whole[name]
    parts = [(field.rpartition(".")[2], field) for field in fields]
    tiers = (
        {field for part, field in parts if part == name},
        {field for title, field in columns.items() if name and title.startswith(name)},
        {field for part, field in parts if name and (part.startswith(name) or field.startswith(name))},
    )
    found = next((tier for tier in tiers if tier), set())
    if len(found) == 1:
        return sign + found.pop()
    if found:
        raise FraexpError(f"{place}: '{name}' is ambiguous; expected one of: {', '.join(sorted(found))}")
    raise FraexpError(f"{place}: there is no '{name}' to sort by{did_you_mean(name, [*fields, *headings])}")
