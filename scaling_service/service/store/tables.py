"""What is kept, as tables. Times are µs since 1970, documents are JSON as text."""

from __future__ import annotations

from sqlalchemy import BigInteger, Column, Float, ForeignKey, Index, Integer, MetaData, String, Table, Text
from sqlalchemy.schema import ForeignKeyConstraint

metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    }
)

owners = Table(
    "owners",
    metadata,
    Column("name", String(200), primary_key=True),
    # When a job of this owner was last begun: whoever waited longest is next.
    Column("served_us", BigInteger, nullable=False, default=0, server_default="0"),
)
"""Whose things are kept apart. Rows appear with the first key or subject."""

api_keys = Table(
    "api_keys",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), nullable=False, index=True),
    Column("label", String(200), nullable=False),
    Column("secret_sha256", String(64), nullable=False),
    Column("created_us", BigInteger, nullable=False),
    Column("revoked_us", BigInteger),
)

subjects = Table(
    "subjects",
    metadata,
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), primary_key=True),
    Column("id", String(200), primary_key=True),
    Column("created_us", BigInteger, nullable=False),
    Column("updated_us", BigInteger, nullable=False),
    Column("revision", Integer, nullable=False, default=1, server_default="1"),
    Column("document", Text, nullable=False),
    Index(None, "owner", "created_us", "id"),
    Index(None, "updated_us"),
)

marker_maps = Table(
    "marker_maps",
    metadata,
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), primary_key=True),
    Column("document", Text, nullable=False),
    Column("updated_us", BigInteger, nullable=False),
)
"""Which label is which marker in an owner's laboratory; one map each."""

blobs = Table(
    "blobs",
    metadata,
    Column("sha256", String(64), primary_key=True),
    Column("size", BigInteger, nullable=False),
    Column("touched_us", BigInteger, nullable=False),
)

subject_files = Table(
    "subject_files",
    metadata,
    Column("owner", String(200), primary_key=True),
    Column("subject", String(200), primary_key=True),
    Column("name", String(255), primary_key=True),
    Column("sha256", ForeignKey("blobs.sha256"), nullable=False, index=True),
    Column("size", BigInteger, nullable=False),
    Column("updated_us", BigInteger, nullable=False),
    ForeignKeyConstraint(["owner", "subject"], ["subjects.owner", "subjects.id"], ondelete="CASCADE"),
)

jobs = Table(
    "jobs",
    metadata,
    Column("id", String(64), primary_key=True),
    Column("owner", ForeignKey("owners.name", ondelete="CASCADE"), nullable=False),
    Column("kind", String(64), nullable=False),
    Column("state", String(16), nullable=False),
    Column("attempt", Integer, nullable=False, default=0, server_default="0"),
    Column("losses", Integer, nullable=False, default=0, server_default="0"),
    # 1 for what was made for another job: it comes after what was asked for by itself.
    Column("part", Integer, nullable=False, default=0, server_default="0"),
    Column("revision", Integer, nullable=False, default=1, server_default="1"),
    Column("worker", String(200)),
    Column("lease_until_us", BigInteger),
    Column("progress_share", Float, nullable=False, default=0.0, server_default="0"),
    Column("progress_what", String(200), nullable=False, default="", server_default=""),
    Column("created_us", BigInteger, nullable=False),
    Column("started_us", BigInteger),
    Column("finished_us", BigInteger),
    Column("updated_us", BigInteger, nullable=False),
    Column("code_version", String(100), nullable=False),
    Column("host", String(255)),
    Column("failure", Text),
    # The large columns stand last: pages of jobs are read without them.
    Column("specification", Text, nullable=False),
    Column("provenance", Text),
    Column("result", Text),
    Index(None, "owner", "created_us", "id"),
    Index(None, "owner", "state", "created_us", "id"),
    Index(None, "owner", "kind", "created_us", "id"),
    Index(None, "owner", "state", "losses", "part", "created_us", "id"),
    Index(None, "state", "lease_until_us"),
    Index(None, "worker", "state"),
    Index(None, "finished_us"),
)

job_subjects = Table(
    "job_subjects",
    metadata,
    Column("job", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("subject", String(200), primary_key=True),
    Column("owner", String(200), nullable=False),
    Column("created_us", BigInteger, nullable=False),
    Index(None, "owner", "subject", "created_us", "job"),
)
"""Whose data a job rests on: deleted with any of them."""

job_inputs = Table(
    "job_inputs",
    metadata,
    Column("job", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("path", String(512), primary_key=True),
    Column("sha256", ForeignKey("blobs.sha256"), nullable=False, index=True),
    Column("size", BigInteger, nullable=False),
)
"""The content that a job was asked to work on, kept even when the subject's file is replaced."""

job_files = Table(
    "job_files",
    metadata,
    Column("job", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("path", String(512), primary_key=True),
    Column("sha256", ForeignKey("blobs.sha256"), nullable=False, index=True),
    Column("size", BigInteger, nullable=False),
)
"""What a job made."""

job_parts = Table(
    "job_parts",
    metadata,
    Column("whole", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    Column("part", ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True, index=True),
    Column("position", Integer, nullable=False),
)
"""What a job is made of. A part may belong to several wholes, and goes with the last of them."""

REFERENCES = (subject_files, job_inputs, job_files)  # tables that keep content alive
