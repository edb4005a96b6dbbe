import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text

from fraexp.data.findings import remarks
from fraexp.data.results import Curve, FrequencyResponse, Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import ComponentOrigin, Store
from fraexp.store.backends import locate_database
from tests.forks import ForkedPython
from tests.postgresql import Server, running
from tests.responses import frequency_response
from tests.store.resealing import seal_database
from tests.waiting import HANG_TIMEOUT_S

KINDS = ["sqlite", pytest.param("postgresql", marks=pytest.mark.thorough)]
"""Kinds of database; what holds for a file must hold on a server, which the whole suite checks."""
ORIGIN = {
    "friction:rolling": ComponentOrigin("hash-of-rolling", "fraexp 0.1.0"),
    "estimator:proposed": ComponentOrigin("hash-of-proposed", "workspace"),
}


def _sweep(number: int = 0, **labels: Any) -> Sweep:
    experiment = {
        "source": "loop",
        "plant": {"name": "modal", "version": 1},
        "friction": {"name": "rolling", "version": 2},
    }
    return Sweep({**experiment, "excitation": {"name": "stepped sine", "number": number}}, _estimator(), labels)


def _estimator() -> dict[str, Any]:
    return {"name": "proposed", "version": 3, "model": {"name": "rolling", "version": 2}}


def _response(points: int = 3) -> FrequencyResponse:
    frequency = np.linspace(1.0, 200.0, points)
    return frequency_response(
        frequency,
        np.exp(-1j * frequency) / frequency,
        input="u_e",
        input_amplitude=12 / frequency,
        settled=frequency > 2,
        settling_time=np.full(points, 0.25),
        residual=np.full(points, 1e-7),
        harmonics=np.full((points, 6), 1e-3 + 2e-3j),
    )


def _result(value: float = 1.5) -> Result:
    curve = Curve("loop", {"y": np.arange(4.0), "f": np.ones(4)}, {"y": "m", "f": "N"})
    return Result(
        Outcome.OK, remarks("all well"), _response(), (Metric("overshoot", value, "1"),), (curve,), elapsed=0.5
    )


@pytest.fixture
def sweep() -> Callable[..., Sweep]:
    return _sweep


@pytest.fixture
def result() -> Callable[..., Result]:
    return _result


@pytest.fixture
def origin() -> dict[str, ComponentOrigin]:
    return ORIGIN


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run each test on every kind of database, except those that look into the file."""
    if "kind" in metafunc.fixturenames:
        kinds = ["sqlite"] if "path" in metafunc.fixturenames else KINDS
        metafunc.parametrize("kind", kinds, scope="session")


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    with running() as started:
        yield started


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "results.db"


@pytest.fixture
def url(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> str:
    """A database that does not exist yet."""
    if kind == "sqlite":
        return str(tmp_path / "results.db")
    made: str = request.getfixturevalue("server").new()
    return made


@pytest.fixture
def sql(url: str) -> Callable[..., list[Any]]:
    """Run a statement behind the store's back."""

    def run(statement: str, **values: Any) -> list[Any]:
        engine = locate_database(url, 5.0).writer()
        with engine.begin() as connection:
            done = connection.execute(text(statement), values)
            rows = [tuple(row) for row in done] if done.returns_rows else []
        engine.dispose()
        return rows

    return run


def reseal(url: str) -> None:
    """Compute the digests anew, as if fraexp had written what a test has changed behind its back."""
    engine = locate_database(url, 5.0).writer()
    try:
        with engine.begin() as connection:
            seal_database(connection)
    finally:
        engine.dispose()


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    with Store.open(url, create=True, timeout=HANG_TIMEOUT_S) as opened:
        yield opened


@pytest.fixture
def begin(store: Store) -> Callable[[list[Sweep]], int]:
    return lambda sweeps: store.begin_run("friction", "studies/friction.toml", "fraexp run", {"git": None}, sweeps)


@pytest.fixture
def program() -> Callable[..., Any]:
    """Run Python code in another process until it says "ready", and hand the process over."""

    @contextmanager
    def started(code: str, *arguments: Any) -> Iterator[subprocess.Popen[str]]:
        command = [sys.executable, "-c", code, *map(str, arguments)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        with ForkedPython(command, **pipes) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == "ready\n"
                yield process
            finally:
                process.kill()

    return started
