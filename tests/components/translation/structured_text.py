"""An interpreter of the part of IEC 61131-3 Structured Text that is exported, written apart from what writes it.

It knows the standard alone: names regardless of case, VAR_IN_OUT by reference, inputs that keep their value, function
blocks whose variables live on, and FOR loops whose end is included.
"""

import math
import operator
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

TOKEN = re.compile(
    r"\(\*.*?\*\)|//[^\n]*|\s+"
    r"|(?P<number>\d+\.\d+(?:[eE][+-]?\d+)?|\d+(?![.\d]*\.\.)|\d+)"
    r"|(?P<word>[A-Za-z_]\w*)|(?P<sign>:=|<>|<=|>=|\.\.|[-+*/()\[\],;:.<>=])",
    re.DOTALL,
)
OPERATORS: dict[str, Callable[..., Any]] = {
    "and": operator.and_, "or": operator.or_, "=": operator.eq, "<>": operator.ne, "<": operator.lt,
    ">": operator.gt, "<=": operator.le, ">=": operator.ge, "+": operator.add, "-": operator.sub,
    "*": operator.mul, "/": operator.truediv,
}  # fmt: skip
LEVELS = (("or",), ("and",), ("=", "<>"), ("<", ">", "<=", ">="), ("+", "-"), ("*", "/"))
STANDARD: dict[str, Callable[..., Any]] = {
    "abs": abs, "min": min, "max": max, "exp": math.exp, "ln": math.log, "sqrt": math.sqrt, "sin": math.sin,
    "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan, "trunc": int,
    "expt": lambda x, y: x**y, "sel": lambda g, no, yes: yes if g else no,
    "dint_to_lreal": float, "dint_to_real": float,
}  # fmt: skip


class ReturnError(Exception):
    """RETURN."""


class ExitError(Exception):
    """EXIT."""


class ContinueError(Exception):
    """CONTINUE."""


@dataclass
class Unit:
    """A function, function block or program: sections of variables with types and first values, and statements."""

    name: str
    kind: str
    variables: dict[str, tuple[str, Any, Any]] = field(default_factory=dict)
    """Section, type and first value of each variable."""
    body: list[Any] = field(default_factory=list)


def tokens(text: str) -> Iterator[str]:
    place = 0
    while place < len(text):
        found = TOKEN.match(text, place)
        assert found is not None, f"no Structured Text: {text[place : place + 40]!r}"
        place = found.end()
        if found.lastgroup:
            yield found[0].lower()
    yield "<end>"


