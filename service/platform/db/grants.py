"""What each role of PostgreSQL may do with which table: as little as its work takes.

Workers decode strangers' uploads, so their role changes no people, no roles, no pairs and no figure of a result that
is there, and moves no row to another fleet: it updates the columns that jobs write. Locking a row takes the right to
update some column of it. What a foreign key deletes or clears is done with the rights of the tables' owner.
"""

from __future__ import annotations

from collections.abc import Mapping

from service.platform.db.models import Base

OF_API = "apexcal_api"

_READ, _ADD, _CHANGE = "SELECT", "SELECT, INSERT", "SELECT, INSERT, UPDATE, DELETE"

WORKERS: Mapping[str, str] = {
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
    "blob_hold": _READ,
    "upload_part": _READ,
    # Fleets: of a fleet and a vehicle the rows are locked. The upkeep counts a fleet's bytes anew.
    "fleet": f"{_READ}, UPDATE (row_bytes)",
    "vehicle": f"{_READ}, UPDATE (version)",
    "rig": f'{_READ}, UPDATE (lidar_frame, lidar_topic, lidar_serial, "T_vehicle_lidar", camera_transforms, version)',
    "rig_camera": f"{_ADD}, UPDATE (images)",
    "person": "SELECT (id, name)",
    # Recordings
    "recording": f"{_READ}, UPDATE (state, facts, warnings, problem, taken_bytes, version)",
    "sensor": f"{_ADD}, DELETE",
    "camera_frame": _ADD,
    "packed_sweeps": _ADD,
    "packed_sweep": _ADD,
    # Vertices and marks
    "detection": f"{_READ}, UPDATE (state, remaining, counts, problem, finished_at)",
    "apex": _ADD,
    "vertex": f"{_ADD}, UPDATE (rank)",
    "vertex_frame": f"{_ADD}, DELETE",
    "answer": _READ,
    "marking_frontier": f"{_READ}, UPDATE (rank)",
    "marking_progress": f"{_READ}, DELETE",
    "analysis": f"{_ADD}, UPDATE (state, result, single_pairs, problem, job_id)",
    "analysis_file": _ADD,
    # Calibrations
    "correspondence_set": _READ,
    "calibration": f"{_READ}, UPDATE (state, remaining, summary, problem, finished_at)",
    "calibration_run": f"{_READ}, UPDATE (state, iteration, remaining, schedule, failure, finished_at)",
    "slot": _ADD,
    "result": f"{_ADD}, UPDATE (verdict, error_20m_mm, compared_with, checks)",
    "publication": _ADD,
    # What a job publishes is a line, whose moment is read.
    "audit_entry": "INSERT, SELECT (id, created_at)",
    "fleet_request": f"{_READ}, UPDATE (state, remaining, done, failed, cancelled, skipped, wave, finished_at)",
    "fleet_request_vehicle": f"{_READ}, UPDATE (state, problem, finished_at)",
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
    "packed_sweep": _READ,
    "job_event": _ADD,
    "job_total": _READ,
    "worker": _READ,
    "heartbeat": f"{_ADD}, UPDATE",
}


def statements(role: str, name: str) -> list[str]:
    """Take every right from the role called ``name``, in SQL ``role``, and give it its own.

    A role of another name than the API's has what workers have.
    """
    grants = API if name == OF_API else WORKERS
    return [
        f"REVOKE ALL ON ALL TABLES IN SCHEMA public FROM {role}",
        f"REVOKE ALL ON ALL SEQUENCES IN SCHEMA public FROM {role}",
        *(f"GRANT {rights} ON {table} TO {role}" for table, rights in grants.items()),
        f"GRANT USAGE ON ALL SEQUENCES IN SCHEMA public TO {role}",
    ]
