"""The first tables. Nothing is to be done: where there is no version yet, all are made as they are now."""

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None
