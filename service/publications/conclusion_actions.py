"""The end of a calibration: checks and summary stored, and what passes published, if that was asked for."""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

from sqlalchemy import update
from sqlalchemy.orm import Session
from sqlalchemy.orm.attributes import set_committed_value

from apexcal.documents.checks import doubts_of
from apexcal.documents.states import WorkState
from apexcal.documents.summaries import CameraSummary
from service.calibration_runs.actions import end_calibrations
from service.platform.db.calibrations import Calibration, Result, current_publication
from service.platform.handovers import Conclusion
from service.platform.jobs.claims import StaleInputError
from service.publications.actions import hold_publications, publish_by_itself
from service.publications.check_queries import judged_now


def publish_conclusion(
    session: Session, calibration_id: UUID, conclusion: Conclusion, fresh: Result | None = None
) -> None:
    """Store what a worker concluded of a calibration, publish what passes, and end the calibration.

    ``fresh``: the result of its last run, stored here. Raises :class:`StaleInputError`, with nothing written, if a
    run was retried meanwhile, or results that shall be published were judged beside others than are current.
    """
    # The calibration's row before the vehicle's: the order of all locks.
    calibration = session.get_one(Calibration, calibration_id, with_for_update=True, populate_existing=True)
    hold_publications(session, calibration.vehicle_id)
    if calibration.reopened != conclusion.reopened:
        raise StaleInputError
    if calibration.publish == "recommended":
        _check_unchanged(session, calibration.vehicle_id, conclusion.current)
    judged = {columns["id"]: columns for columns in conclusion.judged}
    if fresh is not None:
        for name, value in judged.pop(fresh.id, {}).items():
            setattr(fresh, name, value)
        session.add(fresh)
        session.flush()
    if judged:
        session.execute(update(Result), list(judged.values()))
    # The limits of a policy are of the summary too: of the one in memory, which is written once at the end.
    set_committed_value(calibration, "summary", conclusion.summary.model_dump(mode="json"))
    for summary in conclusion.summary.cameras.values():
        _publish(session, calibration, summary)
    summary = conclusion.summary.model_dump(mode="json")
    end_calibrations(session, [calibration_id], WorkState.DONE, conclusion.problem, summary=summary)


def _check_unchanged(session: Session, vehicle_id: UUID, judged_beside: Mapping[str, UUID | None]) -> None:
    for camera, before in judged_beside.items():
        publication = current_publication(session, vehicle_id, camera)
        if (publication and publication.result_id) != before:
            raise StaleInputError


def _publish(session: Session, calibration: Calibration, summary: CameraSummary) -> None:
    """Add the checks of a camera's recommended result now; publish it, if that was asked and its policy does so."""
    chosen = summary.models.get(summary.recommended or "")
    is_asked = calibration.publish == "recommended"
    summary.published = False if is_asked else None
    if chosen is None:
        return
    result = session.get_one(Result, chosen.result_id)
    summary.checks, policy = judged_now(session, result)
    if is_asked and policy.publishes(summary.checks):
        publish_by_itself(session, calibration, result, [check.sentence for check in doubts_of(summary.checks)])
        summary.published = True
