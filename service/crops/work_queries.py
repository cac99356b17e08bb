"""List a fleet's work of marking and confirming, for an annotator's first page."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import exists, select
from sqlalchemy.orm import aliased

from apexcal.documents.crops import LEAST_MARKS
from apexcal.documents.marking import MarkingWork
from apexcal.documents.states import WorkState
from service.annotations.progress_actions import count_progress
from service.crops.queries import newest_marks, progress_of
from service.platform.auth.access import Access
from service.platform.db.detections import Detection
from service.platform.db.recordings import Recording, Sensor

_MOST = 20


def marking_work(access: Access, fleet_id: UUID) -> list[MarkingWork]:
    """Cameras of the fleet's newest detections with corners that wait for the asker, of 20 recordings at most."""
    session, person_id = access.session, access.person.id
    newer = aliased(Detection)
    of_recording = (newer.recording_id == Detection.recording_id, newer.state == WorkState.DONE)
    is_old = exists().where(*of_recording, newer.id > Detection.id).correlate(Detection)
    done = select(Detection.id).where(Detection.fleet_id == fleet_id, Detection.state == WorkState.DONE, ~is_old)
    newest = done.order_by(Detection.id.desc()).limit(_MOST)
    rows = session.execute(
        select(Recording.name, Detection, Sensor)
        .join(Detection, Detection.recording_id == Recording.id)
        .join(Sensor, (Sensor.recording_id == Recording.id) & (Sensor.kind == "camera"))
        .where(Detection.id.in_(session.scalars(newest).all()))
        .order_by(Detection.id.desc(), Sensor.name)
    ).all()
    work: list[MarkingWork] = []
    for name, detection, camera in rows:
        progress = count_progress(session, person_id, detection, camera)
        waiting = progress.vertices - max(progress.complete, progress.mine)
        crops = progress_of(session, newest_marks(session, detection.id, camera.name), camera)
        unseen = crops.marks - crops.judged if crops.marks >= LEAST_MARKS else 0
        if waiting > 0:
            of = {"recording_id": detection.recording_id, "detection_id": detection.id, "camera": camera.name}
            work.append(MarkingWork(recording=name, **of, waiting=waiting, to_confirm=unseen, mine=progress.mine))
    return work
