"""What is known of each response's uncertainty, and fits."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

COLUMNS = ("freedom", "noise_variance", "nonlinear_variance", "coherence", "model_covariance")


def upgrade() -> None:
    """Older responses do not tell."""
    with op.batch_alter_table("frequency_response") as table:
        for name in COLUMNS:
            table.add_column(sa.Column(name, sa.LargeBinary, nullable=True))
    op.create_table(
        "fit",
        sa.Column("key", sa.String(64), nullable=False),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("kind", sa.String(32), nullable=False),
        sa.Column("component", sa.JSON, nullable=False),
        sa.Column("parameters", sa.JSON, nullable=False),
        sa.Column("units", sa.JSON, nullable=False),
        sa.Column("values", sa.LargeBinary, nullable=False),
        sa.Column("covariance", sa.LargeBinary, nullable=False),
        sa.ForeignKeyConstraint(["key"], ["sweep.key"], name="fk_fit_key_sweep", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("key", "position", name="pk_fit"),
    )


def downgrade() -> None:
    """Forget them."""
    op.drop_table("fit")
    with op.batch_alter_table("frequency_response") as table:
        for name in COLUMNS:
            table.drop_column(name)
