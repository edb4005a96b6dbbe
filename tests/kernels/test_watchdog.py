"""A time limit on interpreted code: it ends what does not return, in any thread, and nothing else."""

import ctypes
import itertools
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import pytest

from fraexp.kernels.watchdog import OverdueError, dumped_location, error_location, time_limit


def endless_loop() -> None:
    while True:
        pass


def endless_count() -> None:
    for _ in itertools.count():
        try:
            int("no number")
        except Exception:
            continue


def ended(action: Callable[[], None], seconds: float = 0.05) -> str:
    with pytest.raises(OverdueError) as caught, time_limit(seconds):
        action()
    return error_location(caught.value, __file__, 1)


@pytest.mark.parametrize("action", [endless_loop, endless_count])
def test_what_never_returns_is_ended_in_its_line(action: Callable[[], None]) -> None:
    first = action.__code__.co_firstlineno
    file, _, line = ended(action).partition(", line ")
    assert file == "test_watchdog.py"
    assert first < int(line) <= first + 5


def test_so_it_is_in_another_thread() -> None:
    found: list[str] = []
    thread = threading.Thread(target=lambda: found.append(ended(endless_loop)))
    thread.start()
    thread.join()
    assert found[0].startswith("test_watchdog.py, line ")


def test_what_returns_is_left_alone_whatever_follows() -> None:
    for _ in range(100):
        with time_limit(600.0):
            pass
    for _ in range(10**5):  # nothing is raised later
        pass


def test_an_error_that_was_raised_leaves_traced_code_running() -> None:
    ended(endless_loop)
    tracer = sys.gettrace()
    sys.settrace(lambda *_: None)
    try:
        assert [str(number) for number in range(2)] == ["0", "1"]
    finally:
        sys.settrace(tracer)


def test_a_limit_within_a_limit_ends_the_inner_one() -> None:
    with time_limit(600.0):
        assert ended(endless_loop)


def test_the_interpreters_dump_tells_the_innermost_line_of_a_file() -> None:
    dump = ["Timeout (0:00:10)!", '  File "/a/threading.py", line 3 in wait', '  File "/b/law.py", line 12 in advance']
    dump.append('  File "/b/law.py", line 40 in outer')
    assert dumped_location(dump, "/b/law.py") == "law.py, line 12"
    assert dumped_location(dump, "/b/other.py") == ""


def test_code_that_drops_the_error_in_a_callback_prints_no_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    callback = ctypes.CFUNCTYPE(None)(lambda: time.sleep(0.3) or sum(range(10)))
    with suppress(OverdueError), time_limit(0.05):
        callback()
    assert not capsys.readouterr().err
