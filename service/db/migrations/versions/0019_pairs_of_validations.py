"""Validations keep what they say of single pairs beside what lists show.

Revision ID: 0019
Revises: 0017
"""

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0017"
branch_labels = None
depends_on = None


def upgrade():
    op.add_column("validation", sa.Column("single_pairs", sa.JSON(none_as_null=True), nullable=True))


def downgrade():
    op.drop_column("validation", "single_pairs")
