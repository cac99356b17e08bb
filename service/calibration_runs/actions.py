"""State transitions of runs and calibrations: iterations as bundles of slots, the fan-in, the ends.

Every function here works inside the caller's transaction, and locks in the order of
:mod:`service.platform.jobs.tree`.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import Any, Protocol
from uuid import UUID

from sqlalchemy import bindparam, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import VehicleState, WorkState
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, Result, Slot
from service.platform.db.clock import now
from service.platform.db.fleet_requests import FleetRequestVehicle
from service.platform.db.jobs import Job
from service.platform.handovers import Conclusion, RunEnd, SlotBundle
from service.platform.jobs.bundles import cut
from service.platform.jobs.claims import StaleInputError
from service.platform.jobs.queue import enqueue, enqueue_each
from service.platform.jobs.tree import count_down, end

# Built once, as those of :mod:`service.platform.jobs.claims`.
_RUNS = select(
    *(CalibrationRun.calibration_id, CalibrationRun.fleet_id, CalibrationRun.fold),
    *(CalibrationRun.state, CalibrationRun.problem),
).where(CalibrationRun.calibration_id.in_(bindparam("calibrations", expanding=True)))
_END_VEHICLES = (
    update(FleetRequestVehicle)
    .where(
        FleetRequestVehicle.calibration_id.in_(bindparam("calibrations", expanding=True)),
        FleetRequestVehicle.state == VehicleState.QUEUED,
    )
    .values(state=bindparam("ended_as"), problem=bindparam("because"), finished_at=now())
    .returning(FleetRequestVehicle.calibration_id, FleetRequestVehicle.fleet_request_id)
)


class Conclude(Protocol):
    """Stores what a worker concluded of a calibration, and the result of its last run, and ends it.

    Raises :class:`StaleInputError`, with nothing written, if it was judged beside other results than are there now.
    """

    def __call__(
        self, session: Session, calibration_id: UUID, conclusion: Conclusion, fresh: Result | None = None
    ) -> None: ...


def start_runs(session: Session, runs: Sequence[CalibrationRun]) -> list[Job]:
    """Queue the next work of runs of one fleet: the whole run as one job, or the bundles of its iteration."""
    work = [
        (run.id, payload) for run in runs for payload in ([{"part": "run"}] if run.farm == "runs" else _bundles(run))
    ]
    return enqueue_each(session, kind="solve", fleet_id=runs[0].fleet_id, work=work)


def _bundles(run: CalibrationRun) -> list[Json]:
    """The running iteration's bundles, counted. They become fixed rows, never cut anew on a retry."""
    bundles = cut(run.slots, run.bundle)
    run.remaining = len(bundles)
    return [
        {"part": "slots", "iteration": run.iteration, "first": bundle.start, "stop": bundle.stop}
        for bundle in bundles
    ]


def go_on(session: Session, run_id: UUID, bundle: SlotBundle) -> None:
    """Take a bundle off its iteration; after the last narrow the bounds about the best slots, and go on or stop."""
    if not count_down(session, CalibrationRun, [run_id]):
        return
    run = session.get_one(CalibrationRun, run_id, populate_existing=True)
    of_iteration = select(Slot).where(Slot.run_id == run.id, Slot.iteration == run.iteration).order_by(Slot.slot)
    run.search_state, has_stopped = bundle.narrow(run.search_state, session.scalars(of_iteration).all())
    run.iteration += 1
    if has_stopped:
        # Polish, baselines and held-out pairs.
        enqueue(session, kind="solve", fleet_id=run.fleet_id, subject_id=run.id, payload={"part": "finish"})
    else:
        start_runs(session, [run])


def end_runs(session: Session, run_ids: Collection[UUID], state: WorkState, problem: Json | None = None) -> None:
    """End runs, each once, and what the last one of a calibration leaves."""
    ended = end(session, CalibrationRun, run_ids, state, problem)
    _go_on_from(session, count_down(session, Calibration, [run.shown_id for run in ended]))


def end_solved(session: Session, run_end: RunEnd, conclude: Conclude) -> None:
    """End a run once with its result. The calibration's last one also ends the calibration.

    Where another run was retried meanwhile, or another result was published, a job concludes instead.
    """
    run = run_end.run
    search = dict(zip(("search_state", "iteration"), run_end.search or (), strict=False))
    if not end(session, CalibrationRun, [run.id], WorkState.DONE, **search):
        return
    last, result = count_down(session, Calibration, [run.calibration_id]), Result(**run_end.result)
    if last and run_end.conclusion:
        try:
            conclude(session, run.calibration_id, run_end.conclusion, result)
            return
        except StaleInputError:
            pass
    session.add(result)
    session.flush()
    _go_on_from(session, last)


def _go_on_from(session: Session, calibration_ids: Collection[UUID]) -> None:
    """Have a worker judge what the runs found. Without a fit to all pairs, or cancelled, a calibration ends now."""
    runs: defaultdict[UUID, list[Any]] = defaultdict(list)
    if calibration_ids:
        for run in session.connection().execute(_RUNS, {"calibrations": list(calibration_ids)}):
            runs[run.calibration_id].append(run)
    alike: defaultdict[tuple[WorkState, str], list[UUID]] = defaultdict(list)
    for id, of_calibration in runs.items():
        is_cancelled = any(run.state == WorkState.CANCELLED for run in of_calibration)
        if not is_cancelled and any(run.fold == FULL and run.state == WorkState.DONE for run in of_calibration):
            enqueue(session, kind="conclude", fleet_id=of_calibration[0].fleet_id, subject_id=id)
        else:
            problem = next((run.problem for run in of_calibration if run.problem), None)
            alike[WorkState.CANCELLED if is_cancelled else WorkState.FAILED, json.dumps(problem)].append(id)
    for (state, problem), ids in alike.items():
        end_calibrations(session, ids, state, json.loads(problem))


def end_calibrations(
    session: Session, ids: Collection[UUID], state: WorkState, problem: Json | None, **columns: Any
) -> None:
    """End calibrations, each once, and the vehicles of fleet requests that wait for them."""
    fleets = {row.shown_id: row.fleet_id for row in end(session, Calibration, ids, state, problem, **columns)}
    ended = {"calibrations": list(fleets), "ended_as": state, "because": problem}
    vehicles = session.connection().execute(_END_VEHICLES, ended).all() if fleets else []
    for fleet_id, request_id in {(fleets[row.calibration_id], row.fleet_request_id) for row in vehicles}:
        hint(session, fleet_id, "fleet_request", request_id)
