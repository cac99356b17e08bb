"""Vehicles with made pairs, brought in as any client does: a rig, and a correspondence set of 222 pairs."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple
from uuid import UUID

import numpy as np

from apexcal.client import Client
from apexcal.geometry.se3 import to_document
from benchmarks.accuracy.rigs import NOMINAL, Rig, draw_rig

_THREADS = 4


def draw(count: int, seed: int) -> list[Rig]:
    """Rigs of cameras without distortion, each with its own lens, mount and walk."""
    return [draw_rig("pinhole", np.random.default_rng([seed, number])) for number in range(count)]


def bring(client: Client, fleet_id: UUID, rigs: list[Rig]) -> list[UUID]:
    """Make a vehicle of each rig; ids of the vehicles in the order of the rigs."""

    def make(numbered: tuple[int, Rig]) -> UUID:
        number, rig = numbered
        vehicle = client.vehicles.create(fleet_id, f"vehicle {number:05d}")
        described = client.vehicles.create_rig(vehicle.id, _description(rig))
        client.correspondence_sets.import_pairs(described.id, "camera", _pairs(rig))
        return vehicle.id

    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(make, enumerate(rigs)))


class OneVehicle(NamedTuple):
    """Ids of a fleet of one vehicle, of its rig, and of the rig's set of pairs."""

    fleet: UUID
    vehicle: UUID
    rig: UUID
    pairs: UUID


def one_vehicle(client: Client, fleet_name: str, rig: Rig) -> OneVehicle:
    """Make a fleet with the vehicle of this rig."""
    fleet = client.fleets.create(fleet_name)
    (vehicle,) = bring(client, fleet.id, [rig])
    (described,) = client.vehicles.rigs(vehicle)
    (pairs,) = client.correspondence_sets.list(described.id)
    return OneVehicle(fleet.id, vehicle, described.id, pairs.id)


def _description(rig: Rig) -> dict[str, Any]:
    camera = {
        "name": "camera",
        "frame": NOMINAL.to_frame,
        "image_size": list(rig.image_size),
        "nominal": to_document(NOMINAL),
    }
    return {"name": "roof", "lidar": {"frame": NOMINAL.from_frame}, "cameras": [camera]}


def _pairs(rig: Rig) -> list[dict[str, Any]]:
    """Points in metres in the LiDAR's frame, marks in pixels; stamps 0.1 s apart."""
    rows = np.column_stack([rig.points, rig.marks]).tolist()
    return [
        dict(zip("xyzuv", row, strict=True)) | {"stamp_ns": number * 100_000_000} for number, row in enumerate(rows)
    ]
