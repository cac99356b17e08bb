"""The joint that a camera is calibrated for, and files of recordings with their calibration put in.

Revision ID: 0014
Revises: 0013
"""

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None


def upgrade():
    op.add_column("rig_camera", sa.Column("joint", sa.JSON(none_as_null=True), nullable=True))
    op.create_table(
        "calibrated_copy",
        sa.Column("study_id", sa.Uuid(), nullable=False),
        sa.Column("blob_key", sa.String(length=300), nullable=False),
        sa.Column("file_name", sa.String(length=300), nullable=False),
        sa.ForeignKeyConstraint(
            ["study_id"], ["study.id"], name=op.f("fk_calibrated_copy_study_id"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(["blob_key"], ["blob.key"], name=op.f("fk_calibrated_copy_blob_key")),
        sa.PrimaryKeyConstraint("study_id", name=op.f("pk_calibrated_copy")),
    )
    op.create_index("ix_calibrated_copy_blob_key", "calibrated_copy", ["blob_key"])


def downgrade():
    op.drop_table("calibrated_copy")
    op.drop_column("rig_camera", "joint")
