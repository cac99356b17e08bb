"""Which token made a token, a sign-in link or a session: it ends with that one.

Revision ID: 0010
Revises: 0009
"""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

TABLES = ("api_token", "sign_in_link", "browser_session")


def upgrade():
    for table in TABLES:
        op.add_column(table, sa.Column("made_by", sa.Uuid(), nullable=True))


def downgrade():
    for table in TABLES:
        op.drop_column(table, "made_by")
