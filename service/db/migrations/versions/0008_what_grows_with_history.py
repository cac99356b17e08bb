"""Indexes, so that nothing that runs all the time grows with the history; how far each person's marking is.

On PostgreSQL they are made while others write: an index that a broken migration left unfinished is made anew.

Revision ID: 0008
Revises: 0007
"""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

_UNENDED = "state IN ('queued', 'running')"
_WHOLE = (
    ("ix_browser_session_expires_at", "browser_session", "expires_at"),
    ("ix_calibration_vehicle_id_id", "calibration", "vehicle_id", "id"),
    ("ix_correspondence_set_rig_id_id", "correspondence_set", "rig_id", "id"),
    ("ix_fleet_request_fleet_id_id", "fleet_request", "fleet_id", "id"),
    ("ix_fleet_request_vehicle_fleet_request_id_id", "fleet_request_vehicle", "fleet_request_id", "id"),
    ("ix_idempotency_key_created_at", "idempotency_key", "created_at"),
    ("ix_job_fleet_id_id", "job", "fleet_id", "id"),
    ("ix_recording_fleet_id_id", "recording", "fleet_id", "id"),
    ("ix_recording_fleet_id_state_id", "recording", "fleet_id", "state", "id"),
    ("ix_recording_job_id", "recording", "job_id"),
    ("ix_recording_vehicle_id_id", "recording", "vehicle_id", "id"),
    ("ix_sign_in_link_expires_at", "sign_in_link", "expires_at"),
    ("ix_study_job_id", "study", "job_id"),
    ("ix_vehicle_fleet_id_id", "vehicle", "fleet_id", "id"),
)
# Name, table, condition (where the databases differ: PostgreSQL's, SQLite's), columns.
_PARTIAL = (
    ("ix_calibration_done", "calibration", "state = 'done'", "vehicle_id", "finished_at"),
    ("ix_calibration_run_unended", "calibration_run", _UNENDED, "id"),
    (
        "ix_calibration_run_cancelled",
        "calibration_run",
        (f"cancel_requested AND {_UNENDED}", f"cancel_requested = 1 AND {_UNENDED}"),
        "id",
    ),
    ("ix_correspondence_set_made", "correspondence_set", "brought_at IS NULL", "rig_id", "camera", "created_at"),
    (
        "ix_correspondence_set_brought",
        "correspondence_set",
        "brought_at IS NOT NULL",
        *("rig_id", "camera", "brought_at"),
    ),
    ("ix_fleet_request_running", "fleet_request", "state = 'running'", "id"),
    ("ix_job_due", "job", "state = 'queued' AND send_after IS NOT NULL", "send_after"),
    ("ix_job_released", "job", "state = 'queued' AND sends > 0", "fleet_id", "queue", "state", "id"),
    ("ix_job_running", "job", "state = 'running'", "id"),
    (
        "ix_job_cancelled",
        "job",
        ("state = 'queued' AND cancel_requested", "state = 'queued' AND cancel_requested = 1"),
        "id",
    ),
    ("ix_job_unwanted", "job", "state IN ('failed', 'cancelled')", "fleet_id", "state", "id"),
    ("ix_job_finished_at", "job", "finished_at IS NOT NULL", "finished_at"),
    ("ix_marking_task_open", "marking_task", "answered_at IS NULL", "sensor_id", "leased_until"),
    ("ix_recording_retain_until", "recording", "retain_until IS NOT NULL", "retain_until"),
)
# While an index is made PostgreSQL waits for every transaction that began before. Nobody waits for it meanwhile.
_WAIT_S = 60


def upgrade():
    _make_frontiers()
    wanted = [(name, table, {}, columns) for name, table, *columns in _WHOLE]
    wanted += [(name, table, _where(where), columns) for name, table, where, *columns in _PARTIAL]
    if op.get_bind().dialect.name == "sqlite":
        for name, table, where, columns in wanted:
            op.create_index(name, table, columns, **where)
        return
    with op.get_context().autocommit_block():
        before = op.get_bind().scalar(sa.text("SHOW lock_timeout"))
        op.execute(f"SET lock_timeout = '{_WAIT_S}s'")
        for name, table, where, columns in wanted:
            _drop_unfinished(name)
            op.create_index(name, table, columns, postgresql_concurrently=True, if_not_exists=True, **where)
        op.execute(f"SET lock_timeout = '{before}'")


def _make_frontiers():
    if sa.inspect(op.get_bind()).has_table("marking_frontier"):  # an unfinished migration made it
        return
    op.create_table(
        "marking_frontier",
        sa.Column("detection_id", sa.Uuid(), nullable=False),
        sa.Column("sensor_id", sa.Uuid(), nullable=False),
        sa.Column("person_id", sa.Uuid(), nullable=False),
        sa.Column("recording_id", sa.Uuid(), nullable=False),
        sa.Column("marks_wanted", sa.Integer(), nullable=False),
        sa.Column("rank", sa.Integer(), nullable=False),
        *(
            sa.ForeignKeyConstraint(
                [f"{name}_id"], [f"{name}.id"], name=op.f(f"fk_marking_frontier_{name}_id"), ondelete="CASCADE"
            )
            for name in ("detection", "sensor", "person", "recording")
        ),
        sa.PrimaryKeyConstraint("detection_id", "sensor_id", "person_id", name=op.f("pk_marking_frontier")),
    )
    for name in ("sensor_id", "person_id", "recording_id"):
        op.create_index(op.f(f"ix_marking_frontier_{name}"), "marking_frontier", [name])


def _where(where):
    postgresql, sqlite = (where, where) if isinstance(where, str) else where
    return {"postgresql_where": sa.text(postgresql), "sqlite_where": sa.text(sqlite)}


def _drop_unfinished(name):
    unfinished = sa.text("SELECT NOT indisvalid FROM pg_index WHERE indexrelid = to_regclass(:name)")
    if op.get_bind().scalar(unfinished, {"name": name}):
        op.execute(f"DROP INDEX CONCURRENTLY {name}")


def downgrade():
    for name, table, *_ in (*_WHOLE, *_PARTIAL):
        op.drop_index(name, table)
    op.drop_table("marking_frontier")
