"""Digests of what is stored, by which damage is noticed from now on."""

import sqlalchemy as sa
from alembic import op

from fraexp.store.sealing import seal_database

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

SWEEP_DIGESTS = ("digest", "content", "origins", "parts", "annotations")


def upgrade() -> None:
    """Compute the digests of what is there: whether it was damaged before is unknown."""
    with op.batch_alter_table("run") as table:
        table.add_column(sa.Column("sweeps", sa.Integer, nullable=False, server_default="0"))
        table.add_column(sa.Column("digest", sa.BigInteger, nullable=True))
        table.add_column(sa.Column("sweep_digests", sa.BigInteger, nullable=False, server_default="0"))
    with op.batch_alter_table("sweep") as table:
        table.add_column(sa.Column("in_runs", sa.String(8), nullable=False, server_default="yes"))
        for name in SWEEP_DIGESTS:
            table.add_column(sa.Column(name, sa.BigInteger, nullable=True))
    with op.batch_alter_table("run_sweep") as table:
        table.add_column(sa.Column("log_digest", sa.BigInteger, nullable=False, server_default="0"))
        table.add_column(sa.Column("digest", sa.BigInteger, nullable=True))
    seal_database(op.get_bind())


def downgrade() -> None:
    """Drop the digests."""
    for name, columns in (
        ("run", ("sweeps", "digest", "sweep_digests")),
        ("sweep", ("in_runs", *SWEEP_DIGESTS)),
        ("run_sweep", ("log_digest", "digest")),
    ):
        with op.batch_alter_table(name) as table:
            for column in columns:
                table.drop_column(column)
