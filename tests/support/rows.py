"""Rows as tests need them: what a test does not name holds the usual, and keys follow from the rows it belongs to."""

from __future__ import annotations

from typing import Any, TypeVar

from sqlalchemy import inspect
from sqlalchemy.orm import Session

from service.platform.db import models
from service.platform.db.base import Base

Row = TypeVar("Row", bound=Base)

# LiDAR axes (x forward, y left, z up) to optical ones (x right, y down, z forward), and a place beside it.
LEVEL = {
    "to_frame": "camera_front_optical",
    "from_frame": "velodyne",
    "rotation": {"matrix": [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]},
    "translation_m": [0.0, -0.1, -0.2],
}
WIDTH, HEIGHT = 640, 480
_OPTICAL = {"frame": "camera_front_optical", "image_width": WIDTH, "image_height": HEIGHT, "nominal": LEVEL}
_PIXELS = {"media_type": "image/jpeg", "width": WIDTH, "height": HEIGHT}
_REGION = {"all": [{"quantity": "x", "op": ">", "value": 0.0}]}
_FIT = {"camera": "front", "model": "pinhole", "fold": -1}

USUAL: dict[type[Base], dict[str, Any]] = {
    models.Vehicle: {"name": "car"},
    models.Rig: {"name": "roof"},
    models.RigLidar: {"position": 0, "name": "lidar", "frame": "velodyne"},
    models.RigCamera: {"position": 0, "name": "front", "bounds": {}, **_OPTICAL},
    models.Recording: {"name": "walk", "file_name": "walk.bag", "state": "ready"},
    models.Blob: {"state": "stored"},
    models.Sensor: {"kind": "camera", "name": "front", "topic": "/front", "frame_id": "front", "facts": {}}
    | {"count": 1, "first_ns": 0, "last_ns": 0},
    models.CameraFrame: {"index": 0, "stamp_ns": 0, "offset": 0, "length": 1, **_PIXELS},
    models.Detection: {"region": _REGION, "detector": "tolerant", "options": {}, "pairing": {}, "content_hash": "0"}
    | {"state": "done", "remaining": 0, "counts": {}},
    models.Apex: {"sweep_index": 0, "x": 1.0, "y": 0.0, "z": 0.0},
    models.Vertex: {"rank": 0, "sweep_index": 0, "time_ns": 0, "x": 1.0, "y": 0.0, "z": 0.0, "ring": 7, "points": 2},
    models.CorrespondenceSet: {"camera": "front", "source": "import", "content_hash": "0", "count": 0, "pairs": {}},
    models.Calibration: {"request": {}, "content_hash": "0", "state": "done", "remaining": 0, "publish": "none"},
    models.CalibrationRun: {**_FIT, "farm": "slots", "slots": 2, "bundle": 1, "fit_request": {}},
    models.Result: {**_FIT, "document": {}},
    models.Slot: {"iteration": 0, "slot": 0, "loss": 1.0, "parameters": [0.0], "evaluations": 1, "seconds": 0.01}
    | {"worker": "worker"},
    models.Publication: {"camera": "front", "alias": "current", "number": 1},
    models.FleetRequest: {"asked": {"vehicles": {}, "calibration": {"publish": "none"}}},
    models.Job: {"kind": "ingest", "queue": "ingest"},
}


def make(table: type[Row], *owners: Base, **columns: Any) -> Row:
    """Return a new row. ``owners`` state its keys: their own ids, and the keys that they have themselves."""
    names = {attribute.key for attribute in inspect(table).column_attrs}
    stated: dict[str, Any] = {}
    for owner in owners:
        keys = {name: name for name in vars(owner) if name.endswith("_id") and name != "job_id"}
        own_name = owner.__tablename__
        keys |= dict.fromkeys((f"{own_name}_id", f"{own_name.rpartition('_')[2]}_id"), "id")
        if isinstance(owner, models.Sensor):
            keys["lidar_id"] = "id"
        stated |= {key: getattr(owner, name, None) for key, name in keys.items() if key in names}
    stated = {key: value for key, value in stated.items() if value is not None}
    if table is models.Rig:
        columns.setdefault("lidars", [make(models.RigLidar)])
    return table(**{**USUAL.get(table, {}), **stated, **columns})


def add(session: Session, table: type[Row], *owners: Base, **columns: Any) -> Row:
    """Insert such a row and return it."""
    row = make(table, *owners, **columns)
    session.add(row)
    session.flush()
    return row
