"""What is said of a law that did not return while it was checked, or cannot be compiled: with its file and line."""

import inspect
from pathlib import Path
from typing import Any

from fraexp.components.kinds import FrictionModel
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, place_of
from fraexp.testing.walk import Walk


def overdue(error: OverdueError, example: Any) -> str:
    """Return in one line why an example was given up."""
    owner = getattr(example, "model", example)
    if not isinstance(owner, FrictionModel):
        cls: Any = owner if inspect.isclass(owner) else type(owner)
        place = place_of(error, inspect.getfile(cls), inspect.getsourcelines(cls)[1])
        return f"{cls.name} ({place}) has not returned after {LAW_TIME_LIMIT_S:g} s; mend what ends its loops"
    code = owner.law.__code__
    place = place_of(error, code.co_filename, code.co_firstlineno)
    found = f"the law of {owner.name} ({place}) has not returned after {LAW_TIME_LIMIT_S:g} s{_step(error)}"
    return f"{found}; expected a force at once: mend what ends its loops"


def _step(error: OverdueError) -> str:
    """Return the step that the law was tried with."""
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code is Walk.trial.__code__:
            seen = trace.tb_frame.f_locals
            return f" on dy = {seen['dy']:g} m in {seen['self'].time_step:g} s"
        trace = trace.tb_next
    return ""


def uncompiled(error: Exception, example: Any) -> str:
    """Return in one line why a law cannot be compiled; the compiler may have named the place where it was called."""
    text = " ".join(str(error).split())
    owner = getattr(example, "model", example)
    if not isinstance(owner, FrictionModel):
        return text
    code = owner.law.__code__
    place = f"{Path(code.co_filename).name}, line {code.co_firstlineno}"
    named = text if "cannot be compiled" in text else f"it cannot be compiled: {text}"
    return f"the law of {owner.name} ({place}): {named}"
