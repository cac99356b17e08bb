"""The work that the fault tests interrupt: a recording to ingest and detect in, a calibration to solve."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from apexcal.client import Client
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.fleets import RigOut, VehicleOut

REGION = {"all": [{"quantity": "x", "op": ">", "value": 1.0}, {"quantity": "z", "op": ">", "value": -1.2}]}
# A slot of about an eighth of a second, so that a kill finds somebody at work.
# Least squares end where they end from a longer search; a third of its time.
SHORT = {"slots": 4, "population": 400, "generations": 20, "max_iterations": 8}
SLOW = {"slots": 4, "population": 1000, "generations": 400, "max_iterations": 2}


class Walk(NamedTuple):
    """A simulated recording and the rig that it was made with."""

    bag: Path
    rig: dict[str, Any]


def new_rig(client: Client, rig: dict[str, Any], name: str) -> tuple[VehicleOut, RigOut]:
    """A vehicle of a new fleet with this rig."""
    vehicle = client.vehicles.create(client.fleets.create(name).id, "car")
    return vehicle, client.vehicles.create_rig(vehicle.id, rig)


def pairs(count: int = 200, seed: int = 1) -> list[dict[str, float]]:
    """Pairs over the whole image of a pinhole camera near the nominal mount, with half a pixel of noise.

    x forward, metres; u v pixels; along lanes from side to side. From 60 pairs on a fit passes its checks.
    """
    random = np.random.default_rng(seed)
    u, v, x = random.uniform((40, 40, 4), (920, 560, 30), (count, 3)).T
    u, v, x = (values[np.lexsort((u, np.floor(x / 2)))] for values in (u, v, x))
    y, z = (480 - u) * x / 500, 0.1 - (v - 300) * x / 500
    u, v = np.stack([u, v]) + random.normal(0, 0.5, (2, count))
    columns = {"x": x, "y": y, "z": z, "u": u, "v": v}
    stamps = (np.arange(count) * 400_000_000).tolist()
    return [
        {**{name: float(values[index]) for name, values in columns.items()}, "stamp_ns": stamps[index]}
        for index in range(count)
    ]


LEVEL_RIG: dict[str, Any] = {
    "name": "roof",
    "lidar": {"frame": "velodyne", "topic": None},
    "T_vehicle_lidar": None,
    "cameras": [
        {
            "name": "front",
            "frame": "camera_front_optical",
            "topic": None,
            "image_size": [960, 600],
            "nominal": {
                "to_frame": "camera_front_optical",
                "from_frame": "velodyne",
                "rotation": {"euler_order": "zyx", "angles_deg": [90.0, -90.0, 0.0]},
                "translation_m": [0.0, 0.0, 0.0],
            },
            "bounds": {},
        }
    ],
}


def ask(
    client: Client, name: str, *, models: Sequence[str] = ("pinhole",), folds: int = 0, **request: Any
) -> CalibrationView:
    """Ask for a calibration of made pairs on a new vehicle; the same name-independent request gives the same seed."""
    vehicle, rig = new_rig(client, LEVEL_RIG, name)
    made = client.correspondence_sets.import_pairs(rig.id, "front", pairs())
    request = {"models": list(models), "folds": folds, "farm": "slots", "schedule": SLOW, **request}
    return client.calibrations.create(vehicle.id, [made.id], **request)


def ask_two_cameras(client: Client, name: str, **request: Any) -> CalibrationView:
    """The same for two cameras of one rig that saw the same vertices, with blocks held out, from one seed."""
    cameras = [LEVEL_RIG["cameras"][0], copy.deepcopy(LEVEL_RIG["cameras"][0])]
    cameras[1] |= {"name": "left", "frame": "camera_left_optical"}
    cameras[1]["nominal"]["to_frame"] = "camera_left_optical"
    vehicle, rig = new_rig(client, LEVEL_RIG | {"cameras": cameras}, name)
    seen = pairs()
    random = np.random.default_rng(2)
    other = [pair | {"u": pair["u"] + random.normal(0, 1), "v": pair["v"] + random.normal(0, 1)} for pair in seen]
    sets = [
        client.correspondence_sets.import_pairs(rig.id, camera, marked).id
        for camera, marked in (("front", seen), ("left", other))
    ]
    return client.calibrations.create(vehicle.id, sets, ["pinhole"], **{"folds": 2, "schedule": SHORT, **request})
