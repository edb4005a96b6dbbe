"""A watch over calls into compiled code: one that does not return is reported, with what the law was called with.

Compiled code cannot be interrupted. It is therefore called for so little at a time that it returns within about a
second, and a call that takes the processor much longer hangs in a law. Whoever listens then gives up the thread, or
ends the process.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from fraexp.kernels.law_error import LawCall, LawCallError

HANG_LIMIT_S = 15.0
"""Processor time [s] after which a call into compiled code counts as one that never returns."""
TARGET_CALL_S = 0.5
"""Processor time [s] that a call should take."""
MAX_GROWTH = 8.0
"""Greatest factor from the work of one call to that of the next."""
FIRST_CALL_WORK = 64
"""Samples of the first call: a law may be a hundred thousand times as slow as usual."""
FIRST_BUILT_IN_STEPS = 65_536
"""Steps of the first call where all laws come with fraexp: each takes less than 10 µs."""
MAX_SLOW_CALLS = 3
"""Calls for a single sample, one after another, that may each take more than `TARGET_CALL_S`."""
POLL_INTERVAL_S = 1.0
"""Interval at which calls are looked at."""

Law = Callable[..., float]
HangListener = Callable[[str], None]
"""Called once with what hangs, in one line, in another thread than that of the call."""
Explainer = Callable[[Law, LawCall | None, float], str]
"""Returns in one line which law hangs, in which call, if that is on record, and since when [s]."""


def _unexplained(law: Law, call: LawCall | None, seconds: float) -> str:
    return f"the law {law.__qualname__} has not returned after {seconds:.0f} s"


_listener: ContextVar[HangListener | None] = ContextVar("listener", default=None)
_explainer: ContextVar[Explainer] = ContextVar("explainer", default=_unexplained)


@contextmanager
def hang_listener(listener: HangListener) -> Iterator[None]:
    """Have `listener` called about calls that do not return, of those that this thread makes in the `with` block."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def call_explainer(explain: Explainer) -> Iterator[None]:
    """Have calls that this thread makes in the `with` block explained by who knows the names of their laws."""
    token = _explainer.set(explain)
    try:
        yield
    finally:
        _explainer.reset(token)


@dataclass(eq=False)
class _WatchedCall:
    """A call into compiled code."""

    explain: Callable[[float], str]
    """Returns what hangs, in one line, since so many seconds."""
    listener: HangListener
    clock: Callable[[], float]
    began: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self.clock()

    @property
    def seconds(self) -> float:
        """Processor time since it began [s]."""
        return self.clock() - self.began

    @property
    def text(self) -> str:
        """What hangs, in one line."""
        return self.explain(self.seconds)


@contextmanager
def watched_call(law: Law, last_call: Callable[[], LawCall | None]) -> Iterator[None]:
    """Watch the call into compiled code that the `with` block makes, if anybody listens.

    `last_call` returns the call of the law that compiled code is in, if it is on record.
    """
    listener, explain = _listener.get(), _explainer.get()
    if listener is None:
        yield
        return
    call = _WatchedCall(lambda seconds: explain(law, last_call(), seconds), listener, _thread_clock())
    _watch.begin(call)
    try:
        yield
    finally:
        _watch.end(call)


def _thread_clock() -> Callable[[], float]:
    """Return a clock of this thread's processor time, which another thread may read, or else of the process."""
    if not hasattr(time, "pthread_getcpuclockid"):
        return time.process_time
    clock = time.pthread_getcpuclockid(threading.get_ident())
    return lambda: time.clock_gettime(clock)


class _Watch:
    """A thread that looks at the calls that are being made; it ends with the process."""

    def __init__(self) -> None:
        self._calls: set[_WatchedCall] = set()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def begin(self, call: _WatchedCall) -> None:
        """Watch a call from now on."""
        with self._lock:
            self._calls.add(call)
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._run, name="fraexp call watch", daemon=True)
                self._thread.start()

    def end(self, call: _WatchedCall) -> None:
        """Watch a call no longer: it has returned."""
        with self._lock:
            self._calls.discard(call)

    @property
    def text(self) -> str:
        """What the first call is that is being made, in one line; empty if there is none."""
        with self._lock:
            first = next(iter(self._calls), None)
        return first.text if first else ""

    def _run(self) -> None:
        pause = threading.Event()
        while not pause.wait(POLL_INTERVAL_S):
            for call in self._take_overdue():
                call.listener(call.text)

    def _take_overdue(self) -> list[_WatchedCall]:
        with self._lock:  # a thread whose call is being made has not ended, so that its clock can be read
            overdue = [call for call in self._calls if call.seconds > HANG_LIMIT_S]
            self._calls.difference_update(overdue)
        return overdue


_watch = _Watch()


def running_call_text() -> str:
    """Return what a call into compiled code is that is being made, in one line; empty if there is none."""
    return _watch.text


class CallBudget:
    """How much work is asked of the next call into compiled code, so that it takes about `TARGET_CALL_S`.

    A law that makes a single sample last longer than that would keep an experiment busy for days.
    """

    def __init__(self, most: int, law: Law, first: int = FIRST_CALL_WORK) -> None:
        self._most, self._law = max(most, 1), law
        self._work = min(max(first, FIRST_CALL_WORK), self._most)
        self._slow_calls = 0

    @contextmanager
    def measure(self) -> Iterator[int]:
        """Give the work of the call that the `with` block makes, and learn from the time that it takes.

        Raises LawCallError if the law is too slow.
        """
        began = time.thread_time()
        yield self._work
        seconds = time.thread_time() - began
        self._slow_calls = self._slow_calls + 1 if self._work == 1 and seconds > TARGET_CALL_S else 0
        if self._slow_calls > MAX_SLOW_CALLS:
            reason = f"takes {seconds:.2g} s of processor time for each sample; expected microseconds: make it faster"
            raise LawCallError(reason, self._law)
        factor = TARGET_CALL_S / max(seconds, 1e-9)
        self._work = int(min(max(self._work * min(factor, MAX_GROWTH), 1), self._most))
