"""When the pairs of a set were last brought: who brings old ones again means them.

Revision ID: 0005
Revises: 0004
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade():
    op.add_column("correspondence_set", sa.Column("brought_at", sa.BigInteger(), nullable=True))


def downgrade():
    op.drop_column("correspondence_set", "brought_at")
