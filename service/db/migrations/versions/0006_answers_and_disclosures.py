"""Answers with the ids of their clients, and what was told to whom of others' answers.

Revision ID: 0006
Revises: 0005
"""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade():
    op.create_table(
        "answer",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("recording_id", sa.Uuid(), nullable=False),
        sa.Column("person_id", sa.Uuid(), nullable=False),
        sa.Column("apex_id", sa.Uuid(), nullable=False),
        sa.Column("sensor_id", sa.Uuid(), nullable=False),
        sa.Column("frame_index", sa.Integer(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("verdict", sa.String(length=20), nullable=True),
        sa.Column("u", sa.Double(), nullable=True),
        sa.Column("v", sa.Double(), nullable=True),
        sa.Column("reviewed", sa.Boolean(), nullable=False),
        sa.Column("created_at", sa.BigInteger(), nullable=False),
        *_belonging("answer"),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_answer")),
        sa.UniqueConstraint(
            *("person_id", "apex_id", "sensor_id", "version"),
            name=op.f("uq_answer_person_id_apex_id_sensor_id_version"),
        ),
    )
    op.create_table(
        "disclosure",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("recording_id", sa.Uuid(), nullable=False),
        sa.Column("person_id", sa.Uuid(), nullable=False),
        sa.Column("apex_id", sa.Uuid(), nullable=False),
        sa.Column("sensor_id", sa.Uuid(), nullable=False),
        sa.Column("told_in", sa.String(length=20), nullable=False),
        sa.Column("told_at", sa.BigInteger(), nullable=False),
        *_belonging("disclosure"),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_disclosure")),
        sa.UniqueConstraint(
            *("person_id", "sensor_id", "apex_id"), name=op.f("uq_disclosure_person_id_sensor_id_apex_id")
        ),
    )
    for table in ("answer", "disclosure"):
        for column in ("recording_id", "apex_id", "sensor_id"):
            op.create_index(op.f(f"ix_{table}_{column}"), table, [column])
    for table in ("mark", "verdict"):
        op.add_column(table, sa.Column("reviewed", sa.Boolean(), server_default=sa.false(), nullable=False))


def _belonging(table):
    return [
        sa.ForeignKeyConstraint(
            [f"{name}_id"], [f"{name}.id"], name=op.f(f"fk_{table}_{name}_id"), ondelete="CASCADE"
        )
        for name in ("recording", "person", "apex", "sensor")
    ]


def downgrade():
    for table in ("verdict", "mark"):
        op.drop_column(table, "reviewed")
    op.drop_table("disclosure")
    op.drop_table("answer")
