"""Fitting a table into a terminal: titles and texts are folded, then columns move below; no number is ever cut."""

from collections.abc import Sequence

GAP = 2
"""Characters between two columns."""
WIDEST = 48
"""Widest column of text [characters] while others need the room."""
NARROWEST = 20
"""Columns of text are folded no narrower than this [characters]."""


def blocks(
    titles: Sequence[str], cells: Sequence[Sequence[str]], solid: Sequence[bool], available: int
) -> list[dict[int, int]]:
    """Return the columns of each block with their widths [characters]; the first column leads every block.

    `solid` columns hold numbers: their cells are never folded, so that they may be wider than what is `available`.
    """
    floors = [_floor(*column, available) for column in _columns(titles, cells, solid)]
    wishes = [max(floor, _wish(*column)) for floor, column in zip(floors, _columns(titles, cells, solid), strict=True)]
    found: list[list[int]] = [[0]]
    for index in range(1, len(titles)):
        if len(found[-1]) > 1 and _total([floors[i] for i in [*found[-1], index]]) > available:
            found.append([0])
        found[-1].append(index)
    return [_fitted({i: floors[i] for i in of}, {i: wishes[i] for i in of}, available) for of in found]


def _columns(
    titles: Sequence[str], cells: Sequence[Sequence[str]], solid: Sequence[bool]
) -> list[tuple[str, list[str], bool]]:
    return [(title, [row[index] for row in cells], solid[index]) for index, title in enumerate(titles)]


def _floor(title: str, column: list[str], solid: bool, available: int) -> int:
    words = max(map(len, title.split()), default=1)
    longest = max(map(len, column), default=0)
    if solid:
        return max(words, longest)
    pieces = max((len(word) for cell in column for word in cell.split()), default=0)
    return min(max(words, pieces, min(longest, NARROWEST)), max(available, 1))


def _wish(title: str, column: list[str], solid: bool) -> int:
    longest = max(map(len, column), default=0)
    return max(len(title), longest if solid else min(longest, WIDEST))


def _fitted(floors: dict[int, int], wishes: dict[int, int], available: int) -> dict[int, int]:
    """Return the widths: what is wished for, less what does not fit, taken where there is most to spare."""
    widths = dict(wishes)
    while _total(list(widths.values())) > available:
        loosest = max(widths, key=lambda index: widths[index] - floors[index])
        if widths[loosest] == floors[loosest]:
            break
        widths[loosest] -= 1
    return widths


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + GAP * (len(widths) - 1)
