"""Leases: which run computes what; and an index that holds all that listings ask of a run."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Nobody holds anything yet."""
    op.create_table(
        "lease",
        sa.Column("key", sa.String(64), nullable=False),
        sa.Column("run", sa.Integer, nullable=False),
        sa.ForeignKeyConstraint(["key"], ["sweep.key"], name="fk_lease_key_sweep", ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["run"], ["run.number"], name="fk_lease_run_run", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("key", name="pk_lease"),
    )
    op.create_index("ix_run_sweep_key_standing_state_run", "run_sweep", ["key", "standing", "state", "run"])
    op.drop_index("ix_run_sweep_key_run", "run_sweep")


def downgrade() -> None:
    """Forget them."""
    op.create_index("ix_run_sweep_key_run", "run_sweep", ["key", "run"])
    op.drop_index("ix_run_sweep_key_standing_state_run", "run_sweep")
    op.drop_table("lease")
