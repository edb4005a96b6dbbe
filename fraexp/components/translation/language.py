"""What a language needs for a translated function: its expressions, statements and names."""

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, count
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Type = Literal["real", "int", "bool"]


class Constant(NamedTuple):
    """A constant."""

    value: float | int | bool
    type: Type


class Variable(NamedTuple):
    """A local variable or a parameter, by its name in Python."""

    name: str
    type: Type


class Text(NamedTuple):
    """Any other expression, in the language."""

    text: str
    type: Type
    is_compound: bool = False
    """Whether it needs parentheses as an operand."""


Expression = Constant | Variable | Text


@dataclass(eq=False)
class Function:
    """A function of numbers and arrays in a language; its constants are part of it."""

    name: str
    summary: str
    """First line of its documentation."""
    parameters: tuple[Variable, ...] = ()
    arrays: Mapping[str, int] = field(default_factory=dict)
    """Sizes of the arrays that it is given and may write, by name."""
    tables: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Arrays of constants, by name."""
    variables: dict[str, Type] = field(default_factory=dict)
    """Types of its local variables."""
    calls: "list[Function]" = field(default_factory=list)
    """Functions that it calls, each once."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Names in the language of what it declares."""
    body: list[str] = field(default_factory=list)
    """Lines of its statements."""

    @property
    def all_tables(self) -> dict[str, NDArray[np.float64]]:
        """The tables that it and those that it calls use, by a name that no other table has."""
        return {f"{each.name}_{name}": table for each in with_calls([self]) for name, table in each.tables.items()}


def with_calls(functions: Iterable[Function]) -> list[Function]:
    """Return functions with all that they call, each once and before those that call it."""
    found: list[Function] = []
    for function in functions:
        found += [each for each in (*with_calls(function.calls), function) if each not in found]
    return found


class Language(ABC):
    """Prints what functions consist of; the names of all functions begin with a prefix."""

    operators: ClassVar[Mapping[str, str]]
    """Operators that are written otherwise than in Python."""
    math_names: ClassVar[Mapping[str, str]]
    """Functions of mathematics that are called otherwise than in Python."""
    statements: ClassVar[Mapping[str, str]]
    """How statements are written, by ``=``, ``if``, ``else``, ``end if``, ``break`` and ``continue``."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    @abstractmethod
    def declared_names(self, function: Function) -> dict[str, str]:
        """Return the names in the language of all that a function declares, by their names in Python."""

    @abstractmethod
    def type_name(self, kind: Type) -> str:
        """Return the type of a variable."""

    @abstractmethod
    def number(self, number: Constant) -> str:
        """Return a constant."""

    def text(self, function: Function, expression: Expression) -> str:
        """Return an expression of a function."""
        if isinstance(expression, Text):
            return expression.text
        if isinstance(expression, Constant):
            return self.number(expression)
        return function.names.get(expression.name, expression.name)

    def operand(self, function: Function, expression: Expression) -> str:
        """Return an expression as an operand of another one."""
        text = self.text(function, expression)
        return f"({text})" if isinstance(expression, Text) and expression.is_compound else text

    def operation(self, function: Function, operator: str, operands: Sequence[Expression], kind: Type) -> Text:
        """Return an operator of Python with one or two operands, such as ``+``, ``<=``, ``and`` or ``not``."""
        texts = [self.operand(function, operand) for operand in operands]
        sign = self.operators.get(operator, operator)
        return Text(f" {sign} ".join(texts) if len(texts) > 1 else f"{sign}{texts[0]}", kind, is_compound=True)

    @abstractmethod
    def element(self, function: Function, array: str, index: Expression) -> Text:
        """Return an element of an array of real numbers: of a state or of a table of constants."""

    @abstractmethod
    def library_call(self, function: Function, name: str, given: Sequence[Expression], kind: Type) -> Text:
        """Return a call of a function that all languages have or are given: `min`, `exp`, `choose`, `real`."""

    @abstractmethod
    def call(self, function: Function, called: Function, arrays: Sequence[str], given: Sequence[Expression]) -> Text:
        """Return the call of another translated function; arrays go to arrays by name."""

    def assignment(self, target: str, value: str) -> list[str]:
        """Return the lines by which a variable or an element of a state takes a value."""
        return [self.statements["="].format(target, value)]

    def branch(self, test: str, body: Sequence[str], otherwise: Sequence[str]) -> list[str]:
        """Return the lines of an `if` with its `else`."""
        words = self.statements
        other = [words["else"], *indented(otherwise)] if otherwise else []
        return [words["if"].format(test), *indented(body or [";"]), *other, words["end if"]]

    @abstractmethod
    def loop(
        self, function: Function, counter: str, start: Expression, stop: Expression, step: int, body: Sequence[str]
    ) -> list[str]:
        """Return the lines of a `for` over a range of whole numbers; `step` is not 0."""

    def loop_exit(self, word: Literal["break", "continue"]) -> list[str]:
        """Return the lines of a `break` or a `continue`."""
        return [self.statements[word]]

    @abstractmethod
    def return_value(self, function: Function, value: str) -> list[str]:
        """Return the lines that end a function with a value."""


def indented(lines: Iterable[str]) -> list[str]:
    """Return lines one level deeper."""
    return [f"    {line}" for line in lines]


def comment(text: str) -> str:
    """Return a text that does not end a comment of either language."""
    return " ".join(text.replace("*/", "* /").replace("*)", "* )").replace("(*", "( *").split())


def safe_names(names: Iterable[str], reserved: Collection[str], ignore_case: bool) -> dict[str, str]:
    """Return a name for each name that a language takes: letters, digits and underscores, all of them different."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        plain = "".join(c if c.isascii() else f"u{ord(c):x}" for c in name)
        plain = re.sub(r"_+", "_", plain).strip("_") or "unused"
        if plain.lower() in reserved or plain[0].isdigit():
            plain = f"v_{plain}"
        options = chain([plain], (f"{plain}_{k}" for k in count(2)))
        unique = next(each for each in options if (each.lower() if ignore_case else each) not in taken)
        taken.add(unique.lower() if ignore_case else unique)
        found[name] = unique
    return found
