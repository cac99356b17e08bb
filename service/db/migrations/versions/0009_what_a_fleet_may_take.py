"""What a fleet may take: bytes of its recordings, an end of unfinished uploads, jobs that are out.

Revision ID: 0009
Revises: 0008
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

_SENT = sa.text("state = 'queued' AND send_after IS NOT NULL")
_OF_A_FLEET = ["fleet_id", "queue", "state", "id"]


def upgrade():
    op.add_column("fleet", sa.Column("quota_bytes", sa.BigInteger(), nullable=True))
    op.add_column("recording", sa.Column("taken_bytes", sa.BigInteger(), nullable=True))
    op.add_column("recording", sa.Column("expires_at", sa.BigInteger(), nullable=True))
    op.create_index("ix_recording_fleet_id_taken_bytes", "recording", ["fleet_id", "taken_bytes"])
    op.add_column("blob", sa.Column("failed_removals", sa.Integer(), server_default="0", nullable=False))
    op.add_column("blob", sa.Column("remove_after", sa.BigInteger(), nullable=True))
    # Only older processes count by it. They find what it held by ix_job_state_queue_fleet_id.
    op.drop_index("ix_job_sent", "job")


def downgrade():
    op.create_index("ix_job_sent", "job", _OF_A_FLEET, postgresql_where=_SENT, sqlite_where=_SENT)
    op.drop_column("blob", "remove_after")
    op.drop_column("blob", "failed_removals")
    op.drop_index("ix_recording_fleet_id_taken_bytes", "recording")
    op.drop_column("recording", "expires_at")
    op.drop_column("recording", "taken_bytes")
    op.drop_column("fleet", "quota_bytes")
