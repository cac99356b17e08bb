"""Counters of the marking; disclosures name camera, frame and corner, and no longer the apex of one detection.

Revision ID: 0021
Revises: 0020
"""

import sqlalchemy as sa
from alembic import op

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None

_SEEN = ("person_id", "sensor_id", "frame_index", "sweep_index", "corner")


def upgrade():
    op.execute(
        "CREATE TABLE disclosed AS SELECT d.recording_id, d.person_id, d.sensor_id, f.frame_index, v.sweep_index, "
        "v.corner, min(d.told_in) AS told_in, min(d.told_at) AS told_at FROM disclosure d "
        "JOIN vertex v ON v.apex_id = d.apex_id "
        "JOIN vertex_frame f ON f.vertex_id = v.id AND f.sensor_id = d.sensor_id "
        "GROUP BY d.recording_id, d.person_id, d.sensor_id, f.frame_index, v.sweep_index, v.corner"
    )
    op.drop_table("disclosure")
    op.create_table(
        "disclosure",
        sa.Column("recording_id", sa.Uuid(), nullable=False),
        sa.Column("person_id", sa.Uuid(), nullable=False),
        sa.Column("sensor_id", sa.Uuid(), nullable=False),
        sa.Column("frame_index", sa.Integer(), nullable=False),
        sa.Column("sweep_index", sa.Integer(), nullable=False),
        sa.Column("corner", sa.String(length=10), server_default="top", nullable=False),
        sa.Column("told_in", sa.String(length=20), nullable=False),
        sa.Column("told_at", sa.BigInteger(), nullable=False),
        *_belonging("disclosure", "recording", "person", "sensor"),
        sa.PrimaryKeyConstraint(*_SEEN, name=op.f("pk_disclosure")),
    )
    columns = "recording_id, person_id, sensor_id, frame_index, sweep_index, corner, told_in, told_at"
    op.execute(f"INSERT INTO disclosure ({columns}) SELECT {columns} FROM disclosed")
    op.drop_table("disclosed")
    op.create_index("ix_disclosure_sensor_id", "disclosure", ["sensor_id"])
    of_sweep = ["recording_id", "person_id", "sweep_index"]
    op.create_index("ix_disclosure_recording_id_person_id_sweep_index", "disclosure", of_sweep)
    op.create_index("ix_vertex_frame_sensor_id_frame_index", "vertex_frame", ["sensor_id", "frame_index"])
    op.drop_index("ix_vertex_frame_sensor_id", "vertex_frame")
    op.create_table(
        "marking_progress",
        *(sa.Column(f"{name}_id", sa.Uuid(), nullable=False) for name in ("detection", "sensor", "person")),
        sa.Column("vertices", sa.Integer(), nullable=True),
        sa.Column("marks_wanted", sa.Integer(), nullable=True),
        *(sa.Column(name, sa.Integer(), nullable=False) for name in ("answered", "complete", "mine")),
        *_belonging("marking_progress", "detection", "sensor", "person"),
        sa.PrimaryKeyConstraint("detection_id", "sensor_id", "person_id", name=op.f("pk_marking_progress")),
    )
    for column in ("sensor_id", "person_id"):
        op.create_index(op.f(f"ix_marking_progress_{column}"), "marking_progress", [column])


def _belonging(table, *names):
    return [
        sa.ForeignKeyConstraint(
            [f"{name}_id"], [f"{name}.id"], name=op.f(f"fk_{table}_{name}_id"), ondelete="CASCADE"
        )
        for name in names
    ]


def downgrade():
    op.drop_table("marking_progress")
    op.create_index("ix_vertex_frame_sensor_id", "vertex_frame", ["sensor_id"])
    op.drop_index("ix_vertex_frame_sensor_id_frame_index", "vertex_frame")
    op.drop_table("disclosure")
    op.create_table(
        "disclosure",
        *(sa.Column(name, sa.Uuid(), nullable=False) for name in ("id", "recording_id", "person_id", "apex_id")),
        sa.Column("sensor_id", sa.Uuid(), nullable=False),
        sa.Column("told_in", sa.String(length=20), nullable=False),
        sa.Column("told_at", sa.BigInteger(), nullable=False),
        *_belonging("disclosure", "recording", "person", "apex", "sensor"),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_disclosure")),
        sa.UniqueConstraint(
            *("person_id", "sensor_id", "apex_id"), name=op.f("uq_disclosure_person_id_sensor_id_apex_id")
        ),
    )
    for column in ("recording_id", "apex_id", "sensor_id"):
        op.create_index(op.f(f"ix_disclosure_{column}"), "disclosure", [column])
