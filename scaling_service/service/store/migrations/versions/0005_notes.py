"""Notes on a subject's results, and who signed them."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the notes."""
    op.create_table(
        "notes",
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("subject", sa.String(length=200), nullable=False),
        sa.Column("document", sa.Text(), nullable=False),
        sa.Column("updated_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["owner", "subject"],
            ["subjects.owner", "subjects.id"],
            name=op.f("fk_notes_owner"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("owner", "subject", name=op.f("pk_notes")),
    )


def downgrade() -> None:
    """Remove the notes."""
    op.drop_table("notes")
