"""Withdrawn publications, aliases, gates, and the serial numbers of sensors.

Revision ID: 0012
Revises: 0011
"""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade():
    op.create_table(
        "withdrawal",
        sa.Column("id", sa.Uuid(), nullable=False),
        *_of_a_camera(),
        *_said(),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_withdrawal")),
        *_keys("withdrawal"),
    )
    op.create_index("uq_withdrawal_vehicle_id_camera_number", "withdrawal", _NUMBERED, unique=True)
    op.create_table(
        "alias_move",
        sa.Column("id", sa.Uuid(), nullable=False),
        *_of_a_camera(),
        sa.Column("alias", sa.String(length=64), nullable=False),
        sa.Column("result_id", sa.Uuid(), nullable=True),
        sa.Column("overridden", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("gate", sa.JSON(none_as_null=True), nullable=True),
        *_said(),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alias_move")),
        *_keys("alias_move"),
        sa.ForeignKeyConstraint(["result_id"], ["result.id"], name="fk_alias_move_result_id", ondelete="SET NULL"),
    )
    op.create_index("ix_alias_move_result_id", "alias_move", ["result_id"])
    op.create_index("uq_alias_move_newness", "alias_move", ["vehicle_id", "camera", "alias", "number"], unique=True)
    for table in ("withdrawal", "alias_move"):
        op.create_index(f"ix_{table}_fleet_id", table, ["fleet_id"])
        op.create_index(f"ix_{table}_said_by", table, ["said_by"])
    op.add_column("publication", sa.Column("gate", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("fleet", sa.Column("gate", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("rig", sa.Column("gate", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("rig", sa.Column("lidar_serial", sa.String(length=200), nullable=True))
    op.add_column("rig_camera", sa.Column("serial", sa.String(length=200), nullable=True))
    op.create_index("ix_rig_lidar_serial", "rig", ["lidar_serial"])
    op.create_index("ix_rig_camera_serial", "rig_camera", ["serial"])


_NUMBERED = ["vehicle_id", "camera", "number"]


def _of_a_camera():
    return (
        sa.Column("fleet_id", sa.Uuid(), nullable=False),
        sa.Column("vehicle_id", sa.Uuid(), nullable=False),
        sa.Column("camera", sa.String(length=200), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
    )


def _said():
    return (
        sa.Column("said_by", sa.Uuid(), nullable=True),
        sa.Column("reason", sa.String(length=500), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
    )


def _keys(table):
    return (
        sa.ForeignKeyConstraint(["fleet_id"], ["fleet.id"], name=f"fk_{table}_fleet_id", ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["vehicle_id"], ["vehicle.id"], name=f"fk_{table}_vehicle_id", ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["said_by"], ["person.id"], name=f"fk_{table}_said_by", ondelete="SET NULL"),
    )


def downgrade():
    op.drop_index("ix_rig_camera_serial", "rig_camera")
    op.drop_index("ix_rig_lidar_serial", "rig")
    op.drop_column("rig_camera", "serial")
    op.drop_column("rig", "lidar_serial")
    op.drop_column("rig", "gate")
    op.drop_column("fleet", "gate")
    op.drop_column("publication", "gate")
    op.drop_table("alias_move")
    op.drop_table("withdrawal")
