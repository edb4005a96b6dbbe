"""The first schema: runs, sweeps, responses, metrics, curves and the origin of components."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

KEY = sa.String(64)
MOMENT = sa.DateTime(timezone=True)
NUMBER = sa.Float(precision=53)


def upgrade() -> None:
    """Make all tables."""
    _make_runs()
    _make_sweeps()
    _make_results()
    _make_curves()


def downgrade() -> None:
    """Remove all tables."""
    for table in ("supplied_component", "curve_column", "curve", "metric", "frequency_response", "run_sweep", "sweep"):
        op.drop_table(table)
    op.drop_table("run")


def _column(name: str, kind: Any = sa.Text, nullable: bool = False) -> sa.Column[Any]:
    return sa.Column(name, kind, nullable=nullable)


def _primary(table: str, *columns: str) -> sa.PrimaryKeyConstraint:
    return sa.PrimaryKeyConstraint(*columns, name=f"pk_{table}")


def _refers(table: str, columns: list[str], other: str, others: list[str]) -> Any:
    name = f"fk_{table}_{'_'.join(columns)}_{other}"
    targets = [f"{other}.{column}" for column in others]
    return sa.ForeignKeyConstraint(columns, targets, name=name, ondelete="CASCADE")


def _make_runs() -> None:
    texts = ("study", "study_file", "command", "host", "boot")
    op.create_table(
        "run",
        _column("number", sa.Integer),
        *(_column(name) for name in texts),
        _column("state", sa.String(16)),
        _column("started", MOMENT),
        _column("ended", MOMENT, nullable=True),
        _column("heartbeat", MOMENT),
        _column("pid", sa.Integer),
        _column("process_start", sa.BigInteger, nullable=True),
        _column("provenance", sa.JSON),
        _primary("run", "number"),
        sqlite_autoincrement=True,
    )


def _make_sweeps() -> None:
    names = ("source", "plant_name", "friction_name", "controller_name", "excitation_name", "estimator_name")
    op.create_table(
        "sweep",
        _column("key", KEY),
        _column("experiment_key", KEY),
        _column("experiment", sa.JSON),
        _column("estimator", sa.JSON),
        _column("outcome", sa.String(16), nullable=True),
        _column("message"),
        _column("elapsed", NUMBER),
        _column("created", MOMENT, nullable=True),
        *(_column(name, nullable=True) for name in names),
        _primary("sweep", "key"),
    )
    op.create_index("ix_sweep_experiment_key", "sweep", ["experiment_key"])
    op.create_index("ix_sweep_estimator_name", "sweep", ["estimator_name"])
    op.create_table(
        "run_sweep",
        _column("run", sa.Integer),
        _column("position", sa.Integer),
        _column("key", KEY),
        _column("labels", sa.JSON),
        _column("state", sa.String(16)),
        _column("message"),
        _column("log"),
        _primary("run_sweep", "run", "position"),
        _refers("run_sweep", ["run"], "run", ["number"]),
        _refers("run_sweep", ["key"], "sweep", ["key"]),
    )
    op.create_index("ix_run_sweep_key_run", "run_sweep", ["key", "run"])


def _make_results() -> None:
    point = ("frequency", "response", "covariance", "input_amplitude", "output_amplitude")
    quality = ("settled", "settling_time", "residual", "harmonics")
    op.create_table(
        "frequency_response",
        _column("key", KEY),
        *(_column(name) for name in ("unit", "input", "output")),
        _column("points", sa.Integer),
        *(_column(name, sa.LargeBinary) for name in (*point, *quality)),
        _primary("frequency_response", "key"),
        _refers("frequency_response", ["key"], "sweep", ["key"]),
    )
    op.create_table(
        "metric",
        _column("key", KEY),
        _column("position", sa.Integer),
        _column("name"),
        _column("value", NUMBER, nullable=True),
        _column("unit"),
        _primary("metric", "key", "position"),
        _refers("metric", ["key"], "sweep", ["key"]),
    )
    op.create_index("ix_metric_name", "metric", ["name"])
    op.create_table(
        "supplied_component",
        _column("key", KEY),
        _column("kind", sa.String(32)),
        _column("name", sa.String(128)),
        _column("version", sa.Integer, nullable=True),
        _column("source_hash"),
        _column("distribution"),
        _primary("supplied_component", "key", "kind", "name"),
        _refers("supplied_component", ["key"], "sweep", ["key"]),
    )


def _make_curves() -> None:
    op.create_table(
        "curve",
        _column("key", KEY),
        _column("position", sa.Integer),
        _column("name"),
        _primary("curve", "key", "position"),
        _refers("curve", ["key"], "sweep", ["key"]),
    )
    op.create_table(
        "curve_column",
        _column("key", KEY),
        _column("curve", sa.Integer),
        _column("position", sa.Integer),
        _column("name"),
        _column("unit", nullable=True),
        _column("samples", sa.LargeBinary),
        _primary("curve_column", "key", "curve", "position"),
        _refers("curve_column", ["key", "curve"], "curve", ["key", "position"]),
    )
