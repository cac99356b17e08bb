"""A selection of pairs names a whole set and what it leaves out of it.

Revision ID: 0020_selections
Revises: 0019
"""

import sqlalchemy as sa
from alembic import op

revision = "0020_selections"
down_revision = "0019"
branch_labels = None
depends_on = None


def upgrade():
    with op.batch_alter_table("correspondence_set") as table:
        table.alter_column("pairs", existing_type=sa.JSON(none_as_null=True), nullable=True)
        table.add_column(sa.Column("whole_id", sa.Uuid(), nullable=True))
        table.add_column(sa.Column("left_out", sa.JSON(none_as_null=True), nullable=True))
        table.add_column(sa.Column("flagged", sa.Integer(), server_default="0", nullable=False))
        table.create_foreign_key(
            "fk_correspondence_set_whole_id", "correspondence_set", ["whole_id"], ["id"], ondelete="CASCADE"
        )
        table.create_index("ix_correspondence_set_whole_id", ["whole_id"])


def downgrade():
    op.execute("DELETE FROM correspondence_set WHERE whole_id IS NOT NULL")
    with op.batch_alter_table("correspondence_set") as table:
        table.drop_index("ix_correspondence_set_whole_id")
        table.drop_constraint("fk_correspondence_set_whole_id", type_="foreignkey")
        table.drop_column("flagged")
        table.drop_column("left_out")
        table.drop_column("whole_id")
        table.alter_column("pairs", existing_type=sa.JSON(none_as_null=True), nullable=False)
