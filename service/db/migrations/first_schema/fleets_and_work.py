"""Fleets, people and their credentials, jobs, objects of the store."""

import sqlalchemy as sa
from alembic import op

from service.db.base import partial_index
from service.db.migrations.first_schema.foreign_keys import belongs_to

_BIG_ID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def create():
    op.create_table(
        "blob",
        sa.Column("key", sa.String(300), primary_key=True),
        sa.Column("state", sa.String(20), nullable=False),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.Column("sha256", sa.String(64)),
        sa.Column("job_id", sa.BigInteger(), index=True),
        sa.Column("attempt", sa.Integer()),
        sa.Column("failed_removals", sa.Integer(), nullable=False),
        sa.Column("remove_after", sa.BigInteger()),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
        sa.Index("ix_blob_state_created_at", "state", "created_at"),
    )
    op.create_table(
        "blob_hold",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("reason", sa.String(100), nullable=False),
        sa.Column("until", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "fleet",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("name", sa.String(200), nullable=False, unique=True),
        sa.Column("quota_bytes", sa.BigInteger()),
        sa.Column("gate", sa.JSON()),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "person",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("is_owner", sa.Boolean(), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "membership",
        belongs_to("person_id", "person.id", primary_key=True),
        belongs_to("fleet_id", "fleet.id", primary_key=True),
        sa.Column("role", sa.String(20), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "api_token",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("secret_hash", sa.String(64), nullable=False, unique=True),
        sa.Column("name", sa.String(200), nullable=False),
        belongs_to("person_id", "person.id"),
        belongs_to("fleet_id", "fleet.id", nullable=True),
        sa.Column("role", sa.String(20)),
        sa.Column("made_by", sa.Uuid()),
        sa.Column("expires_at", sa.BigInteger()),
        sa.Column("revoked_at", sa.BigInteger()),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "browser_session",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("secret_hash", sa.String(64), nullable=False, unique=True),
        belongs_to("person_id", "person.id"),
        sa.Column("made_by", sa.Uuid()),
        sa.Column("expires_at", sa.BigInteger(), nullable=False, index=True),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "sign_in_link",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("secret_hash", sa.String(64), nullable=False, unique=True),
        belongs_to("person_id", "person.id"),
        sa.Column("made_by", sa.Uuid()),
        sa.Column("expires_at", sa.BigInteger(), nullable=False, index=True),
        sa.Column("used_at", sa.BigInteger()),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "idempotency_key",
        sa.Column("id", sa.Uuid(), primary_key=True),
        belongs_to("person_id", "person.id"),
        sa.Column("key", sa.String(200), nullable=False),
        sa.Column("request_hash", sa.String(64), nullable=False),
        belongs_to("fleet_id", "fleet.id", nullable=True),
        sa.Column("role", sa.String(20)),
        sa.Column("status", sa.Integer(), nullable=False),
        sa.Column("body", sa.JSON(), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False, index=True),
        sa.UniqueConstraint("person_id", "key"),
    )
    op.create_table(
        "vehicle",
        sa.Column("id", sa.Uuid(), primary_key=True),
        belongs_to("fleet_id", "fleet.id"),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
        sa.UniqueConstraint("fleet_id", "name"),
        sa.Index("ix_vehicle_fleet_id_id", "fleet_id", "id"),
    )
    op.create_table(
        "rig",
        sa.Column("id", sa.Uuid(), primary_key=True),
        belongs_to("fleet_id", "fleet.id"),
        belongs_to("vehicle_id", "vehicle.id"),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("lidar_frame", sa.String(200), nullable=False),
        sa.Column("lidar_topic", sa.String()),
        sa.Column("lidar_serial", sa.String(200), index=True),
        sa.Column("T_vehicle_lidar", sa.JSON()),
        sa.Column("camera_transforms", sa.JSON()),
        sa.Column("gate", sa.JSON()),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
        sa.UniqueConstraint("vehicle_id", "name"),
    )
    op.create_table(
        "rig_camera",
        sa.Column("id", sa.Uuid(), primary_key=True),
        belongs_to("rig_id", "rig.id"),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("frame", sa.String(200), nullable=False),
        sa.Column("topic", sa.String()),
        sa.Column("serial", sa.String(200), index=True),
        sa.Column("image_width", sa.Integer(), nullable=False),
        sa.Column("image_height", sa.Integer(), nullable=False),
        sa.Column("nominal", sa.JSON(), nullable=False),
        sa.Column("bounds", sa.JSON(), nullable=False),
        sa.Column("joint", sa.JSON()),
        sa.Column("images", sa.JSON()),
        sa.UniqueConstraint("rig_id", "name"),
    )
    op.create_table(
        "job",
        sa.Column("id", _BIG_ID, primary_key=True),
        belongs_to("fleet_id", "fleet.id", index=False),
        sa.Column("kind", sa.String(20), nullable=False),
        sa.Column("queue", sa.String(20), nullable=False),
        sa.Column("subject_id", sa.Uuid(), nullable=False),
        sa.Column("payload", sa.JSON(), nullable=False),
        sa.Column("state", sa.String(20), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("lost", sa.Integer(), nullable=False),
        sa.Column("sends", sa.Integer(), nullable=False),
        sa.Column("send_after", sa.BigInteger()),
        sa.Column("lease_until", sa.BigInteger()),
        sa.Column("cancel_requested", sa.Boolean(), nullable=False),
        sa.Column("worker", sa.String()),
        sa.Column("progress", sa.JSON()),
        sa.Column("problem", sa.JSON()),
        sa.Column("request_id", sa.String(64)),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
        sa.Column("started_at", sa.BigInteger()),
        sa.Column("finished_at", sa.BigInteger()),
        partial_index("ix_job_cancelled", "id", where="state = 'queued' AND IS_TRUE(cancel_requested)"),
        partial_index("ix_job_due", "send_after", where="state = 'queued' AND send_after IS NOT NULL"),
        partial_index("ix_job_finished_at", "finished_at", where="finished_at IS NOT NULL"),
        sa.Index("ix_job_fleet_id_id", "fleet_id", "id"),
        partial_index("ix_job_released", "fleet_id", "queue", "state", "id", where="state = 'queued' AND sends > 0"),
        partial_index("ix_job_running", "id", where="state = 'running'"),
        sa.Index("ix_job_state_queue_fleet_id", "state", "queue", "fleet_id"),
        sa.Index("ix_job_subject_id", "subject_id"),
        partial_index("ix_job_unwanted", "fleet_id", "state", "id", where="state IN ('failed', 'cancelled')"),
        partial_index(
            "ix_job_waiting", "fleet_id", "queue", "state", "id", where="state = 'queued' AND send_after IS NULL"
        ),
    )
    op.create_table(
        "job_event",
        sa.Column("id", _BIG_ID, primary_key=True),
        sa.Column("job_id", _BIG_ID, sa.ForeignKey("job.id", ondelete="CASCADE"), nullable=False, index=True),
        sa.Column("kind", sa.String(20), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("what", sa.String(20), nullable=False),
        sa.Column("worker", sa.String()),
        sa.Column("started_at", sa.BigInteger()),
        sa.Column("at", sa.BigInteger(), nullable=False),
        sa.Column("reason", sa.String(100)),
        sa.Column("tallied", sa.Boolean(), nullable=False),
        sa.Index(
            "ix_job_event_untallied",
            "id",
            postgresql_where=sa.text("NOT tallied"),
            sqlite_where=sa.text("tallied = 0"),
        ),
    )
    op.create_table(
        "job_total",
        sa.Column("kind", sa.String(20), primary_key=True),
        sa.Column("what", sa.String(20), primary_key=True),
        sa.Column("count", sa.BigInteger(), nullable=False),
        sa.Column("seconds", sa.Double(), nullable=False),
        sa.Column("buckets", sa.JSON(), nullable=False),
    )
    op.create_table(
        "worker",
        sa.Column("name", sa.String(200), primary_key=True),
        sa.Column("queues", sa.String(200), nullable=False),
        sa.Column("processes", sa.Integer(), nullable=False),
        sa.Column("version", sa.String(40), nullable=False),
        sa.Column("warm", sa.Boolean(), nullable=False),
        sa.Column("started_at", sa.BigInteger(), nullable=False),
        sa.Column("at", sa.BigInteger(), nullable=False),
    )
    op.create_table(
        "heartbeat",
        sa.Column("name", sa.String(40), primary_key=True),
        sa.Column("at", sa.BigInteger(), nullable=False),
    )
