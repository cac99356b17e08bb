"""Whether a camera's images are raw or rectified.

Revision ID: 0025
Revises: 0019
"""

import sqlalchemy as sa
from alembic import op

revision = "0025"
down_revision = "0019"
branch_labels = None
depends_on = None


def upgrade():
    op.add_column("rig_camera", sa.Column("images", sa.JSON(none_as_null=True), nullable=True))


def downgrade():
    op.drop_column("rig_camera", "images")
