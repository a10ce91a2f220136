"""Jobs that are made of others."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

_BEFORE = "ix_jobs_owner_state_losses_created_us_id"
_SINCE = "ix_jobs_owner_state_losses_part_created_us_id"


def upgrade() -> None:
    """Add the parts, and have them come after what was asked for by itself."""
    op.add_column("jobs", sa.Column("part", sa.Integer(), server_default="0", nullable=False))
    op.drop_index(_BEFORE, table_name="jobs")
    op.create_index(_SINCE, "jobs", ["owner", "state", "losses", "part", "created_us", "id"], unique=False)
    op.create_table(
        "job_parts",
        sa.Column("whole", sa.String(length=64), nullable=False),
        sa.Column("part", sa.String(length=64), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.ForeignKeyConstraint(["whole"], ["jobs.id"], name=op.f("fk_job_parts_whole"), ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["part"], ["jobs.id"], name=op.f("fk_job_parts_part"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("whole", "part", name=op.f("pk_job_parts")),
    )
    op.create_index(op.f("ix_job_parts_part"), "job_parts", ["part"], unique=False)


def downgrade() -> None:
    """Remove the parts."""
    op.drop_table("job_parts")
    op.drop_index(_SINCE, table_name="jobs")
    op.create_index(_BEFORE, "jobs", ["owner", "state", "losses", "created_us", "id"], unique=False)
    op.drop_column("jobs", "part")
