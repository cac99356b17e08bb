"""Plans a fleet request: for each vehicle an ordinary calibration, or the reason why there is none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session, selectinload

from apexcal.documents.calibrations import CalibrationRequest, CalibrationTemplate
from service.calibrations.lens_queries import with_recorded_lenses
from service.calibrations.plan import CalibrationPlan, plan_request
from service.calibrations.resolve import CameraPairs, resolve_template
from service.calibrations.work_rules import check_fleet_total
from service.fleet_requests.vehicle_queries import Chosen, in_chunks
from service.platform.db.base import Json
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.fleets import Rig
from service.platform.http.problems import Problem, unprocessable
from service.platform.jobs.bundles import run_cost

_MOST_RUNS = 20_000
# Rows that they may leave, of 465 bytes each: five gigabytes. So many runs with the schedule `paper` come to 6
# million at most.
_MOST_SLOTS = 10_000_000
# Vehicles whose pairs are in memory at once: some tens of kilobytes each.
_CHUNK = 50


@dataclass(frozen=True)
class VehiclePlan:
    """A vehicle with its plan, or with the problem for which it is skipped."""

    vehicle: Chosen
    plan: CalibrationPlan | None = None
    problem: Json | None = None


def check_template(template: CalibrationTemplate) -> None:
    """Raises :class:`Problem` 422: what is wrong with the template itself, whatever the vehicle."""
    plan_request(template, [])


def check_total(session: Session, template: CalibrationTemplate, chosen: list[Chosen]) -> None:
    """Refuse what all vehicles together may come to at most, by the numbers of their pairs alone.

    Raises :class:`Problem` 422 ``fleet_request_too_large``.
    """
    resolved = resolve_template(template)
    sets: Counter[int] = Counter()
    for chunk in in_chunks(chosen, _CHUNK):
        ids = [set_id for vehicle in chunk for set_id in vehicle.sets.values()]
        sets.update(session.scalars(select(CorrespondenceSet.count).where(CorrespondenceSet.id.in_(ids))))
    each = 1 + resolved.request.folds
    runs = len(resolved.models) * each * sets.total()
    costs = [
        (each * times, run_cost(model, count, resolved.schedule))
        for count, times in sets.items()
        for model in resolved.models
    ]
    if runs > _MOST_RUNS:
        raise too_large(f"more than {_MOST_RUNS} runs (cameras x models x (folds + 1))", f"{_MOST_RUNS} runs")
    if sum(times * cost.slots for times, cost in costs) > _MOST_SLOTS:
        raise too_large(f"more than {_MOST_SLOTS:,} slots", f"{_MOST_SLOTS:,} slots")
    check_fleet_total(sum(times * cost.seconds for times, cost in costs))


def too_large(what: str, most: str) -> Problem:
    """A request for more than one may come to."""
    return unprocessable(
        "fleet_request_too_large",
        f"This request comes to {what}, and one request takes at most {most}.",
        "Ask in several requests: narrow the filter, or ask for fewer models or folds.",
    )


def plan_vehicles(session: Session, template: CalibrationTemplate, chosen: list[Chosen]) -> Iterator[VehiclePlan]:
    """The plans of vehicles of a template that :func:`check_template` lets pass; pairs are read some at a time."""
    content = template.model_dump()
    for chunk in in_chunks(chosen, _CHUNK):
        sets = _sets(session, chunk)
        rigs = _rigs(session, {pair_set.rig_id for pair_set in sets.values()})
        yield from [_plan(session, template, content, vehicle, sets, rigs) for vehicle in chunk]


def _sets(session: Session, chunk: Sequence[Chosen]) -> dict[UUID, CorrespondenceSet]:
    ids = [set_id for vehicle in chunk for set_id in vehicle.sets.values()]
    return {row.id: row for row in session.scalars(select(CorrespondenceSet).where(CorrespondenceSet.id.in_(ids)))}


def _rigs(session: Session, ids: set[UUID]) -> dict[UUID, Rig]:
    rows = session.scalars(select(Rig).where(Rig.id.in_(ids)).options(selectinload(Rig.cameras)))
    return {row.id: row for row in rows}


def _plan(
    session: Session,
    template: CalibrationTemplate,
    content: dict[str, Any],
    vehicle: Chosen,
    sets: dict[UUID, CorrespondenceSet],
    rigs: dict[UUID, Rig],
) -> VehiclePlan:
    if not vehicle.sets:
        return VehiclePlan(vehicle, problem=_NO_PAIRS)
    rig = rigs[next(sets[set_id].rig_id for set_id in vehicle.sets.values())]
    sources = [
        CameraPairs(camera, sets[vehicle.sets[camera.name]])
        for camera in sorted(rig.cameras, key=lambda camera: camera.name)
        if camera.name in vehicle.sets
    ]
    try:
        ids = [of.pairs.id for of in sources]
        alone = CalibrationRequest.model_validate({**content, "correspondence_set_ids": ids})
        return VehiclePlan(vehicle, plan_request(alone, with_recorded_lenses(session, template, sources)))
    except Problem as problem:
        # The template itself was checked before, so this is about the vehicle's own pairs.
        return VehiclePlan(vehicle, problem=problem.document())


_NO_PAIRS: Json = unprocessable(
    "no_pairs",
    "The vehicle has no correspondence set.",
    "Mark a recording's corners and make pairs, or import pairs; then ask again.",
).document()
