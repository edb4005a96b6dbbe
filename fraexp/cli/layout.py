"""Layout of a table on a terminal: titles and texts are folded, then columns move below; numbers are never cut."""

from collections.abc import Sequence

COLUMN_GAP = 2
"""Characters between two columns."""
MAX_TEXT_WIDTH = 48
"""Maximum width of a text column [characters] while others need the room."""
MIN_TEXT_WIDTH = 20
"""Minimum width to which a text column is folded [characters]."""


def column_blocks(
    titles: Sequence[str], cells: Sequence[Sequence[str]], solid: Sequence[bool], available: int
) -> list[dict[int, int]]:
    """Return the columns of each block with their widths [characters]; the first column leads every block.

    `solid` columns hold numbers: their cells are folded only if one and the first column are wider than `available`.
    """
    floors = [_min_width(*column, available) for column in _columns(titles, cells, solid)]
    wishes = [
        max(floor, _wanted_width(*column)) for floor, column in zip(floors, _columns(titles, cells, solid), strict=True)
    ]
    found: list[list[int]] = [[0]]
    for index in range(1, len(titles)):
        if len(found[-1]) > 1 and _total_width([floors[i] for i in [*found[-1], index]]) > available:
            found.append([0])
        found[-1].append(index)
    return [_fit_widths({i: floors[i] for i in of}, {i: wishes[i] for i in of}, available) for of in found]


def _columns(
    titles: Sequence[str], cells: Sequence[Sequence[str]], solid: Sequence[bool]
) -> list[tuple[str, list[str], bool]]:
    return [(title, [row[index] for row in cells], solid[index]) for index, title in enumerate(titles)]


def _min_width(title: str, column: list[str], solid: bool, available: int) -> int:
    words = max(map(len, title.split()), default=1)
    longest = max(map(len, column), default=0)
    if solid:
        return max(words, longest)
    pieces = max((len(word) for cell in column for word in cell.split()), default=0)
    return min(max(words, pieces, min(longest, MIN_TEXT_WIDTH)), max(available, 1))


def _wanted_width(title: str, column: list[str], solid: bool) -> int:
    longest = max(map(len, column), default=0)
    return max(len(title), longest if solid else min(longest, MAX_TEXT_WIDTH))


def _fit_widths(floors: dict[int, int], wishes: dict[int, int], available: int) -> dict[int, int]:
    """Return the wanted widths, reduced where there is most room until all columns fit."""
    widths = dict(wishes)
    while _total_width(list(widths.values())) > available:
        loosest = max(widths, key=lambda index: widths[index] - floors[index])
        if widths[loosest] == floors[loosest]:
            break
        widths[loosest] -= 1
    while _total_width(list(widths.values())) > available and max(widths.values()) > 1:
        widths[max(widths, key=lambda index: widths[index])] -= 1
    return widths


def _total_width(widths: Sequence[int]) -> int:
    return sum(widths) + COLUMN_GAP * (len(widths) - 1)
