"""Reasons why a law failed its checks as a whole: it did not return, or cannot be compiled; with file and line."""

import inspect
from pathlib import Path
from typing import Any

from fraexp.components.kinds import FrictionModel
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, error_location
from fraexp.testing.walk import Walk


def overdue_reason(error: OverdueError, example: object) -> str:
    """Return in one line why an example was given up: what did not return, and where."""
    owner = getattr(example, "model", example)
    if not isinstance(owner, FrictionModel):
        cls: Any = owner if inspect.isclass(owner) else type(owner)
        place = error_location(error, inspect.getfile(cls), inspect.getsourcelines(cls)[1])
        found = f"{cls.name} ({place}) has not returned after {LAW_TIME_LIMIT_S:g} s"
        return f"{found}; check the conditions that end its loops"
    code = owner.law.__code__
    place = error_location(error, code.co_filename, code.co_firstlineno)
    found = f"the law of {owner.name} ({place}) has not returned after {LAW_TIME_LIMIT_S:g} s{_step_text(error)}"
    return f"{found}; expected a force within milliseconds; check the conditions that end its loops"


def _step_text(error: OverdueError) -> str:
    """Return the step that the law was tried with; empty if it was none."""
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code is Walk.try_step.__code__:
            seen = trace.tb_frame.f_locals
            return f" on dy = {seen['dy']:g} m in {seen['self'].time_step:g} s"
        trace = trace.tb_next
    return ""


def compile_error_reason(error: Exception, example: object) -> str:
    """Return in one line why a law cannot be compiled; the compiler may have named the place where it was called."""
    text = " ".join(str(error).split())
    owner = getattr(example, "model", example)
    if not isinstance(owner, FrictionModel):
        return text
    code = owner.law.__code__
    place = f"{Path(code.co_filename).name}, line {code.co_firstlineno}"
    named = text if "cannot be compiled" in text else f"it cannot be compiled: {text}"
    return f"the law of {owner.name} ({place}): {named}"
