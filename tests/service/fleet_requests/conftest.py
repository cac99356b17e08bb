"""A fleet of vans with pairs, its engineer, and a worker in this process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from uuid import UUID

import pytest

from tests.faults.jobs import pairs
from tests.support.asking import bring_pairs
from tests.support.people import Actor, Api
from tests.support.uploads import RIG, new_vehicle

QUICK = {
    "models": ["pinhole"],
    "folds": 0,
    "schedule": {"population": 64, "generations": 6, "max_iterations": 2, "slots": 1},
}


@dataclass
class Vans:
    """Vans of one fleet, made and asked about by its engineer."""

    engineer: Actor
    fleet_id: UUID

    def add(self, name: str, count: int | None = 40) -> dict[str, Any]:
        """A van; with a correspondence set of ``count`` pairs, or with none."""
        made = new_vehicle(self.engineer, self.fleet_id, name)
        if count is not None:
            made["set"] = self.mark(made["rig"], count)
        return made

    def add_rig(self, van: dict[str, Any], name: str) -> str:
        """Another rig of a van."""
        return self.engineer.post(f"/vehicles/{van['vehicle']}/rigs", RIG | {"name": name}).json()["id"]

    def mark(self, rig_id: str, count: int, seed: int = 1) -> str:
        """A correspondence set, newer than all before it."""
        return bring_pairs(self.engineer, rig_id, pairs(count, seed))

    def ask(self, vehicles: dict[str, Any] | None = None, **more: Any) -> Any:
        """Ask for a quick calibration of the vans that a filter names; the response."""
        headers = more.pop("headers", {})
        body = {"vehicles": vehicles or {}, "calibration": QUICK, **more}
        return self.engineer.post(f"/fleets/{self.fleet_id}/fleet-requests", body, headers=headers)

    def read(self, request: dict[str, Any]) -> dict[str, Any]:
        """The request as it is now."""
        return self.engineer.get(f"/fleet-requests/{request['id']}").json()

    def states(self, request: dict[str, Any], **query: Any) -> dict[str, str]:
        """The vans' states by name."""
        items = self.engineer.get(f"/fleet-requests/{request['id']}/vehicles", params=query).json()["items"]
        return {item["vehicle"]: item["state"] for item in items}


@pytest.fixture
def vans(api: Api) -> Vans:
    """A fleet without vans yet."""
    fleet = api.fleet()
    return Vans(api.member(fleet, "engineer"), fleet)
