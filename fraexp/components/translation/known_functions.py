"""Functions of Python that a translated function may call, and their names in the syntax tree."""

import builtins
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from fraexp.kernels.choice import where

REAL_FUNCTIONS = ("exp", "expm1", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "tanh", "copysign", "pow")
"""Functions of `math` that take and return real numbers."""
NUMPY_FUNCTIONS = {
    "exp": "exp", "expm1": "expm1", "log": "log", "sqrt": "sqrt", "sin": "sin", "cos": "cos", "tan": "tan",
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "tanh": "tanh", "copysign": "copysign", "power": "pow",
    "minimum": "min", "maximum": "max", "abs": "abs", "where": "choose",
}  # fmt: skip
"""Functions of numpy, of single numbers, and their names in the syntax tree."""
KNOWN_FUNCTIONS: dict[Callable[..., Any], str] = {
    builtins.min: "min",
    builtins.max: "max",
    builtins.abs: "abs",
    math.fabs: "abs",
    builtins.float: "real",
    builtins.int: "truncate",
    builtins.len: "length",
    where: "choose",
    **{getattr(math, name): name for name in REAL_FUNCTIONS},
    **{getattr(np, name): known for name, known in NUMPY_FUNCTIONS.items()},
}
