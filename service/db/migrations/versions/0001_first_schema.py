"""first schema

Revision ID: 0001
Revises:
"""

from service.db.migrations.first_schema import calibrations, fleets_and_work, recordings

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade():
    fleets_and_work.create()
    recordings.create()
    calibrations.create()
