"""A camera frame with the LiDAR's points, through a result's own lens, as a PNG file of the store."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple
from uuid import UUID

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from service.platform.db.base import Json
from service.platform.db.detections import Vertex
from service.platform.db.recordings import CameraFrame, Sensor
from service.platform.db.studies import Study
from service.platform.jobs.claims import Claim, Lease
from workers.overlays.camera import camera_of
from workers.overlays.drawing import draw, png
from workers.overlays.motion import LONGEST_NS, Moment, Moved, motion_at, moved
from workers.overlays.visible import visible
from workers.readers.images.decoded_frames import decoded_frames
from workers.readers.normalised.lidar_file import LidarFile
from workers.readers.recording import ReadError, Sweep
from workers.tasks.context import Context
from workers.tasks.loading import lidar_key, open_lidar
from workers.tasks.study_files import keeping, store_file

# Larger frames are drawn at a half, a quarter or an eighth of their size: a PNG of 4096 x 4096 has at most 50 MB.
_WIDEST: Final = 4096


class _Wanted(NamedTuple):
    """What is asked for, and where it lies."""

    asked: Json
    recording_id: UUID
    frame: CameraFrame
    camera_key: str
    lidar_key: str
    vertices: Sequence[Moment]

    @property
    def moment_ns(self) -> int:
        """When the frame was taken, by the LiDAR's clock."""
        return self.frame.stamp_ns - self.asked["offset_ns"]


class _Points(NamedTuple):
    """A sweep's points as they are drawn: (N, 3) float32, metres, LiDAR frame, with their rings (N,)."""

    of: Moved
    rings: NDArray[np.uint16]


def overlay(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """Draw the sweep nearest to the frame into it."""
    with context.database.reading() as session:
        wanted = _wanted(session, session.get_one(Study, held.subject_id))
    asked = wanted.asked
    with context.scratch() as folder:
        lease.report(0.1, "decoding the frame")
        image = _image(context, wanted, folder, lease)
        with open_lidar(context, wanted.lidar_key, folder) as lidar:
            index = _nearest(lidar, wanted.moment_ns)
            sweep = lidar.sweep(index)
        lease.report(0.6, "drawing points")
        points = _points(sweep, wanted)
        see = camera_of(asked["intrinsics"], asked["transform"])
        seen = visible(points.of.points, points.rings, see, (wanted.frame.width, wanted.frame.height))
        depths = draw(image, seen, wanted.frame.width)
        file = folder / "overlay.png"
        file.write_bytes(png(image))
        stored = store_file(context, held, wanted.recording_id, file, "overlays")
    told = {
        "width": image.shape[1],
        "height": image.shape[0],
        "sweep_index": index,
        "after_ns": int(sweep.stamp_ns + _middle_ns(sweep) - wanted.moment_ns),
        "points": len(seen.distance),
        "hidden": seen.hidden,
        "moved": points.of.number,
        "farthest_moved_m": points.of.farthest_m,
        "depth_m": list(depths) if depths else None,
    }
    name = f"{asked['camera']}-frame-{asked['frame']}.png"
    return keeping(held, wanted.recording_id, stored, name, told)


def _wanted(session: Session, study: Study) -> _Wanted:
    asked, recording_id = study.asked, study.recording_id
    camera = session.scalars(
        select(Sensor).where(Sensor.recording_id == recording_id, Sensor.name == asked["camera"])
    ).one()
    frame = session.get_one(CameraFrame, (camera.id, asked["frame"]))
    moment_ns = frame.stamp_ns - asked["offset_ns"]
    near = Vertex.time_ns.between(moment_ns - LONGEST_NS, moment_ns + LONGEST_NS)
    columns = (Vertex.time_ns, Vertex.x, Vertex.y, Vertex.z)
    rows = (
        session.execute(
            select(*columns).where(Vertex.detection_id == UUID(asked["detection_id"]), Vertex.corner == TOP, near)
        )
        if asked["detection_id"]
        else []
    )
    vertices = [Moment(*row) for row in rows]
    return _Wanted(asked, recording_id, frame, camera.blob_key, lidar_key(session, recording_id), vertices)


def _image(context: Context, wanted: _Wanted, folder: Path, lease: Lease) -> NDArray[np.uint8]:
    """The frame's pixels, BGR. Raises :class:`ReadError` ``frames_not_decoded``."""
    place = folder / "camera"
    place.mkdir()
    source = context.fetch(wanted.camera_key, place)
    places = [(wanted.frame.offset, wanted.frame.length)]
    (image,) = decoded_frames(source, places, folder, colour=True, widest=_WIDEST, must_stop=lease.check)
    if image is None:
        raise ReadError(
            "frames_not_decoded",
            f"Frame {wanted.frame.index} cannot be decoded: it is damaged, or too large.",
            "Choose another frame.",
        )
    return image


def _nearest(lidar: LidarFile, moment_ns: int) -> int:
    """The sweep whose middle is nearest to a moment. Raises :class:`ReadError` ``no_sweeps``."""
    if not len(lidar):
        raise ReadError("no_sweeps", "The recording holds no sweeps.", "Choose another recording.")
    first = lidar.sweep(lidar.nearest(moment_ns))
    return lidar.nearest(moment_ns - _middle_ns(first))


def _middle_ns(sweep: Sweep) -> int:
    """How long after its stamp a sweep's middle was measured."""
    offsets = sweep.offset_ns
    return (int(offsets.min()) + int(offsets.max())) // 2 if len(offsets) else 0


def _points(sweep: Sweep, wanted: _Wanted) -> _Points:
    """The points that returned something, by rings, with board and holder where they were at the frame's time."""
    returned = np.isfinite(sweep.xyz).all(1) & sweep.xyz.any(1)
    order = np.flatnonzero(returned)
    order = order[np.argsort(sweep.ring[order], kind="stable")]
    points = sweep.xyz[order].astype(np.float32)
    motion = motion_at(wanted.vertices, wanted.moment_ns)
    times_ns = sweep.stamp_ns + sweep.offset_ns[order].astype(np.int64)
    of = moved(points, times_ns, motion) if motion else Moved(points, 0, 0.0)
    return _Points(of, sweep.ring[order])
