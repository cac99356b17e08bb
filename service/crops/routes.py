"""Routes of pages of crops: how far it is, the next page, the answer to a page."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Depends, Path, Query, Request, Response

from apexcal.documents.base import Sought
from apexcal.documents.crops import CropAnswer, CropProgress, CropSheet, CropVerdict, ExpectedCorner, NextCrops
from apexcal.documents.marking import MarkingWork
from service.annotations.disclosure_actions import disclose, keys_of
from service.crops.actions import find_page, judge, next_page, sheet_of
from service.crops.pictures import tile_of
from service.crops.queries import expected_corners, newest_marks, progress_of
from service.crops.work_queries import marking_work
from service.detections.queries import done_detection
from service.platform.auth.access import CurrentIdentity, ReadAccess, WriteAccess, brief_access
from service.platform.broker.hints import hint
from service.platform.db.analyses import AnalysisFile
from service.platform.db.detections import Detection
from service.platform.db.fleets import Fleet
from service.platform.http.etags import Conditional
from service.platform.http.problems import not_found
from service.platform.http.router import MarkingRoute, Router
from service.recordings.addresses import ByteRange
from service.recordings.queries import find_camera

router = Router(tags=["annotations"], route_class=MarkingRoute)

CameraQuery = Annotated[Sought, Query(description="a camera's name in the rig")]


@router.get("/fleets/{id}/marking-work")
def list_marking_work(id: UUID, access: ReadAccess) -> list[MarkingWork]:
    """What waits for you to be marked or confirmed, the newest recordings first."""
    return marking_work(access, access.find(Fleet, id).id)


@router.get("/detections/{detection_id}/crops")
def get_crop_progress(detection_id: UUID, access: ReadAccess, camera: CameraQuery) -> CropProgress:
    """How far people have looked at the machine's marks in one camera, in numbers."""
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera)
    return progress_of(access.session, newest_marks(access.session, detection.id, sensor.name), sensor)


@router.get("/detections/{detection_id}/expected-corners")
def list_expected_corners(
    detection_id: UUID, access: ReadAccess, camera: CameraQuery, request: Request
) -> list[ExpectedCorner]:
    """Where to look for each corner that the machine marked in one camera. Nothing of what people said is told.

    Where the machine cannot decide between two places, both are told; what one answers there counts as reviewed.
    """
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera)
    corners = expected_corners(access.session, detection.id, sensor.name)
    undecided = [corner.vertex_id for corner in corners if corner.places]
    disclose(access, request.app.state.database, sensor, keys_of(access.session, sensor.id, undecided), "crops")
    return corners


@router.post(
    "/detections/{detection_id}/crops/next",
    response_model=CropSheet,
    responses={204: {"description": "no mark needs a look"}},
)
def ask_crops(detection_id: UUID, body: NextCrops, access: WriteAccess) -> CropSheet | Response:
    """The next page of crops for this person, or the one that they have not answered. [annotator]

    Some of its marks are shifted on purpose. What one answers afterwards on its vertices counts as reviewed.
    """
    detection = done_detection(access, detection_id, "annotator")
    camera = find_camera(access.session, detection.recording_id, body.camera)
    page = next_page(access.session, detection, camera, access.person.id)
    return Response(status_code=204) if page is None else sheet_of(access.session, page, camera)


@router.post("/crop-pages/{page_id}/answer")
def answer_crops(page_id: UUID, answer: CropAnswer, access: WriteAccess) -> CropVerdict:
    """Accept a page's marks but those that are wrong. The same id again is the same answer. [annotator]"""
    page = find_page(access, page_id, lock=True)
    verdict = judge(access.session, page, answer)
    fleet_id = access.session.get_one(Detection, page.detection_id).fleet_id
    hint(access.session, fleet_id, "marking", page.detection_id)
    return verdict


def _picture(
    page_id: UUID, index: Annotated[int, Path(ge=0, lt=2**31)], request: Request, identity: CurrentIdentity
) -> ByteRange:
    """The session ends here, before any byte is read."""
    with brief_access(request, identity) as access:
        page = find_page(access, page_id)
        tile = tile_of(page.crops[index]) if index < len(page.crops) else None
        file = access.session.get(AnalysisFile, page.analysis_id)
        if tile is None or file is None:
            raise not_found(
                "no_such_crop",
                f"The page has no picture {index} of its own.",
                "Read the picture at the address that the page gives for its crop.",
            )
        return ByteRange(file.blob_key, tile.tile_offset, tile.tile_offset, tile.tile_length, "image/png")


@router.get(
    "/crop-pages/{page_id}/crops/{index}", response_class=Response, responses={200: {"content": {"image/png": {}}}}
)
async def get_crop(
    picture: Annotated[ByteRange, Depends(_picture)], request: Request, conditions: Conditional
) -> Response:
    """The piece of the frame around a mark of one's own page, in colour. [annotator]"""
    return await picture.answer(request, conditions)
