"""Make the report of a result: one HTML file of what database and store hold about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Final, NamedTuple
from uuid import UUID

from sqlalchemy import and_, select
from sqlalchemy.orm import Session, aliased

from apexcal.documents.checks import Check
from apexcal.documents.corners import TOP
from apexcal.documents.pairs import CORNER
from service.platform.db.analyses import Analysis
from service.platform.db.annotations import Answer
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.fleets import Rig, Vehicle
from service.platform.db.people import Person
from service.platform.db.recordings import CameraFrame, Sensor
from service.platform.jobs.claims import Claim, Lease
from workers.reports.contents import contents
from workers.reports.material import FrameImage, Material, PersonMark
from workers.reports.page import page
from workers.solver.estimate import at_clock
from workers.solver.outcomes import Stop
from workers.tasks.analysis_files import keeping, store_file
from workers.tasks.context import Context
from workers.tasks.other_data import other_data
from workers.tasks.run_inputs import read_run

_SHOWN: Final = frozenset(("image/jpeg", "image/png", "image/webp"))
# Number of outliers with a picture, the worst first, and the largest frame that is read. The file stays below 3 MB.
_PICTURES: Final = 24
_FRAME_BYTES: Final = 600_000


class _Place(NamedTuple):
    """The place of a frame's image in the store."""

    pair: int
    key: str
    frame: CameraFrame


def report(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """Make the report, and store it."""
    with context.database.reading() as session:
        analysis = session.get_one(Analysis, claim.subject_id)
        result = session.get_one(Result, analysis.result_id)
        now = [Check.model_validate(check) for check in analysis.asked["checks"]]
        names = {check.name for check in now}
        checks = [*(check for check in result.stored_checks if check.name not in names), *now]
        material = _material(session, result, checks, lease)
        places = _places(session, material, result)
    lease.report(0.1, "computing the report")
    frames = {frame.pair: _image(context, frame) for frame in places}
    document = contents(material)
    lease.check()
    lease.report(0.3, "writing the report")
    with context.scratch() as folder:
        file = folder / "report.html"
        file.write_text(page(document, frames), encoding="utf-8")
        key = store_file(context, claim, file, f"reports/{result.id}")
        name = f"{result.camera}-{result.model}-report.html"
        return keeping(claim, key, file, name, {"verdict": document["result"]["verdict"]})


def _material(session: Session, result: Result, checks: Sequence[Check], stop: Stop) -> Material:
    run = session.get_one(CalibrationRun, result.run_id)
    pairs = session.get_one(CorrespondenceSet, run.set_id)
    detection = session.get(Detection, pairs.detection_id) if pairs.detection_id else None
    calibration = session.get_one(Calibration, result.calibration_id)
    summary = calibration.summarised.cameras.get(result.camera)
    same_model = [Result.model == result.model, Result.camera == result.camera, Result.fold != FULL]
    folds = session.scalars(select(Result).where(Result.calibration_id == calibration.id, *same_model))
    rig, vehicle = session.get_one(Rig, calibration.rig_id), session.get_one(Vehicle, calibration.vehicle_id)
    ids = {
        "id": result.id,
        "fleet_id": result.fleet_id,
        "vehicle_id": vehicle.id,
        "rig_id": rig.id,
        "recording_id": pairs.recording_id,
        "detection_id": pairs.detection_id,
        "calibration_id": calibration.id,
        "run_id": run.id,
        "set_id": pairs.id,
    }
    rows = {name: value and str(value) for name, value in ids.items()}
    return Material(
        result=result.published,
        problem=at_clock(read_run(run.fit_request, FULL, pairs.columns, stop).problem, result.published.clock_offset),
        heldout=[fold.fit.heldout for fold in folds if fold.fit.heldout],
        pairs=pairs.columns,
        checks=checks,
        summary=summary and summary.model_dump(mode="json"),
        marks=_marks(session, pairs),
        elsewhere=other_data(session, [result])[result.id],
        names={"vehicle": vehicle.name, "rig": rig.name, "camera": result.camera},
        rows=rows | {"camera": result.camera, "fold": FULL, "seed": run.fit_request["seed"]},
        request=calibration.request,
        made_at=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        upper_corner=int(detection.options.get("upper_corner") or 0) if detection else 0,
    )


def _marks(session: Session, pairs: CorrespondenceSet) -> list[PersonMark]:
    """Return each person's present marks of the pairs; none if the pairs were imported."""
    columns = pairs.columns
    names = ("stamp_ns", "sweep_index", "frame_index")
    if pairs.detection_id is None or not all(name in columns for name in names):
        return []
    corners = columns.get(CORNER, [TOP] * len(columns["x"]))
    number = {of: i for i, of in enumerate(zip(*(columns[name] for name in names), corners, strict=True))}
    mark, verdict = aliased(Answer), aliased(Answer)
    rows = session.execute(
        select(Vertex.time_ns, Vertex.sweep_index, VertexFrame.frame_index, mark.corner, Person.name, mark.u, mark.v)
        .select_from(Vertex)
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .join(Sensor, and_(Sensor.id == VertexFrame.sensor_id, Sensor.name == pairs.camera))
        .join(mark, and_(mark.sensor_id == Sensor.id, mark.frame_index == VertexFrame.frame_index, mark.is_mark))
        .join(
            verdict, and_(verdict.apex_id == Vertex.apex_id, verdict.person_id == mark.person_id, verdict.is_verdict)
        )
        .join(Person, Person.id == mark.person_id)
        .where(Vertex.detection_id == pairs.detection_id, verdict.verdict == "confirmed")
        .where(mark.corner == Vertex.corner)
        .order_by(Vertex.time_ns, Person.name)
    )
    marks = [(number.get(tuple(of)), name, u, v) for *of, name, u, v in rows]
    return [
        PersonMark(pair, name, u, v)
        for pair, name, u, v in marks
        if pair is not None and u is not None and v is not None
    ]


def _places(session: Session, material: Material, result: Result) -> Sequence[_Place]:
    """Return the frames of the worst outliers, if the recording still has them and browsers can show them."""
    indices, recording = material.pairs.get("frame_index"), material.rows["recording_id"]
    if indices is None or recording is None:
        return []
    camera = session.scalars(
        select(Sensor).where(Sensor.recording_id == UUID(recording), Sensor.name == result.camera)
    ).one_or_none()
    if camera is None:
        return []
    pictured = {outlier.index: indices[outlier.index] for outlier in result.fit.outliers[:_PICTURES]}
    frames = select(CameraFrame).where(
        CameraFrame.sensor_id == camera.id, CameraFrame.index.in_(set(pictured.values()))
    )
    of_index = {frame.index: frame for frame in session.scalars(frames)}
    return [
        _Place(pair, camera.blob_key, of_index[index])
        for pair, index in pictured.items()
        if index in of_index and of_index[index].media_type in _SHOWN and of_index[index].length <= _FRAME_BYTES
    ]


def _image(context: Context, picture: _Place) -> FrameImage:
    """Return the frame as it is stored. Only browsers decode it."""
    frame = picture.frame
    data = context.store.get_range(picture.key, frame.offset, frame.length)
    return FrameImage(frame.media_type, data, frame.width, frame.height)
