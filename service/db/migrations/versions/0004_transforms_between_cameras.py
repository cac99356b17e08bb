"""What a rig knows of the transforms between its cameras.

Revision ID: 0004
Revises: 0003
"""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade():
    op.add_column("rig", sa.Column("camera_transforms", sa.JSON(none_as_null=True), nullable=True))


def downgrade():
    op.drop_column("rig", "camera_transforms")
