"""Records written by the tests themselves, and the built-in readers."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from fraexp.components.registry import Registry
from fraexp.data.signals import Signals
from fraexp.records import RecordSettings, load, resolve
from fraexp.reports.stored_figures import StoredFigures


class Bench:
    """A made-up bench: a periodic input and the same, halved, three samples later."""

    rate = 1000.0
    period = 200
    lines = tuple(range(2, 41, 2))
    settings: ClassVar[dict[str, Any]] = {
        "file": "bench.csv",
        "time_column": "Time",
        "samples_per_period": 200,
        "channels": {"u": "iq", "y": {"column": "Position", "scale": -1}},
    }

    def rows(self, periods: int) -> np.ndarray:
        """One sample per row: time [s], input [A], output [mm]."""
        phases = np.random.default_rng(1).uniform(0, 2 * np.pi, len(self.lines))
        angle = 2 * np.pi * np.outer(np.arange(self.period), self.lines) / self.period
        signal = np.tile(np.cos(angle + phases).sum(axis=1), periods)
        return np.column_stack([np.arange(signal.size) / self.rate, signal, 0.5 * np.roll(signal, 3)])

    def write(
        self, path: Path, rows: np.ndarray, header: str = "Time [s],iq (A),Position [mm]", digits: int = 17
    ) -> None:
        line = ",".join([f"%.{digits}g"] * rows.shape[1]) + "\n"
        path.write_text(f"{header}\n" + line * len(rows) % tuple(rows.ravel().tolist()), encoding="utf-8")

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Output over input [m/A] with the output's sign turned."""
        return -0.5e-3 * np.exp(-2j * np.pi * frequency * 3 / self.rate)


@pytest.fixture(autouse=True)
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw nothing: a figure takes longer than to read a record, and other tests look at figures."""
    monkeypatch.setattr(StoredFigures, "_draw_group", lambda *_: True)


@pytest.fixture(scope="session")
def bench() -> Bench:
    return Bench()


@pytest.fixture
def signals_of(tmp_path: Path, registry: Registry, bench: Bench) -> Callable[..., Signals]:
    def read(**changes: object) -> Signals:
        settings = RecordSettings.parse({**bench.settings, **changes}, "record")
        experiment, files = resolve(settings, tmp_path, registry)
        return load(experiment, files, registry)

    return read
