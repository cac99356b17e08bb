"""A result, how far it is from another one, and how a camera's results drift."""

from __future__ import annotations

from typing import Annotated, Any
from uuid import UUID

from fastapi import Query, Request
from fastapi.responses import Response

from apexcal.documents.base import Sought, Stored
from apexcal.documents.comparisons import Drift, ResultComparison
from apexcal.documents.results import ResultView
from service.annotations.disclosure_actions import disclose_pairs, may_see_pairs
from service.calibrations.comparison_queries import comparison_of
from service.calibrations.drift_queries import drift_of
from service.calibrations.views import origin_of, result_document
from service.exports.answers import WantedFormat, exported
from service.exports.queries import of_result
from service.platform.auth.access import ReadAccess
from service.platform.db.base import require_memory
from service.platform.db.calibrations import FULL, Result
from service.platform.db.fleets import Vehicle
from service.platform.http.etags import Conditional
from service.platform.http.router import Router
from service.publications.check_queries import checks_now

router = Router(tags=["calibrations"])


@router.get("/results/{result_id}", response_model=Stored[ResultView])
def read_result(
    result_id: UUID, access: ReadAccess, request: Request, format_name: WantedFormat, conditions: Conditional
) -> dict[str, Any] | Response:
    """The solver's whole document: parameters, errors of every stage, deviations, checks; and its ids.

    ``checks`` are all checks at this moment; of a fit that is not to all pairs those of the fit. Of pairs made of
    marks only reviewers see what tells of single pairs; what they answer afterwards on the vertices of these counts
    as reviewed. ``format``: its lens and mount in another format.
    """
    result = access.find(Result, result_id)
    if format_name is not None:
        return exported(format_name, of_result(access.session, result.id), conditions)
    run, calibration, pairs = origin_of(access.session, result)
    require_memory(pairs.count)
    with_pairs = may_see_pairs(access, pairs)
    checks = checks_now(access.session, result) if result.fold == FULL else None
    document = result_document(result, run, calibration, pairs, checks, with_pairs=with_pairs)
    if with_pairs:
        disclose_pairs(access, request.app.state.database, pairs, "result")
    return document


@router.get("/results/{result_id}/comparison")
def compare_results(
    result_id: UUID, access: ReadAccess, other: Annotated[UUID, Query(description="the id of another result")]
) -> ResultComparison:
    """How far a result is from another one of its camera: the mount, the lens, and pixels over the image."""
    return comparison_of(access.session, access.find(Result, result_id), access.find(Result, other))


@router.get("/vehicles/{vehicle_id}/drift")
def read_drift(
    vehicle_id: UUID,
    access: ReadAccess,
    camera: Annotated[Sought, Query(description="a camera's name in the rig")],
    limit: Annotated[int, Query(ge=2, le=100, description="how many of the newest results at most")] = 20,
    after: Annotated[str | None, Query(max_length=200, description="the `next` of the answer before")] = None,
) -> Drift:
    """A camera's recommended results in their order, and how far each is from the one before and from the first."""
    vehicle = access.find(Vehicle, vehicle_id)
    return drift_of(access.session, vehicle.id, camera, limit, after)
