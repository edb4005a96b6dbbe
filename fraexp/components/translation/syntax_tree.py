"""What a translated function consists of: a few kinds of expression and statement that C and Structured Text share."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Type = Literal["real", "int", "bool"]


@dataclass(frozen=True)
class Number:
    """A constant."""

    value: float | int | bool
    type: Type


@dataclass(frozen=True)
class Variable:
    """A local variable or a parameter."""

    name: str
    type: Type


@dataclass(frozen=True)
class Element:
    """An element of an array of real numbers: of a state or of a table of constants."""

    array: str
    index: "Expression"
    type: Type = "real"


@dataclass(frozen=True)
class Operation:
    """An operator of Python with one or two operands, such as ``+``, ``<=``, ``and`` or ``not``."""

    operator: str
    operands: "tuple[Expression, ...]"
    type: Type


@dataclass(frozen=True)
class LibraryCall:
    """A call of a function that both languages have or are given: `min`, `exp`, `choose`, `real`."""

    function: str
    arguments: "tuple[Expression, ...]"
    type: Type = "real"


@dataclass(frozen=True)
class FunctionCall:
    """A call of another translated function; arrays go to arrays by name."""

    function: "Function"
    arguments: "tuple[Expression, ...]"
    arrays: tuple[str, ...]
    type: Type = "real"


Expression = Number | Variable | Element | Operation | LibraryCall | FunctionCall


@dataclass(frozen=True)
class Assignment:
    """A value that a variable or an element of a state takes."""

    target: Variable | Element
    value: Expression


@dataclass(frozen=True)
class Branch:
    """An `if` with its `else`."""

    test: Expression
    body: "tuple[Statement, ...]"
    otherwise: "tuple[Statement, ...]"


@dataclass(frozen=True)
class CountingLoop:
    """A `for` over a range of whole numbers; `step` is not 0."""

    variable: Variable
    start: Expression
    stop: Expression
    step: int
    body: "tuple[Statement, ...]"


@dataclass(frozen=True)
class ReturnValue:
    """The end of a function."""

    value: Expression


@dataclass(frozen=True)
class LoopExit:
    """A `break` or a `continue`."""

    word: Literal["break", "continue"]


Statement = Assignment | Branch | CountingLoop | ReturnValue | LoopExit


@dataclass(eq=False)
class Function:
    """A function of numbers and arrays; its constants are part of it."""

    name: str
    summary: str
    """First line of its documentation."""
    parameters: tuple[Variable, ...]
    arrays: Mapping[str, int]
    """Sizes of the arrays that it is given and may write, by name."""
    tables: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Arrays of constants, by name."""
    variables: dict[str, Type] = field(default_factory=dict)
    """Types of its local variables."""
    body: tuple[Statement, ...] = ()
    type: Type = "real"
    calls: "list[Function]" = field(default_factory=list)
    """Functions that it calls, each once."""


def with_calls(functions: Iterable[Function]) -> list[Function]:
    """Return functions with all that they call, each once and before those that call it."""
    found: list[Function] = []
    for function in functions:
        found += [each for each in (*with_calls(function.calls), function) if each not in found]
    return found
