"""first schema

Revision ID: 0001
Revises:
"""

from alembic import op

from service.platform.db.models import Base

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade():
    # Until the first tag, today's schema (docs/decisions/0021-one-version-until-the-first-tag.md).
    Base.metadata.create_all(op.get_bind())
