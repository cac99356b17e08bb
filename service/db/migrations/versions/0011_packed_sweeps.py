"""Where each sweep's points lie, packed as they go over the wire.

Revision ID: 0011
Revises: 0010
"""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade():
    op.create_table(
        "packed_sweeps",
        sa.Column("sensor_id", sa.Uuid(), nullable=False),
        sa.Column("blob_key", sa.String(length=300), nullable=False),
        sa.ForeignKeyConstraint(["blob_key"], ["blob.key"], name=op.f("fk_packed_sweeps_blob_key")),
        _of_sensor("packed_sweeps"),
        sa.PrimaryKeyConstraint("sensor_id", name=op.f("pk_packed_sweeps")),
    )
    op.create_table(
        "packed_sweep",
        sa.Column("sensor_id", sa.Uuid(), nullable=False),
        sa.Column("index", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("stamp_ns", sa.BigInteger(), nullable=False),
        sa.Column("points", sa.Integer(), nullable=False),
        sa.Column("offset", sa.BigInteger(), nullable=False),
        sa.Column("length", sa.BigInteger(), nullable=False),
        _of_sensor("packed_sweep"),
        sa.PrimaryKeyConstraint("sensor_id", "index", name=op.f("pk_packed_sweep")),
    )


def _of_sensor(table):
    name = op.f(f"fk_{table}_sensor_id")
    return sa.ForeignKeyConstraint(["sensor_id"], ["sensor.id"], name=name, ondelete="CASCADE")


def downgrade():
    op.drop_table("packed_sweep")
    op.drop_table("packed_sweeps")
