"""Numba's decorators, with the types that callers see.

Numba types a compiled function as its dispatcher, and an intrinsic with the arguments that its emitter takes. To other
compiled code both are plain functions, and so they are typed here.
"""

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar

import numba
from llvmlite import ir
from numba import extending
from numba.core.typing.templates import Signature

Function = TypeVar("Function", bound=Callable[..., object])
Emitter: TypeAlias = Callable[..., ir.Value]
"""Builds the instructions of an operation: takes compiler context, instruction builder and the operands."""
Intrinsic: TypeAlias = tuple[Signature, Emitter] | None
"""What an intrinsic's function of argument types returns: signature and emitter, or None where they do not fit."""

COMPILER_OPTIONS: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy"}
"""A product may be added without being rounded first, with the same bits on every run; a division by 0 is not an error,
but gives an infinity, as in numpy."""


def compiled(**options: Any) -> Callable[[Function], Function]:
    """Return the decorator, with options of `numba.njit`, of a function that compiled code calls, and Python cannot."""
    decorator: Callable[[Function], Function] = numba.njit(**(options | {"no_cpython_wrapper": True}))
    return decorator


def intrinsic(function: Callable[..., Intrinsic]) -> Callable[..., Any]:
    """Return a function for compiled code that a signature and an emitter define, as `numba.extending.intrinsic`."""
    made: Callable[..., Any] = extending.intrinsic(function)
    return made
