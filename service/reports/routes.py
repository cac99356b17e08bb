"""Reports of results: asked for with POST, and read as one HTML file."""

from __future__ import annotations

from typing import Annotated, NamedTuple
from uuid import UUID

from fastapi import Depends, Query, Request, Response
from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.reports import ReportView
from apexcal.documents.states import UNENDED
from service.annotations.disclosure_actions import tell_pairs
from service.platform.auth.access import Access, CurrentIdentity, ReadAccess, WriteAccess
from service.platform.db.calibrations import FULL, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.jobs import Job
from service.platform.db.reports import Report
from service.platform.db.session import Database
from service.platform.http.etags import Conditional, content_etag
from service.platform.http.problems import Problem, not_found
from service.platform.http.router import Router
from service.platform.settings import Settings
from service.platform.storage.quota import require_quota
from service.platform.storage.store import Store
from service.reports.jobs import ask_report
from service.reports.views import report_view

router = Router(tags=["calibrations"])

# The file holds its own styles, script, pictures and data, and needs nothing else. In a sandbox without an origin it
# reaches neither cookies nor the API, whatever stands in it.
_POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'; sandbox allow-scripts allow-downloads allow-popups "
    "allow-popups-to-escape-sandbox"
)
# The size of a report of 1,000 pairs (decision 0054).
_MOST_BYTES = 3_000_000


@router.post("/results/{result_id}/report", status_code=202, response_model=ReportView)
def make_report(result_id: UUID, access: WriteAccess, request: Request) -> JSONResponse:
    """Make the result's report, or make it again. While one is being made, that one is answered. [reviewer]

    Only of a fit to all pairs. The one before stays readable until the new one is there. Reports count
    towards the fleet's quota.
    """
    result = access.find(Result, result_id, "reviewer", lock=True)
    if result.fold != FULL:
        raise Problem(
            409,
            "not_a_fit_to_all_pairs",
            "This result is from a fit that holds pairs out. Only fits to all pairs have reports.",
            "Ask for the report of the model's fit to all pairs: its fold is -1.",
        )
    kept = access.session.scalar(select(Report.size).where(Report.result_id == result.id))
    if not kept:
        settings: Settings = request.app.state.settings
        require_quota(access.session, result.fleet_id, _MOST_BYTES, settings.fleet_quota_bytes)
    return access.answer(report_view(*ask_report(access.session, result)), 202)


@router.get("/reports/{report_id}")
def read_report_state(report_id: UUID, access: ReadAccess) -> ReportView:
    """How far a report is."""
    row = access.find(Report, report_id)
    return report_view(row, access.session.get(Job, row.job_id) if row.job_id else None)


class _Kept(NamedTuple):
    """A report's bytes, looked up in a session that has ended."""

    key: str
    size: int
    name: str


def _find(result_id: UUID, request: Request, identity: CurrentIdentity) -> _Kept:
    database: Database = request.app.state.database
    with database.reading() as session:
        access = Access(session, identity)
        result = access.find(Result, result_id)
        found = session.execute(
            select(CorrespondenceSet, Report)
            .select_from(CalibrationRun)
            .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
            .outerjoin(Report, Report.result_id == result.id)
            .where(CalibrationRun.id == result.run_id)
        ).one_or_none()
        if found is None:
            raise not_found()
        pairs, report = found
        if pairs.source == "annotations":
            access.need(result.fleet_id, "reviewer")
        if report is None or report.blob_key is None:
            raise _not_made(report)
        kept = _Kept(report.blob_key, report.size, f"{result.camera}-{result.model}-report.html")
        tell_pairs(access, database, pairs, "result")
    return kept


def _not_made(report: Report | None) -> Problem:
    if report is not None and report.state in UNENDED:
        return Problem(
            409,
            "report_not_ready",
            "The report is being made.",
            "It takes some seconds. Ask again.",
            state=report.state,
        )
    return Problem(
        409,
        "no_report",
        "This result has no report."
        if report is None or not report.problem
        else f"The report could not be made: {report.problem.get('detail')}",
        "Ask for one with POST /v1/results/{id}/report, or on the calibration's page.",
    )


@router.get(
    "/results/{result_id}/report",
    response_class=Response,
    responses={200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
async def get_report(
    kept: Annotated[_Kept, Depends(_find)],
    request: Request,
    conditions: Conditional,
    download: Annotated[bool, Query(description="as a file to save")] = False,
) -> Response:
    """The newest report of a result: one HTML file that needs nothing else. [reviewer, if pairs are made of marks]

    Of pairs that were marked here it shows single marks: what one answers afterwards on their vertices counts as
    reviewed.
    """
    etag = content_etag(kept.key.rpartition("/")[2].partition(".")[0])
    conditions.offer(etag)
    store: Store = request.app.state.store
    data = await store.read(kept.key, 0, kept.size)
    headers = {"ETag": etag, "Content-Security-Policy": _POLICY}
    # A camera's name may hold any letter.
    plain = kept.name.encode("ascii", "replace").decode().replace("?", "_").replace('"', "_").replace("/", "_")
    headers["Content-Disposition"] = f'{"attachment" if download else "inline"}; filename="{plain}"'
    return Response(data, media_type="text/html", headers=headers)
