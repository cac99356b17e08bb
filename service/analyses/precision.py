"""Fits that the service makes by itself, every few dozen marks, to say how good a calibration would be."""

from __future__ import annotations

from functools import partial
from uuid import UUID

from sqlalchemy import Row, Select, exists, func, or_, select
from sqlalchemy.orm import Session, aliased

from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.errors import DocumentError
from apexcal.documents.marking_precision import PrecisionRequest
from apexcal.documents.states import UNENDED, WorkState
from service.analyses.jobs import analysis_of, queue_analysis
from service.annotations.tally_queries import opinions_of
from service.calibrations.lens_queries import with_recorded_lenses
from service.calibrations.plan import FitPlan, plan_request
from service.calibrations.resolve import CameraPairs
from service.detections.queries import done_detection
from service.fleets.rigs import rig_camera
from service.pairs.marked_pairs import build
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.annotations import MarkingProgress
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.detections import Detection
from service.platform.db.fleets import Rig
from service.platform.db.jobs import Job
from service.platform.db.recordings import Recording, Sensor
from service.platform.db.rounds import one_by_one
from service.platform.db.session import Database
from service.platform.http.problems import Problem
from service.recordings.queries import find_camera

# A fit waits for so many vertices with an answer more than the last one had, and for a fifth more: an interval that
# follows the root of their number has narrowed by a twelfth then.
_MORE, _SHARE = 30, 5
# So many at once; the next when these have ended, so that a calibration waits for a few seconds at most.
_AT_ONCE = 4
_MODEL = "brown_conrady"


def plan(access: Access, request: PrecisionRequest) -> Analysis:
    """Return the row of a fit to a camera's marks. Raises :class:`Problem` as pairs and calibrations do."""
    detection = done_detection(access, request.detection_id, "engineer")
    camera = find_camera(access.session, detection.recording_id, request.camera)
    answered = len(opinions_of(access.session, detection.id, camera.id))
    return _question(access.session, detection, camera.name, answered)


def queue_due_fits(database: Database) -> None:
    """Queue a fit where enough marks came since the last one, if no calibration waits or runs.

    Pairs are built outside of the transaction that queues. Several services doing it at once queue each fit once.
    """
    with database.reading() as session:
        is_busy = select(exists().where(Job.queue == "solve", Job.state.in_(UNENDED)))
        due = [] if session.scalar(is_busy) else session.execute(_due()).all()
    one_by_one("the fit of", due, partial(_queue_fit, database))


def _queue_fit(database: Database, due: Row[UUID, str, int]) -> None:
    detection_id, camera, answered = due
    with database.reading() as session:
        detection = session.get(Detection, detection_id)
        if detection is None:
            return
        try:
            row = _question(session, detection, camera, answered)
        except (Problem, DocumentError) as error:
            row = _refusal(session, detection, camera, answered, error)
    with database.writing() as session:
        _keep(session, row)


def _due() -> Select[UUID, str, int]:
    """Select detection, camera and answered vertices of the newest detections that lack a fit to their marks."""
    answered = func.sum(MarkingProgress.answered)
    counted = (
        select(MarkingProgress.detection_id, MarkingProgress.sensor_id, answered.label("answered"))
        .group_by(MarkingProgress.detection_id, MarkingProgress.sensor_id)
        .having(answered >= _MORE)
        .subquery()
    )
    newer = aliased(Detection)
    is_old = exists().where(newer.recording_id == Detection.recording_id, newer.id > Detection.id)
    last = Analysis.asked["answered"].as_integer()
    is_fitted = exists().where(
        Analysis.detection_id == counted.c.detection_id,
        Analysis.kind == "precision",
        Analysis.asked["camera"].as_string() == Sensor.name,
        or_(
            Analysis.state.in_(UNENDED),
            last + _MORE > counted.c.answered,
            last * (_SHARE + 1) > counted.c.answered * _SHARE,
        ),
    )
    return (
        select(Detection.id, Sensor.name, counted.c.answered)
        .join(counted, counted.c.detection_id == Detection.id)
        .join(Sensor, Sensor.id == counted.c.sensor_id)
        .where(Detection.state == WorkState.DONE, ~is_old, ~is_fitted)
        .order_by(Detection.id.desc(), Sensor.name)
        .limit(_AT_ONCE)
    )


def _keep(session: Session, row: Analysis) -> None:
    """Queue the question in the row of the camera's last one, whose answer stays until the new one is there."""
    own = select(Detection.id).where(Detection.id == row.detection_id)
    # Not the lock that an answer waits for.
    if session.scalar(own.with_for_update(key_share=True, skip_locked=True)) is None:
        return
    rows = session.scalars(
        select(Analysis)
        .where(Analysis.detection_id == row.detection_id, Analysis.kind == row.kind)
        .order_by(Analysis.id.desc())
    )
    last = next((each for each in rows if each.asked["camera"] == row.asked["camera"]), None)
    if last is not None:
        if last.state in UNENDED:
            return
        last.asked, last.single_pairs, last.problem = row.asked, row.single_pairs, row.problem
        row = last
    if row.problem is None:
        queue_analysis(session, row)
    else:
        row.state = WorkState.FAILED
        session.add(row)


def _question(session: Session, detection: Detection, camera: str, answered: int) -> Analysis:
    """Return the row with the pairs that people's marks make now, and the fit that a calibration would do.

    Raises:
        DocumentError, Problem: as :func:`build` and :func:`plan_request` do.
    """
    recording = session.get_one(Recording, detection.recording_id)
    built = build(session, detection, find_camera(session, recording.id, camera), exclude_flagged=False)
    pairs = CorrespondenceSet(
        recording_id=recording.id,
        camera=camera,
        source="annotations",
        pairs=built.columns,
        count=len(built.columns["x"]),
        notes=[],
    )
    template = CalibrationTemplate.model_validate({"folds": 0})
    sources = [CameraPairs(rig_camera(session, session.get_one(Rig, recording.rig_id), camera), pairs)]
    sources = with_recorded_lenses(session, template, sources)
    fit = _usual(plan_request(template, sources).fits, sources[0])
    question = {"camera": camera, "answered": answered, "fit_request": fit.of_fold(-1)}
    row = analysis_of(recording, "precision", question, detection.id)
    row.single_pairs = built.columns
    return row


def _usual(fits: list[FitPlan], source: CameraPairs) -> FitPlan:
    """The fit of the stated lens's model, or else of the usual one."""
    model = (source.stated or {}).get("model") or _MODEL
    return next((fit for fit in fits if fit.request.model == model), fits[0])


def _refusal(
    session: Session, detection: Detection, camera: str, answered: int, error: Problem | DocumentError
) -> Analysis:
    """A question that no worker can answer: it is not looked at again before more marks came."""
    recording = session.get_one(Recording, detection.recording_id)
    row = analysis_of(recording, "precision", {"camera": camera, "answered": answered}, detection.id)
    detail = error.detail if isinstance(error, Problem) else error.message
    row.problem = {"code": error.code, "detail": detail, "hint": error.hint}
    return row
