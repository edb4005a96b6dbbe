"""How far the computation itself may have falsified each response."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Older responses have no estimate."""
    with op.batch_alter_table("frequency_response") as table:
        table.add_column(sa.Column("numerical_error", sa.LargeBinary, nullable=True))


def downgrade() -> None:
    """Forget the estimates."""
    with op.batch_alter_table("frequency_response") as table:
        table.drop_column("numerical_error")
