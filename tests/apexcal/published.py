"""What the service published by itself for vehicles whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

from apexcal.client import Client
from benchmarks.judge.cases import Draw
from benchmarks.judge.judging import error_of
from workers.simulation.camera import FRONT


def published(owner: Client, draws: Mapping[UUID, Draw]) -> tuple[list[UUID], list[UUID]]:
    """Return the vehicles that a calibration was published for, and those of them where it is wrong."""
    results = {
        vehicle: owner.calibrations.result(current.result_id)
        for vehicle in draws
        for current in owner.calibrations.publications(vehicle, FRONT)
    }
    return list(results), [vehicle for vehicle, result in results.items() if error_of(draws[vehicle], result)[1]]
