"""Moves of aliases remember the result that they led to after it is deleted.

Revision ID: 0017
Revises: 0016
"""

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade():
    # Without a foreign key: the id stays when the result goes.
    op.add_column("alias_move", sa.Column("led_to", sa.Uuid(), nullable=True))
    op.execute("UPDATE alias_move SET led_to = result_id")


def downgrade():
    op.drop_column("alias_move", "led_to")
