"""Validations: a calibration held against data that it was not fitted to.

Revision ID: 0015
Revises: 0014
"""

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

_BELONGS_TO = {
    "fleet_id": "fleet",
    "vehicle_id": "vehicle",
    "recording_id": "recording",
    "set_id": "correspondence_set",
}
_INDEXED = ("fleet_id", "recording_id", "set_id", "result_id", "job_id")


def upgrade():
    op.create_table(
        "validation",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("fleet_id", sa.Uuid(), nullable=False),
        sa.Column("vehicle_id", sa.Uuid(), nullable=False),
        sa.Column("recording_id", sa.Uuid(), nullable=True),
        sa.Column("set_id", sa.Uuid(), nullable=True),
        sa.Column("result_id", sa.Uuid(), nullable=True),
        sa.Column("kind", sa.String(length=20), nullable=False),
        sa.Column("camera", sa.String(length=200), nullable=False),
        sa.Column("asked", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("state", sa.String(length=20), nullable=False),
        sa.Column("result", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("problem", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("job_id", sa.BigInteger(), nullable=True),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
        *(
            sa.ForeignKeyConstraint([column], [f"{table}.id"], name=f"fk_validation_{column}", ondelete="CASCADE")
            for column, table in _BELONGS_TO.items()
        ),
        sa.ForeignKeyConstraint(["result_id"], ["result.id"], name="fk_validation_result_id", ondelete="SET NULL"),
        sa.PrimaryKeyConstraint("id", name="pk_validation"),
    )
    op.create_index("ix_validation_vehicle_id_id", "validation", ["vehicle_id", "id"])
    for column in _INDEXED:
        op.create_index(f"ix_validation_{column}", "validation", [column])


def downgrade():
    op.drop_table("validation")
