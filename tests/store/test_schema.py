import sys

import pytest

from fraexp.store import Store
from tests.forks import ForkedPython

MAKES = """
import sys
from sqlalchemy import event
from sqlalchemy.engine import Engine
from fraexp.store import Store

place, seen = sys.argv[2], 0

def stop(*_):
    print("ready", flush=True)
    sys.stdin.read()

def statement(*_):
    global seen
    seen += 1
    if place == str(seen):
        stop()

event.listen(Engine, "after_cursor_execute", statement)
event.listen(Engine, "commit", stop)
Store.open(sys.argv[1], create=True)
"""


@pytest.mark.thorough
@pytest.mark.parametrize("place", ["1", "20", "commit"])
def test_a_database_whose_maker_is_killed_is_made_by_the_next(path, program, place):
    with program(MAKES, path, place) as process:
        process.kill()
        process.wait()
    assert not path.exists()
    with Store.open(str(path), create=True) as store:
        assert store.runs() == []


def test_several_processes_may_make_the_database_at_once(url):
    code = (
        "import sys; from fraexp.store import Store; Store.open(sys.argv[1], create=True).begin_run('', '', '', {}, [])"
    )
    command = [sys.executable, "-c", code, url]
    racers = [ForkedPython(command) for _ in range(2)]
    assert [racer.wait() for racer in racers] == [0, 0]
    with Store.open(url) as store:
        assert [run.number for run in store.runs()] == [2, 1]
