"""Validations: a calibration held against other pairs, or against a drive."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from uuid import UUID

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.checks import verdict_of
from apexcal.documents.states import WorkState
from apexcal.documents.validations import SINGLE_PAIRS
from service.platform.db.analyses import Analysis
from service.platform.db.calibrations import CorrespondenceSet, Result
from service.platform.db.recordings import CameraFrame, Sensor
from service.platform.jobs.claims import Claim, Lease
from workers.judge.validation_checks import elsewhere
from workers.readers.recording import ReadError
from workers.tasks.context import Context
from workers.tasks.originals import camera_of, lidar_key, open_lidar
from workers.tasks.other_data import other_data
from workers.validation.calibration import KnownCalibration
from workers.validation.drive_check import DriveFrame, spread, watch
from workers.validation.edge_check import EdgeCheck
from workers.validation.lane_check import LaneCheck
from workers.validation.pair_score import score_pairs


def pair_validation(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], None]:
    """Errors of a calibration on a set's pairs, without a fit."""
    lease.report(0.0, "scoring pairs")
    with context.database.reading() as session:
        row = session.get_one(Analysis, claim.subject_id)
        calibration = KnownCalibration.of(row.asked["calibration"])
        columns = session.get_one(CorrespondenceSet, row.set_id).columns
    points = np.column_stack([columns[name] for name in "xyz"]).astype(np.float64)
    marks = np.column_stack([columns[name] for name in "uv"]).astype(np.float64)
    score = score_pairs(calibration, points, marks)
    return _writing(claim, score, {name: score.pop(name) for name in SINGLE_PAIRS})


def lane_validation(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], None]:
    """Lane markers of a drive against its frames."""
    return _check(context, claim, lease, LaneCheck)


def edge_validation(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], None]:
    """Depth edges of a drive against its frames."""
    return _check(context, claim, lease, EdgeCheck)


class _Drive(NamedTuple):
    """The places of a recording's sweeps and of one camera's frames."""

    lidar_key: str
    camera_key: str
    frames: list[DriveFrame]


def _check(
    context: Context, claim: Claim, lease: Lease, kind: type[LaneCheck | EdgeCheck]
) -> Callable[[Session], None]:
    with context.database.reading() as session:
        row = session.get_one(Analysis, claim.subject_id)
        check = kind(KnownCalibration.of(row.asked["calibration"]))
        drive = _drive(session, row, check.calibration)
    began = time.process_time()
    with context.scratch() as folder, open_lidar(context, drive.lidar_key, folder) as lidar:
        watch(
            check,
            lidar,
            context.fetch(drive.camera_key, folder),
            drive.frames,
            folder,
            must_stop=lease.check,
            on_share=lambda share: lease.report(share, "looking at frames"),
        )
    result = check.result()
    return _writing(claim, result | {"seconds_per_frame": (time.process_time() - began) / max(result["frames"], 1)})


def _drive(session: Session, row: Analysis, calibration: KnownCalibration) -> _Drive:
    """The frames that are looked at, spread over the recording.

    Raises:
        ReadError: ``image_size_differs``.
    """
    camera = camera_of(session, row.recording_id, row.asked["camera"])
    frames = session.scalars(
        select(CameraFrame).where(CameraFrame.sensor_id == camera.id).order_by(CameraFrame.index)
    ).all()
    fitting = check_image_size(camera, frames, calibration)
    apart_ns = camera.facts.get("offset_ns") or 0
    places = spread([(frame.stamp_ns - apart_ns, frame.offset, frame.length) for frame in fitting])
    return _Drive(lidar_key(session, row.recording_id), camera.blob_key, places)


def check_image_size(
    camera: Sensor, frames: Sequence[CameraFrame], calibration: KnownCalibration
) -> list[CameraFrame]:
    """Return the frames of the calibration's size. Raises ReadError ``image_size_differs`` if there are none."""
    fitting = [frame for frame in frames if (frame.width, frame.height) == calibration.image_size]
    if not fitting:
        width, height = calibration.image_size
        raise ReadError(
            "image_size_differs",
            f"No frame of camera {camera.name} has {width} x {height} pixels, as the calibration has.",
            "Give a calibration of this camera for this recording's image size.",
        )
    return fitting


def _writing(
    claim: Claim, result: dict[str, Any], single_pairs: dict[str, Any] | None = None
) -> Callable[[Session], None]:
    def write(session: Session) -> None:
        row = session.get_one(Analysis, claim.subject_id)
        row.result, row.single_pairs, row.state = result, single_pairs, WorkState.DONE
        session.flush()
        if row.result_id is not None:
            _judge_elsewhere(session, row.result_id)

    return write


def _judge_elsewhere(session: Session, result_id: UUID) -> None:
    """Replace the check of other data among a judged result's checks."""
    result = session.get(Result, result_id, with_for_update=True)
    if result is None or result.checks is None:
        return
    check = elsewhere(other_data(session, [result])[result.id])
    others = [other for other in result.checks if other["name"] != check.name]
    result.checks = [*others, check.model_dump(mode="json")]
    result.verdict = verdict_of(result.stored_checks, "mount_with_lens")
