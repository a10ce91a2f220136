"""The labels that each laboratory gives to markers."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the maps."""
    op.create_table(
        "marker_maps",
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("document", sa.Text(), nullable=False),
        sa.Column("updated_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["owner"], ["owners.name"], name=op.f("fk_marker_maps_owner"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("owner", name=op.f("pk_marker_maps")),
    )


def downgrade() -> None:
    """Remove the maps."""
    op.drop_table("marker_maps")
