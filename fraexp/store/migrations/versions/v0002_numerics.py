"""How each sweep was computed."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Say nothing of the numerics of older sweeps."""
    with op.batch_alter_table("sweep") as table:
        table.add_column(sa.Column("numerics", sa.Text, nullable=False, server_default=""))


def downgrade() -> None:
    """Forget the numerics."""
    with op.batch_alter_table("sweep") as table:
        table.drop_column("numerics")
