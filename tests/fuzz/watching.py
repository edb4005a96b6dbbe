"""Many inputs through a parser: each is accepted, or refused in one line; all else is a finding."""

import hashlib
import resource
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from random import Random
from typing import Any

from fraexp.errors import FraexpError

LONGEST, ASLEEP = 30.0, 300.0
"""Time after which an input hangs [s]: of the processor, however slow it is, and by the clock, as others work too."""
GROWTH = 500
"""Memory by which the process may grow at one [MB]."""


class HangError(BaseException):
    """An input takes too long; no `except Exception` may take it for a refusal."""


@dataclass(frozen=True)
class Target:
    """A parser, what makes hostile inputs for it, and what is asked of it."""

    name: str
    make: Callable[[Random], Any]
    parse: Callable[[Any], object]
    share: float
    """Of all inputs."""


@dataclass
class Tally:
    """What came of the inputs of a target."""

    inputs: int = 0
    refused: int = 0
    accepted: int = 0
    slowest: float = 0.0
    growth: float = 0.0
    findings: dict[str, Any] = field(default_factory=dict)
    """The first input of each kind."""


def feed(target: Target, seed: int, inputs: int) -> Tally:
    """Return what comes of so many inputs; the same seed makes the same ones."""
    tally, rng = Tally(), Random(f"{target.name} {seed}")
    with warnings.catch_warnings(), alarmed():
        warnings.simplefilter("ignore")
        for _ in range(inputs):
            made = target.make(rng)
            before, started = _memory(), time.process_time()
            finding = _one(target, made, tally)
            tally.inputs += 1
            took, growth = time.process_time() - started, _memory() - before
            tally.slowest, tally.growth = max(tally.slowest, took), max(tally.growth, growth)
            if took > LONGEST:
                finding = finding or f"took {took:.1f} s"
            if growth > GROWTH:
                finding = finding or f"grew by {growth:.0f} MB"
            if finding:
                tally.findings.setdefault(finding, made)
    return tally


def _one(target: Target, made: Any, tally: Tally) -> str:
    """Return what is found, or nothing."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    signal.setitimer(signal.ITIMER_REAL, ASLEEP)
    try:
        target.parse(made)
        tally.accepted += 1
    except FraexpError as error:
        tally.refused += 1
        return "" if str(error) else "a refusal says nothing"
    except HangError:
        return f"hang in {target.name}"
    except Exception as error:
        return _place(error)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    return ""


def _place(error: BaseException) -> str:
    """Return what was raised, and in which line of fraexp."""
    lines, trace = [], error.__traceback__
    while trace:
        name = trace.tb_frame.f_code.co_filename
        if "/fraexp" in name and "/tests/" not in name:
            lines.append(f"{name.rpartition('/')[2]}:{trace.tb_lineno}")
        trace = trace.tb_next
    return f"{type(error).__name__} at {lines[-1] if lines else '?'}: {str(error)[:60]!r}"


@contextmanager
def alarmed() -> Iterator[None]:
    """Let the alarm raise HangError."""

    def ring(number: int, frame: object) -> None:
        raise HangError

    before = {number: signal.signal(number, ring) for number in (signal.SIGALRM, signal.SIGPROF)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _memory() -> float:
    """Return the greatest memory that the process has had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def short(made: Any) -> str:
    """Return an input in one short line, with a digest."""
    told = repr(made)
    digest = hashlib.blake2b(told.encode("utf-8", "replace"), digest_size=4).hexdigest()
    return f"{told[:300]} ({len(told)} letters, {digest})"
