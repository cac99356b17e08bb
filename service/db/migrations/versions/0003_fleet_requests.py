"""Fleet requests and their vehicles; indexes that find a fleet's sent and waiting jobs among thousands.

Revision ID: 0003
Revises: 0002
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_WAITING = sa.text("state = 'queued' AND send_after IS NULL")
_SENT = sa.text("state = 'queued' AND send_after IS NOT NULL")


def upgrade():
    op.create_table(
        "fleet_request",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("fleet_id", sa.Uuid(), nullable=False),
        sa.Column("asked", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("state", sa.String(length=20), nullable=False),
        sa.Column("matched", sa.Integer(), nullable=False),
        sa.Column("remaining", sa.Integer(), nullable=False),
        sa.Column("done", sa.Integer(), nullable=False),
        sa.Column("failed", sa.Integer(), nullable=False),
        sa.Column("cancelled", sa.Integer(), nullable=False),
        sa.Column("skipped", sa.Integer(), nullable=False),
        sa.Column("wave", sa.Integer(), nullable=False),
        sa.Column("cancel_requested", sa.Boolean(), nullable=False),
        sa.Column("created_by", sa.Uuid(), nullable=True),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
        sa.Column("started_at", sa.BigInteger(), nullable=False),
        sa.Column("finished_at", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(
            ["created_by"], ["person.id"], name=op.f("fk_fleet_request_created_by"), ondelete="SET NULL"
        ),
        sa.ForeignKeyConstraint(
            ["fleet_id"], ["fleet.id"], name=op.f("fk_fleet_request_fleet_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_fleet_request")),
    )
    op.create_index(op.f("ix_fleet_request_created_by"), "fleet_request", ["created_by"])
    op.create_index(op.f("ix_fleet_request_fleet_id"), "fleet_request", ["fleet_id"])
    op.create_table(
        "fleet_request_vehicle",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("fleet_request_id", sa.Uuid(), nullable=False),
        sa.Column("vehicle_id", sa.Uuid(), nullable=False),
        sa.Column("calibration_id", sa.Uuid(), nullable=True),
        sa.Column("state", sa.String(length=20), nullable=False),
        sa.Column("problem", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("finished_at", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(
            ["calibration_id"],
            ["calibration.id"],
            name=op.f("fk_fleet_request_vehicle_calibration_id"),
            ondelete="SET NULL",
        ),
        sa.ForeignKeyConstraint(
            ["fleet_request_id"],
            ["fleet_request.id"],
            name=op.f("fk_fleet_request_vehicle_fleet_request_id"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["vehicle_id"], ["vehicle.id"], name=op.f("fk_fleet_request_vehicle_vehicle_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_fleet_request_vehicle")),
        sa.UniqueConstraint(
            "fleet_request_id", "vehicle_id", name=op.f("uq_fleet_request_vehicle_fleet_request_id_vehicle_id")
        ),
    )
    op.create_index(op.f("ix_fleet_request_vehicle_calibration_id"), "fleet_request_vehicle", ["calibration_id"])
    op.create_index(
        "ix_fleet_request_vehicle_fleet_request_id_state_id",
        "fleet_request_vehicle",
        ["fleet_request_id", "state", "id"],
    )
    op.create_index(op.f("ix_fleet_request_vehicle_vehicle_id"), "fleet_request_vehicle", ["vehicle_id"])
    for name, where in (("waiting", _WAITING), ("sent", _SENT)):
        op.create_index(
            f"ix_job_{name}",
            "job",
            ["fleet_id", "queue", "state", "id"],
            postgresql_where=where,
            sqlite_where=where,
        )


def downgrade():
    op.drop_index("ix_job_sent", "job")
    op.drop_index("ix_job_waiting", "job")
    op.drop_table("fleet_request_vehicle")
    op.drop_table("fleet_request")
