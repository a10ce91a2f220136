"""The first tables: owners, keys, subjects, files, jobs."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make all tables."""
    op.create_table(
        "blobs",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.Column("touched_us", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("sha256", name=op.f("pk_blobs")),
    )
    op.create_table(
        "owners",
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("served_us", sa.BigInteger(), server_default="0", nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_owners")),
    )
    op.create_table(
        "api_keys",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("label", sa.String(length=200), nullable=False),
        sa.Column("secret_sha256", sa.String(length=64), nullable=False),
        sa.Column("created_us", sa.BigInteger(), nullable=False),
        sa.Column("revoked_us", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(
            ["owner"], ["owners.name"], name=op.f("fk_api_keys_owner"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_api_keys")),
    )
    op.create_index(op.f("ix_api_keys_owner"), "api_keys", ["owner"], unique=False)
    op.create_table(
        "jobs",
        sa.Column("id", sa.String(length=64), nullable=False),
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("kind", sa.String(length=64), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("attempt", sa.Integer(), server_default="0", nullable=False),
        sa.Column("losses", sa.Integer(), server_default="0", nullable=False),
        sa.Column("revision", sa.Integer(), server_default="1", nullable=False),
        sa.Column("worker", sa.String(length=200), nullable=True),
        sa.Column("lease_until_us", sa.BigInteger(), nullable=True),
        sa.Column("progress_share", sa.Float(), server_default="0", nullable=False),
        sa.Column("progress_what", sa.String(length=200), server_default="", nullable=False),
        sa.Column("created_us", sa.BigInteger(), nullable=False),
        sa.Column("started_us", sa.BigInteger(), nullable=True),
        sa.Column("finished_us", sa.BigInteger(), nullable=True),
        sa.Column("updated_us", sa.BigInteger(), nullable=False),
        sa.Column("code_version", sa.String(length=100), nullable=False),
        sa.Column("host", sa.String(length=255), nullable=True),
        sa.Column("failure", sa.Text(), nullable=True),
        sa.Column("specification", sa.Text(), nullable=False),
        sa.Column("provenance", sa.Text(), nullable=True),
        sa.Column("result", sa.Text(), nullable=True),
        sa.ForeignKeyConstraint(["owner"], ["owners.name"], name=op.f("fk_jobs_owner"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_jobs")),
    )
    op.create_index(op.f("ix_jobs_finished_us"), "jobs", ["finished_us"], unique=False)
    op.create_index(op.f("ix_jobs_owner_created_us_id"), "jobs", ["owner", "created_us", "id"], unique=False)
    op.create_index(
        op.f("ix_jobs_owner_kind_created_us_id"), "jobs", ["owner", "kind", "created_us", "id"], unique=False
    )
    op.create_index(
        op.f("ix_jobs_owner_state_created_us_id"),
        "jobs",
        ["owner", "state", "created_us", "id"],
        unique=False,
    )
    op.create_index(
        op.f("ix_jobs_owner_state_losses_created_us_id"),
        "jobs",
        ["owner", "state", "losses", "created_us", "id"],
        unique=False,
    )
    op.create_index(op.f("ix_jobs_state_lease_until_us"), "jobs", ["state", "lease_until_us"], unique=False)
    op.create_index(op.f("ix_jobs_worker_state"), "jobs", ["worker", "state"], unique=False)
    op.create_table(
        "subjects",
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("id", sa.String(length=200), nullable=False),
        sa.Column("created_us", sa.BigInteger(), nullable=False),
        sa.Column("updated_us", sa.BigInteger(), nullable=False),
        sa.Column("revision", sa.Integer(), server_default="1", nullable=False),
        sa.Column("document", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["owner"], ["owners.name"], name=op.f("fk_subjects_owner"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("owner", "id", name=op.f("pk_subjects")),
    )
    op.create_index(
        op.f("ix_subjects_owner_created_us_id"), "subjects", ["owner", "created_us", "id"], unique=False
    )
    op.create_index(op.f("ix_subjects_updated_us"), "subjects", ["updated_us"], unique=False)
    op.create_table(
        "job_files",
        sa.Column("job", sa.String(length=64), nullable=False),
        sa.Column("path", sa.String(length=512), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["job"], ["jobs.id"], name=op.f("fk_job_files_job"), ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["sha256"], ["blobs.sha256"], name=op.f("fk_job_files_sha256")),
        sa.PrimaryKeyConstraint("job", "path", name=op.f("pk_job_files")),
    )
    op.create_index(op.f("ix_job_files_sha256"), "job_files", ["sha256"], unique=False)
    op.create_table(
        "job_inputs",
        sa.Column("job", sa.String(length=64), nullable=False),
        sa.Column("path", sa.String(length=512), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["job"], ["jobs.id"], name=op.f("fk_job_inputs_job"), ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["sha256"], ["blobs.sha256"], name=op.f("fk_job_inputs_sha256")),
        sa.PrimaryKeyConstraint("job", "path", name=op.f("pk_job_inputs")),
    )
    op.create_index(op.f("ix_job_inputs_sha256"), "job_inputs", ["sha256"], unique=False)
    op.create_table(
        "job_subjects",
        sa.Column("job", sa.String(length=64), nullable=False),
        sa.Column("subject", sa.String(length=200), nullable=False),
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("created_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["job"], ["jobs.id"], name=op.f("fk_job_subjects_job"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job", "subject", name=op.f("pk_job_subjects")),
    )
    op.create_index(
        op.f("ix_job_subjects_owner_subject_created_us_job"),
        "job_subjects",
        ["owner", "subject", "created_us", "job"],
        unique=False,
    )
    op.create_table(
        "subject_files",
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("subject", sa.String(length=200), nullable=False),
        sa.Column("name", sa.String(length=255), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.Column("updated_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["owner", "subject"],
            ["subjects.owner", "subjects.id"],
            name=op.f("fk_subject_files_owner"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(["sha256"], ["blobs.sha256"], name=op.f("fk_subject_files_sha256")),
        sa.PrimaryKeyConstraint("owner", "subject", "name", name=op.f("pk_subject_files")),
    )
    op.create_index(op.f("ix_subject_files_sha256"), "subject_files", ["sha256"], unique=False)


def downgrade() -> None:
    """Remove all tables."""
    op.drop_table("subject_files")
    op.drop_table("job_subjects")
    op.drop_table("job_inputs")
    op.drop_table("job_files")
    op.drop_table("subjects")
    op.drop_table("jobs")
    op.drop_table("api_keys")
    op.drop_table("owners")
    op.drop_table("blobs")
