"""Arrays of MATLAB files with several sides: ``force(:,:,1,2)`` is a signal of one of them."""

import re
from pathlib import Path

import numpy as np

from fraexp.api import RecordError

INDEXED = re.compile(r"^(?P<name>.+?)\((?P<sides>[\d:,\s]+)\)$")


def split(column: str) -> tuple[str, tuple[str, ...]]:
    """Return the variable in a column's name, and what stands in parentheses behind it, if anything does."""
    found = INDEXED.match(column)
    if not found:
        return column, ()
    return found["name"].strip(), tuple(side.strip() for side in found["sides"].split(","))


def signal(path: Path, name: str, values: np.ndarray, sides: tuple[str, ...]) -> np.ndarray:
    """Return the signal that is left of an array when each side but one or two has a number, counted from 1.

    Of two sides left the longer one is time, the other one numbers its periods, which follow one another.
    """
    whole = values.reshape(values.shape + (1,) * (len(sides) - values.ndim))  # MATLAB drops last sides of 1
    here, index = 1, list[slice | int]()
    for place, side in enumerate(sides):
        length = whole.shape[place] if place < whole.ndim else 1
        if side != ":" and not (side.isdigit() and 1 <= int(side) <= length):
            raise RecordError(
                f"{path.name}: '{name}' is {shape_text(values)}; side {place + 1} in '({','.join(sides)})' is "
                f"'{side}', expected : or a number from 1 to {length}"
            )
        index.append(slice(None) if side == ":" else int(side) - 1)
        here += side == ":" and length > 1
    if len(sides) != whole.ndim or here > 3:
        raise RecordError(f"{path.name}: '{name}' is {shape_text(values)}; {how_to_name(name, values.shape)}")
    left = np.squeeze(whole[tuple(index)])
    if left.ndim == 2 and left.shape[0] < left.shape[1]:
        left = left.T
    return left.ravel(order="F")


def shape_text(values: np.ndarray) -> str:
    """Return the sides of an array as people write them."""
    return " x ".join(str(side) for side in values.shape)


def how_to_name(name: str, shape: tuple[int, ...]) -> str:
    """Return how a signal in an array of this shape is named."""
    if len(shape) == 2:
        return f"expected a vector: name a column, such as '{name}.1', or '{name}(:,:)' for periods one after another"
    longest = int(np.argmax(shape))
    second = next(place for place in range(len(shape)) if place != longest)
    example = ",".join(":" if place in (longest, second) else "1" for place in range(len(shape)))
    return f"expected samples and periods of one signal: number the other sides, such as '{name}({example})'"
