"""All corners of the board: of vertices, their frames and marks, and those that people are to mark.

Revision ID: 0016
Revises: 0015
"""

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None

_OF_A_CORNER = ("apex", "vertex", "mark")
_LISTS = (
    ("vertex", "corners"),
    ("vertex", "corner_covariance"),
    ("vertex_frame", "corners"),
    ("detection", "marked_corners"),
)
_ONE_MARK = ("person_id", "sensor_id", "frame_index")


def upgrade():
    for table in _OF_A_CORNER:
        op.add_column(table, sa.Column("corner", sa.String(length=10), server_default="top", nullable=False))
    for table, column in _LISTS:
        op.add_column(table, sa.Column(column, sa.JSON(none_as_null=True), nullable=True))
    _one_mark_for(before=_ONE_MARK, after=(*_ONE_MARK, "corner"))


def downgrade():
    # Without its column another corner would be taken for a tip. What hangs on a vertex or an apex goes with it.
    for table in ("mark", "vertex", "apex"):
        op.execute(f"DELETE FROM {table} WHERE corner <> 'top'")
    _one_mark_for(before=(*_ONE_MARK, "corner"), after=_ONE_MARK)
    for table in _OF_A_CORNER:
        op.drop_column(table, "corner")
    for table, column in _LISTS:
        op.drop_column(table, column)


def _one_mark_for(*, before, after):
    """A looser constraint: whatever an older version writes still fits it."""
    with op.batch_alter_table("mark") as mark:
        mark.drop_constraint(_name(before), type_="unique")
        mark.create_unique_constraint(_name(after), list(after))


def _name(columns):
    return f"uq_mark_{'_'.join(columns)}"
