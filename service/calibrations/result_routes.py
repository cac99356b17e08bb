"""The route of a result."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from fastapi import Request
from fastapi.responses import Response
from sqlalchemy import select

from apexcal.documents.base import Stored
from apexcal.documents.results import ResultView
from apexcal.documents.roles import rank
from service.annotations.disclosure_actions import tell_pairs
from service.calibrations.views import result_document
from service.exports.answers import WantedFormat, exported
from service.exports.queries import of_result
from service.platform.auth.access import ReadAccess
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.http.etags import Conditional
from service.platform.http.problems import not_found
from service.platform.http.router import Router
from service.publications.check_queries import checks_now

router = Router(tags=["calibrations"])


@router.get("/results/{result_id}", response_model=Stored[ResultView])
def read_result(
    result_id: UUID, access: ReadAccess, request: Request, wanted: WantedFormat, conditions: Conditional
) -> dict[str, Any] | Response:
    """The solver's whole document: parameters, errors of every stage, deviations, checks; and its ids.

    ``checks`` are all checks at this moment; of a fit that is not to all pairs those of the fit. Of pairs made of
    marks only reviewers see what tells of single pairs; what they answer afterwards on the vertices of these counts
    as reviewed. ``format``: its lens and mount in another format.
    """
    result = access.find(Result, result_id)
    if wanted is not None:
        return exported(wanted, of_result(access.session, result.id), conditions)
    found = access.session.execute(
        select(CalibrationRun, Calibration, CorrespondenceSet)
        .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.id == result.run_id)
    ).one_or_none()
    if found is None:
        # Deleted at this moment.
        raise not_found()
    run, calibration, pairs = found
    with_pairs = pairs.source == "import" or rank(access.role(result.fleet_id) or "") >= rank("reviewer")
    checks = checks_now(access.session, result) if result.fold == FULL else None
    document = result_document(result, run, calibration, pairs, checks, with_pairs=with_pairs)
    if with_pairs:
        tell_pairs(access, request.app.state.database, pairs, "result")
    return document