class Parser:
    def __init__(self, text: str) -> None:
        self.tokens, self.at = list(tokens(text)), 0

    @property
    def next(self) -> str:
        return self.tokens[self.at]

    def take(self, *expected: str) -> str:
        word = self.next
        assert not expected or word in expected, (
            f"found {' '.join(self.tokens[self.at - 3 : self.at + 3])}; expected {expected}"
        )
        self.at += 1
        return word

    def units(self) -> Iterator[Unit]:
        while self.next != "<end>":
            kind = self.take("function", "function_block", "program")
            unit = Unit(self.take(), kind)
            if kind == "function":
                self.take(":")
                unit.variables[unit.name] = ("result", self.type(), None)
            while self.next.startswith("var"):
                section = self.take()
                while self.next != "end_var":
                    self.declaration(unit, section)
                self.take("end_var")
            unit.body = self.statements(f"end_{kind}")
            self.take()
            yield unit

    def declaration(self, unit: Unit, section: str) -> None:
        name = self.take()
        assert name not in unit.variables, f"{name} is declared twice in {unit.name}"
        self.take(":")
        kind, value = self.type(), None
        if self.next == ":=":
            self.take()
            value = self.constants() if self.next == "[" else self.constant()
        self.take(";")
        unit.variables[name] = (section, kind, value)

    def constants(self) -> list[float]:
        self.take("[")
        found = [self.constant()]
        while self.next == ",":
            self.take()
            found.append(self.constant())
        self.take("]")
        return found

    def constant(self) -> float:
        sign = -1.0 if self.next == "-" and self.take() else 1.0
        return sign * float(self.take())

    def type(self) -> Any:
        if self.next != "array":
            return self.take()
        for word in ("array", "[", "0", ".."):
            self.take(word)
        last = int(self.take())
        for word in ("]", "of"):
            self.take(word)
        return (last + 1, self.take())

    def statements(self, *ends: str) -> list[Any]:
        found = []
        while self.next not in ends:
            if self.next == ";":
                self.take()
                continue
            found.append(self.statement())
        return found

    def statement(self) -> Any:
        match self.next:
            case "return" | "exit" | "continue":
                word = self.take()
                self.take(";")
                return (word,)
            case "if":
                return self.branch()
            case "for":
                return self.loop()
        target = self.postfix()
        if self.next == ":=":
            self.take()
            value = self.expression()
            self.take(";")
            return ("assign", target, value)
        self.take(";")
        return ("run", target)

    def branch(self) -> Any:
        self.take("if", "elsif")
        test = self.expression()
        self.take("then")
        body = self.statements("else", "elsif", "end_if")
        if self.next == "elsif":
            return ("if", test, body, [self.branch()])
        otherwise = self.statements("end_if") if self.next == "else" and self.take() else []
        self.take("end_if")
        self.take(";")
        return ("if", test, body, otherwise)

    def loop(self) -> Any:
        self.take("for")
        name = self.take()
        self.take(":=")
        first = self.expression()
        self.take("to")
        last = self.expression()
        step = self.expression() if self.next == "by" and self.take() else ("number", 1)
        self.take("do")
        body = self.statements("end_for")
        self.take("end_for")
        self.take(";")
        return ("for", name, first, last, step, body)

    def expression(self, level: int = 0) -> Any:
        if level == len(LEVELS):
            return self.unary()
        left = self.expression(level + 1)
        while self.next in LEVELS[level]:
            sign = self.take()
            left = ("binary", sign, left, self.expression(level + 1))
        return left

    def unary(self) -> Any:
        if self.next in ("-", "not"):
            return ("unary", self.take(), self.unary())
        return self.postfix()

    def postfix(self) -> Any:
        word = self.take()
        if word == "(":
            inner = self.expression()
            self.take(")")
            return inner
        if word in ("true", "false"):
            return ("number", word == "true")
        if word[0].isdigit():
            return ("number", float(word) if "." in word else int(word))
        if self.next == "[":
            self.take()
            index = self.expression()
            self.take("]")
            return ("element", word, index)
        if self.next == ".":
            self.take()
            return ("member", word, self.take())
        return ("call", word, self.arguments()) if self.next == "(" else ("name", word)

    def arguments(self) -> list[tuple[str, Any]]:
        self.take("(")
        found = []
        while self.next != ")":
            name = ""
            if self.tokens[self.at + 1] == ":=":
                name = self.take()
                self.take(":=")
            found.append((name, self.expression()))
            if self.next == ",":
                self.take()
        self.take(")")
        return found


