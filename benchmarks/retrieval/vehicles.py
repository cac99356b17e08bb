"""Vehicles with two cameras and several publications of each, written by the database itself."""

from __future__ import annotations

import json
from typing import Any
from uuid import UUID

import numpy as np
from sqlalchemy import TextClause, insert, select, text

from apexcal.geometry.rotations import rotation_from_euler
from apexcal.geometry.se3 import SE3, to_document
from service.platform.db.base import Base
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.platform.db.fleets import Rig, RigCamera, RigLidar, Vehicle
from service.platform.db.session import Database
from tests.support.results import fit_result, model_summary, summary

CAMERAS = ("front", "rear")

_AHEAD = rotation_from_euler(np.radians([90.1, -89.9, 0.3]), "zyx")
_MOUNT = to_document(SE3("camera", "lidar", _AHEAD, np.array([0.01, -0.1, -0.2])))
_VEHICLE_LIDAR = {
    "to_frame": "base_link", "from_frame": "lidar", "rotation": {"quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    "translation_m": [1.2, 0.0, 1.9],
}  # fmt: skip
_LENS = dict.fromkeys(("f_x", "f_y", "c_x", "c_y", "skew", "k1", "k2", "k3", "k4", "k5"), 123.456789012)
_DEVIATIONS = dict.fromkeys(("rotation_x", "rotation_y", "rotation_z"), 0.0123456789)
# A result's document of the sizes that count: 100 pairs with their residuals and a covariance.
_RESULT = fit_result(
    "brown_conrady", 0.74, pairs=100, residuals_px=[0.6123456] * 100, transform=_MOUNT, std=_DEVIATIONS,
    intrinsics={"model": "brown_conrady", "image_size": [1920, 1200], **_LENS},
    covariance={"names": list("0123456789"), "units": [""] * 10, "matrix": [[1.234567e-6] * 10] * 10},
)  # fmt: skip
_MODEL = model_summary(UUID(int=0), _RESULT, heldout_mean_px=0.7, heldout_rms_px=0.8)
_SUMMARY = {
    "cameras": {name: summary({"brown_conrady": _MODEL}, name)["cameras"][name] for name in CAMERAS},
    "rig": None,
}

# An id of a row is the MD5 of what it is.
_OF = "CAST(md5({}) AS uuid)"
_V, _R, _S = (_OF.format(one) for one in ("'v' || v", "'r' || v", "'s' || v || c"))
_C, _N, _E = (
    _OF.format(one) for one in ("'c' || v || '/' || n", "'n' || v || '/' || n || c", "'e' || v || '/' || n || c")
)
_P = _OF.format("'p' || v || '/' || n || c")
_VEHICLES = "generate_series(1, :vehicles) v"
_VERSIONS = f"{_VEHICLES}, generate_series(1, :versions) n"
_CAMERAS = ", unnest(ARRAY['front', 'rear']) c"
_CAR = {"fleet_id": ":fleet", "vehicle_id": _V}
# What each column of so many rows is, in SQL; the others have the model's defaults.
_ROWS: tuple[tuple[type[Base], str, dict[str, str]], ...] = (
    (Vehicle, _VEHICLES, {"id": _V, "fleet_id": ":fleet", "name": "'car ' || v", "sort_name": "'car ' || v"}),
    (Rig, _VEHICLES, _CAR | {"id": _R, "name": "'roof'"}),
    (
        RigLidar, _VEHICLES,
        {"id": _R, "rig_id": _R, "position": "0", "name": "'lidar'", "frame": "'lidar'",
         "T_vehicle_lidar": "CAST(:vehicle_lidar AS json)"},
    ),
    (
        RigCamera, _VEHICLES + _CAMERAS,
        {"id": _S, "rig_id": _R, "position": "CASE c WHEN 'front' THEN 0 ELSE 1 END", "name": "c",
         "frame": "'camera'", "image_width": "1920", "image_height": "1200",
         "nominal": "CAST(:mount AS json)", "bounds": "'{}'::json"},
    ),
    (
        CorrespondenceSet, _VEHICLES + _CAMERAS,
        _CAR | {"id": _S, "rig_id": _R, "camera": "c", "source": "'import'", "content_hash": "md5('s' || v || c)",
                "count": "200", "pairs": "'{}'::json"},
    ),
    (
        Calibration, _VERSIONS,
        _CAR | {"id": _C, "rig_id": _R, "request": "'{}'::json", "content_hash": "'0'", "state": "'done'",
                "remaining": "0", "publish": "'none'", "summary": "CAST(:summary AS json)"},
    ),
    (
        CalibrationRun, _VERSIONS + _CAMERAS,
        {"id": _N, "fleet_id": ":fleet", "calibration_id": _C, "set_id": _S, "camera": "c",
         "model": "'brown_conrady'", "fold": "-1", "farm": "'runs'", "slots": "1", "bundle": "1",
         "fit_request": "'{}'::json", "state": "'done'", "iteration": "1"},
    ),
    (
        Result, _VERSIONS + _CAMERAS,
        {"id": _E, "fleet_id": ":fleet", "calibration_id": _C, "run_id": _N, "camera": "c",
         "model": "'brown_conrady'", "fold": "-1", "document": "CAST(:result AS json)"},
    ),
    (
        Publication, _VERSIONS + _CAMERAS,
        _CAR | {"id": _P, "camera": "c", "alias": "'current'", "result_id": _E, "led_to": _E, "number": "n"},
    ),
)  # fmt: skip


def make(database: Database, fleet_id: UUID, vehicles: int, versions: int) -> list[UUID]:
    """Ids of so many vehicles, each camera of which was given so many results one after the other."""
    documents = {"mount": _MOUNT, "vehicle_lidar": _VEHICLE_LIDAR, "summary": _SUMMARY, "result": _RESULT}
    values: dict[str, Any] = {"vehicles": vehicles, "versions": versions, "fleet": fleet_id}
    values |= {name: json.dumps(document) for name, document in documents.items()}
    with database.writing() as session:
        for model, source, columns in _ROWS:
            rows = select(*(_sql(column, values) for column in columns.values())).select_from(_sql(source, values))
            session.execute(insert(model.__table__).from_select(list(columns), rows))
        session.execute(text("ANALYZE"))
        return list(session.scalars(text(f"SELECT {_V} FROM {_VEHICLES} ORDER BY v"), values).all())


def _sql(sql: str, values: dict[str, Any]) -> TextClause:
    return text(sql).bindparams(**{name: value for name, value in values.items() if f":{name}" in sql})
