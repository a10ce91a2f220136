"""Links that work without a key, on every server."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the links."""
    op.create_table(
        "links",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("until_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["owner"], ["owners.name"], name=op.f("fk_links_owner"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("sha256", name=op.f("pk_links")),
    )
    op.create_index(op.f("ix_links_owner"), "links", ["owner"], unique=False)
    op.create_index(op.f("ix_links_until_us"), "links", ["until_us"], unique=False)


def downgrade() -> None:
    """Remove the links."""
    op.drop_table("links")