class Machine:
    """A PLC that runs the units of a file."""

    def __init__(self, text: str) -> None:
        self.units = {unit.name: unit for unit in Parser(text).units()}
        kinds = {kind for unit in self.units.values() for _, kind, _ in unit.variables.values()}
        self._round = single if "real" in kinds else float

    def create(self, name: str) -> dict[str, Any]:
        """Return an instance of a function block or a program, with the first values of its variables."""
        unit = self.units[name.lower()]
        return {key: self._first_value(kind, value) for key, (_, kind, value) in unit.variables.items()}

    def cycle(self, name: str, instance: dict[str, Any], **inputs: float) -> dict[str, Any]:
        """Run a function block or a program once, and return its variables."""
        unit = self.units[name.lower()]
        for key, value in inputs.items():
            assert unit.variables[key][0] == "var_input"
            instance[key] = value
        self._run_body(unit, instance)
        return instance

    def _first_value(self, kind: Any, value: Any) -> Any:
        if isinstance(kind, tuple):
            assert value is None or len(value) == kind[0]
            return list(value) if value else [0.0] * kind[0]
        if kind in self.units:
            return {"<type>": kind, **self.create(kind)}
        return {"lreal": 0.0, "real": 0.0, "dint": 0, "bool": False}[kind] if value is None else value

    def _run_body(self, unit: Unit, variables: dict[str, Any]) -> None:
        with suppress(ReturnError):
            self._run(unit.body, variables, unit)

    def _run(self, statements: list[Any], variables: dict[str, Any], unit: Unit) -> None:
        for statement in statements:
            match statement:
                case ("assign", target, value):
                    self._assign(target, self._value(value, variables), variables, unit)
                case ("run", call):
                    self._value(call, variables)
                case ("if", test, body, otherwise):
                    found = self._value(test, variables)
                    assert isinstance(found, bool)
                    self._run(body if found else otherwise, variables, unit)
                case ("for", name, first, last, step, body):
                    self._run_loop(
                        name, [self._value(each, variables) for each in (first, last, step)], body, variables, unit
                    )
                case ("return",):
                    raise ReturnError
                case ("exit",):
                    raise ExitError
                case ("continue",):
                    raise ContinueError

    def _run_loop(self, name: str, bounds: list[int], body: list[Any], variables: dict[str, Any], unit: Unit) -> None:
        first, last, step = bounds
        assert all(type(bound) is int for bound in bounds)
        for variables[name] in range(first, last + (1 if step > 0 else -1), step):
            try:
                self._run(body, variables, unit)
            except ContinueError:
                continue
            except ExitError:
                break

    def _assign(self, target: Any, value: Any, variables: dict[str, Any], unit: Unit) -> None:
        if target[0] == "element":
            index = self._value(target[2], variables)
            assert type(index) is int and 0 <= index < len(variables[target[1]])
            variables[target[1]][index] = float(value)
            return
        kind = unit.variables[target[1]][1]
        expected = {"lreal": float, "real": float, "dint": int, "bool": bool}[kind]
        assert type(value) is expected, f"{target[1]} : {kind} takes {value!r}"
        variables[target[1]] = value

    def _value(self, expression: Any, variables: dict[str, Any]) -> Any:
        match expression:
            case ("number", found):
                pass
            case ("name", name):
                found = variables[name]
            case ("member", owner, name):
                found = variables[owner][name]
            case ("element", name, place):
                index = self._value(place, variables)
                assert type(index) is int and 0 <= index < len(variables[name]), f"{name}[{index}]"
                found = variables[name][index]
            case ("unary", sign, operand):
                value = self._value(operand, variables)
                found = (not value) if sign == "not" else -value
            case ("binary", sign, left, right):
                found = binary(sign, self._value(left, variables), self._value(right, variables))
            case ("call", name, arguments):
                found = self._call(name, arguments, variables)
            case _:
                raise AssertionError(expression)
        return self._round(found) if type(found) is float else found

    def _call(self, name: str, arguments: list[tuple[str, Any]], variables: dict[str, Any]) -> Any:
        values = [(key, self._value(value, variables)) for key, value in arguments]
        if name in STANDARD:
            return STANDARD[name](*(value for _, value in values))
        if name in variables:  # a function block
            return self.cycle(variables[name]["<type>"], variables[name], **dict(values))
        unit, inner = self.units[name], self.create(name)
        given = dict(values)
        wanted = {key for key, (section, _, _) in unit.variables.items() if section in ("var_in_out", "var_input")}
        assert set(given) == wanted, f"{name} is called with {sorted(given)}; expected {sorted(wanted)}"
        for key, value in given.items():
            section, kind, _ = unit.variables[key]
            assert section != "var_in_out" or len(value) == kind[0]
            assert section == "var_in_out" or kind not in ("lreal", "real") or type(value) is float, (name, key, value)
            inner[key] = value
        self._run_body(unit, inner)
        return inner[name]


def single(value: float) -> float:
    """Return a number as REAL holds it: sums and products of such numbers are rounded the same by way of LREAL."""
    return float(struct.unpack("f", struct.pack("f", value))[0])


def binary(sign: str, left: Any, right: Any) -> Any:
    """Return the result of an operator; both sides are of one type, as the standard demands."""
    assert type(left) is type(right), (sign, left, right)
    if sign == "/" and isinstance(left, int):
        return int(left / right)
    return OPERATORS[sign](left, right)
