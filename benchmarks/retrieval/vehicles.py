"""Vehicles with two cameras and several publications of each, written by the database itself."""

from __future__ import annotations

import json
from typing import NamedTuple
from uuid import UUID

import numpy as np
from sqlalchemy import text

from apexcal.geometry.rotations import rotation_from_euler
from apexcal.geometry.se3 import SE3, to_document
from service.platform.auth.credential_actions import new_secret, secret_hash
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
_ALL = "FROM generate_series(1, :vehicles) v, generate_series(1, :versions) n"
_EACH = f"{_ALL}, unnest(ARRAY['front', 'rear']) c"
_STATEMENTS = (
    f"INSERT INTO vehicle (id, fleet_id, name, sort_name, version, created_at)"
    f" SELECT {_V}, :fleet, 'car ' || v, 'car ' || v, 1, 0 FROM generate_series(1, :vehicles) v",
    f'INSERT INTO rig (id, fleet_id, vehicle_id, name, lidar_frame, version, created_at, "T_vehicle_lidar")'
    f" SELECT {_R}, :fleet, {_V}, 'roof', 'lidar', 1, 0, CAST(:vehicle_lidar AS json)"
    " FROM generate_series(1, :vehicles) v",
    f"INSERT INTO rig_camera (id, rig_id, position, name, frame, image_width, image_height, nominal, bounds)"
    f" SELECT {_S}, {_R}, CASE c WHEN 'front' THEN 0 ELSE 1 END, c, 'camera', 1920, 1200, CAST(:mount AS json),"
    " '{}'"
    " FROM generate_series(1, :vehicles) v, unnest(ARRAY['front', 'rear']) c",
    f"INSERT INTO correspondence_set (id, fleet_id, vehicle_id, rig_id, camera, source, content_hash, count, pairs,"
    f" flagged, notes, created_at)"
    f" SELECT {_S}, :fleet, {_V}, {_R}, c, 'import', md5('s' || v || c), 200, '{{}}', 0, '[]', 0"
    " FROM generate_series(1, :vehicles) v, unnest(ARRAY['front', 'rear']) c",
    f"INSERT INTO calibration (id, fleet_id, vehicle_id, rig_id, request, content_hash, state, remaining, publish,"
    f" notes, summary, created_at) SELECT {_C}, :fleet, {_V}, {_R}, '{{}}', '0', 'done', 0, 'none', '[]',"
    f" CAST(:summary AS json), 0 {_ALL}",
    f"INSERT INTO calibration_run (id, fleet_id, calibration_id, set_id, camera, model, fold, farm, slots, bundle,"
    f" problem, state, iteration, remaining, cancel_requested, created_at)"
    f" SELECT {_N}, :fleet, {_C}, {_S}, c, 'brown_conrady', -1, 'runs', 1, 1, '{{}}', 'done', 1, 0, false, 0 {_EACH}",
    f"INSERT INTO result (id, fleet_id, calibration_id, run_id, camera, model, fold, document, created_at)"
    f" SELECT {_E}, :fleet, {_C}, {_N}, c, 'brown_conrady', -1, CAST(:result AS json), 0 {_EACH}",
    f"INSERT INTO publication (id, fleet_id, vehicle_id, camera, alias, result_id, led_to, number, created_at)"
    f" SELECT {_P}, :fleet, {_V}, c, 'current', {_E}, {_E}, n, n {_EACH}",
    "ANALYZE",
)


class Fleet(NamedTuple):
    """The ids of the vehicles, in their order, and a token that may publish for them."""

    vehicles: list[UUID]
    token: str


def make(database: Database, vehicles: int, versions: int) -> Fleet:
    """A fleet of so many vehicles, each camera of which was given so many results one after the other."""
    token = new_secret("apx_")
    given = {"vehicles": vehicles, "versions": versions, "hash": secret_hash(token)}
    given |= {name: json.dumps(one) for name, one in (("mount", _MOUNT), ("vehicle_lidar", _VEHICLE_LIDAR))}
    given |= {"summary": json.dumps(_SUMMARY), "result": json.dumps(_RESULT)}
    with database.writing() as session:
        given["fleet"] = session.scalar(
            text(
                "INSERT INTO fleet (id, name, version, created_at) VALUES (gen_random_uuid(), 'F', 1, 0) RETURNING id"
            )
        )
        given["person"] = session.scalar(
            text(
                "INSERT INTO person (id, name, is_owner, created_at) VALUES (gen_random_uuid(), 'P', false, 0)"
                " RETURNING id"
            )
        )
        session.execute(
            text(
                "INSERT INTO membership (person_id, fleet_id, role, created_at) VALUES (:person, :fleet, 'admin', 0)"
            ),
            given,
        )
        session.execute(
            text(
                "INSERT INTO api_token (id, secret_hash, name, person_id, created_at)"
                " VALUES (gen_random_uuid(), :hash, 'bench', :person, 0)"
            ),
            given,
        )
        for statement in _STATEMENTS:
            session.execute(text(statement), given)
        ids = session.scalars(text(f"SELECT {_V} FROM generate_series(1, :vehicles) v ORDER BY v"), given).all()
    return Fleet(list(ids), token)
