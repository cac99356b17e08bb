"""Rights of each role of PostgreSQL on each table: as few as its work takes.

Workers decode strangers' uploads, so their role changes no people, no roles, no pairs and no figure of a result that
is there, and moves no row to another fleet: it updates the columns that jobs write. Locking a row takes the right to
update some column of it. What a foreign key deletes or clears is done with the rights of the tables' owner.
"""

from __future__ import annotations

from collections.abc import Mapping

from service.platform.db.models import Base

OF_API, OF_INGEST = "apexcal_api", "apexcal_ingest"

_READ, _ADD, _CHANGE = "SELECT", "SELECT, INSERT", "SELECT, INSERT, UPDATE, DELETE"

WORKERS: Mapping[str, str] = {
    **dict.fromkeys(("blob_hold", "upload_part", "answer", "correspondence_set", "fleet_request"), _READ),
    **dict.fromkeys(("camera_frame", "analysis_file", "apex", "slot"), _ADD),
    # Jobs
    "job": (
        f"{_ADD}, UPDATE (state, attempt, lost, sends, send_after, lease_until, cancel_requested, worker, progress, "
        "problem, started_at, finished_at)"
    ),
    "job_event": f"{_ADD}, UPDATE (tallied)",
    "job_total": f"{_ADD}, UPDATE (count, seconds, buckets)",
    "worker": f"{_ADD}, UPDATE (at, warm), DELETE",
    "heartbeat": f"{_ADD}, UPDATE (at)",
    # Files
    "blob": f"{_ADD}, UPDATE (state, size, sha256, failed_removals, remove_after), DELETE",
    # Fleets: of a fleet and a vehicle the rows are locked. The upkeep counts a fleet's bytes anew.
    "fleet": f"{_READ}, UPDATE (row_bytes)",
    "vehicle": f"{_READ}, UPDATE (version)",
    "rig": f"{_READ}, UPDATE (camera_transforms, version)",
    "rig_lidar": f'{_READ}, UPDATE (frame, topic, serial, "T_vehicle_lidar")',
    "rig_camera": f"{_ADD}, UPDATE (images)",
    "person": "SELECT (id, name)",
    # Recordings
    "recording": f"{_READ}, UPDATE (state, facts, warnings, problem, taken_bytes, version)",
    "sensor": f"{_ADD}, DELETE",
    # Vertices and marks
    "detection": f"{_READ}, UPDATE (state, remaining, counts, problem, finished_at)",
    "vertex": f"{_ADD}, UPDATE (rank)",
    "vertex_frame": f"{_ADD}, DELETE",
    "marking_frontier": f"{_READ}, UPDATE (rank)",
    "marking_progress": f"{_READ}, DELETE",
    "analysis": f"{_ADD}, UPDATE (state, result, single_pairs, problem, job_id)",
    # Calibrations
    "calibration": f"{_READ}, UPDATE (state, remaining, summary, problem, finished_at)",
    "calibration_run": f"{_READ}, UPDATE (state, iteration, remaining, search_state, problem, finished_at)",
    "result": f"{_ADD}, UPDATE (verdict, error_20m_mm, compared_with, checks)",
    # What a job publishes is a line of the audit, whose moment is read.
    "publication": _ADD,
    "audit_entry": "INSERT, SELECT (id, created_at)",
    "fleet_request_vehicle": f"{_READ}, UPDATE (state, problem, finished_at)",
}

# Workers of the queue `ingest` alone: they meet strangers' bytes, and read and write what becomes of an upload.
INGEST: Mapping[str, str] = {
    table: WORKERS[table]
    for table in (
        *("worker", "upload_part", "rig", "rig_lidar", "rig_camera", "recording", "sensor", "camera_frame"),
        *("analysis_file", "audit_entry"),
    )
} | {
    "job": WORKERS["job"].replace("cancel_requested, ", ""),
    "job_event": _ADD,
    "blob": f"{_ADD}, UPDATE (state, size, sha256)",
    "fleet": f"{_READ}, UPDATE (version)",
    "analysis": f"{_READ}, UPDATE (state, result, problem, job_id)",
    # A rig may get its cameras, so what cars are answered is compared.
    "vehicle": _READ,
    "publication": _READ,
    "result": "SELECT (id, calibration_id)",
    "calibration": "SELECT (id, rig_id)",
}

# It does what people ask for. It makes no owner of who is there, and changes nothing that only workers or time make.
API: Mapping[str, str] = dict.fromkeys(Base.metadata.tables, _CHANGE) | {
    "alembic_version": _READ,
    "person": f"{_ADD}, UPDATE (name)",
    "audit_entry": f"{_ADD}, UPDATE (effect), DELETE",
    "publication": _ADD,
    "result": f"{_READ}, UPDATE (verdict, checks), DELETE",
    "slot": f"{_READ}, DELETE",
    "camera_frame": _READ,
    "job_event": _ADD,
    "job_total": _READ,
    "worker": _READ,
    "heartbeat": f"{_ADD}, UPDATE",
}


def statements(role: str, name: str) -> list[str]:
    """Take every right from the role called ``name``, in SQL ``role``, and give it its own.

    A role of another name has what workers have.
    """
    grants = {OF_API: API, OF_INGEST: INGEST}.get(name, WORKERS)
    return [
        f"REVOKE ALL ON ALL TABLES IN SCHEMA public FROM {role}",
        f"REVOKE ALL ON ALL SEQUENCES IN SCHEMA public FROM {role}",
        *(f"GRANT {rights} ON {table} TO {role}" for table, rights in grants.items()),
        f"GRANT USAGE ON ALL SEQUENCES IN SCHEMA public TO {role}",
    ]
