"""A camera's publications are numbered, and say why they were made and what spoke against them.

Revision ID: 0007
Revises: 0006
"""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade():
    # Rows that are there stay without a number: they keep their order, and the next publication numbers them.
    op.add_column("publication", sa.Column("number", sa.Integer(), nullable=True))
    op.add_column("publication", sa.Column("reason", sa.String(length=500), nullable=True))
    op.add_column("publication", sa.Column("overridden", sa.JSON(none_as_null=True), nullable=True))
    op.create_index(
        "uq_publication_vehicle_id_camera_number", "publication", ["vehicle_id", "camera", "number"], unique=True
    )
    op.create_index(
        "ix_publication_newness",
        "publication",
        ["vehicle_id", "camera", sa.text("coalesce(number, 2147483647)"), "created_at", "id"],
    )
    op.drop_index("ix_publication_vehicle_id_camera_created_at", "publication")


def downgrade():
    op.create_index(
        "ix_publication_vehicle_id_camera_created_at", "publication", ["vehicle_id", "camera", "created_at"]
    )
    op.drop_index("ix_publication_newness", "publication")
    op.drop_index("uq_publication_vehicle_id_camera_number", "publication")
    op.drop_column("publication", "overridden")
    op.drop_column("publication", "reason")
    op.drop_column("publication", "number")
