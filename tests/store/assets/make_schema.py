"""Makes schema-NNNN.db, a database as the current schema writes it: run once, when a revision is new."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np

from fraexp.data.results import Curve, Fit, FrequencyResponse, Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import ComponentOrigin, Store
from fraexp.store.migrations import HISTORY
from tests.store.conftest import reseal

FILE = Path(__file__).with_name(f"schema-{HISTORY[-1]}.db")


def main() -> None:
    """Write the file anew."""
    FILE.unlink(missing_ok=True)
    experiment = {"source": "loop", "friction": {"name": "rolling", "version": 1, "coulomb": 8.0}}
    grid = [Sweep(experiment, {"name": name, "version": 1}, {"estimator.name": name}) for name in ("a", "b")]
    with Store.open(str(FILE), create=True) as store:
        run = store.begin_run("friction", "studies/friction.toml", "fraexp run", {"fraexp": "0.1.0"}, grid)
        store.save(run, [(grid[0], result(), {"friction:rolling": ComponentOrigin("0123abcd", "fraexp 0.1.0")})])
        store.fail(run, grid[1].key, "killed its worker twice", "no log")
        store.end_run(run, "complete")
    with closing(sqlite3.connect(FILE, isolation_level=None)) as connection:
        connection.execute("UPDATE run SET host = 'example', boot = '', pid = 1, process_start = NULL")
    reseal(str(FILE))
    with closing(sqlite3.connect(FILE, isolation_level=None)) as connection:
        for statement in ("journal_mode = DELETE", "page_size = 512"):
            connection.execute(f"PRAGMA {statement}")
        connection.execute("VACUUM")
        connection.execute("PRAGMA journal_mode = WAL")


def result() -> Result:
    """Return a result that uses every table."""
    response = FrequencyResponse(
        frequency=np.array([1.0, 10.0]),
        response=np.array([0.1, 0.001 - 0.002j]),
        covariance=np.full((2, 2, 2), np.nan),
        unit="m/N",
        input="u",
        output="y",
        input_amplitude=np.array([12.0, 12.0]),
        output_amplitude=np.array([1.2, 0.03]),
        settled=np.array([True, False]),
        settling_time=np.array([2.0, 60.0]),
        residual=np.array([1e-7, 1e-2]),
        harmonics=np.zeros((2, 6), dtype=complex),
    )
    curve = Curve("hysteresis", {"displacement": np.zeros(2), "force": np.ones(2)}, {"displacement": "m", "force": "N"})
    component = {"name": "modal", "version": 1, "gain": 0.132}
    fit = Fit("plant", component, ("gain",), ("m/(N s²)",), np.array([0.132]), np.array([[1e-8]]))
    return Result(Outcome.OK, "", response, (Metric("stroke", 0.01, "m"),), (curve,), (fit,), elapsed=0.25)


if __name__ == "__main__":
    main()
