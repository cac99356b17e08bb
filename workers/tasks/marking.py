"""The machine's marks of a detection's vertices in one camera."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from uuid import UUID

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Row, select
from sqlalchemy.orm import Session

from apexcal.documents.bounds import DEFAULT_ROTATION_RANGE_DEG
from apexcal.documents.camera_models import ModelName
from apexcal.documents.corners import CORNERS, TOP, CornerName
from apexcal.documents.lenses import lens_of_images, parameters_of
from apexcal.documents.machine_marks import MOST_VERTICES, TILE_COLUMNS
from apexcal.geometry.motion import velocities_of
from apexcal.geometry.rotations import vector_from_rotation
from apexcal.geometry.se3 import SE3, from_document
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex, VertexFrame, marked_corners
from service.platform.db.fleets import RigCamera
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from service.platform.jobs.claims import Claim, Lease
from workers.geometry.spherical import to_xyz
from workers.marks.propose import propose
from workers.marks.seeds import MOST_FRAMES, spread_over
from workers.marks.sights import Image, Lens, MarkProposal, MarkRefusal, MountedLens, RecordingFailure, Sight
from workers.readers.images.decoded_frames import decoded_frames
from workers.readers.recording import ReadError
from workers.tasks.analysis_files import keeping, store_file
from workers.tasks.context import Context
from workers.tasks.crop_tiles import write_tiles
from workers.tasks.originals import camera_of, require_room

# Covariance of a vertex whose detector states none: the ring rules' errors (docs/decisions/0008).
_UNSTATED: Final = np.diag([0.02, 0.02, 0.02]) ** 2
# The corners of a sweep with their frames.
_Board = Mapping[str, tuple[Vertex, VertexFrame]]
Answers = Mapping[CornerName, MarkProposal | MarkRefusal]
_COLUMNS: Final = ("u", "v", "sigma_u", "sigma_v", "edge_px", "places")
_WIDEST: Final = 1 << 14  # frames are marked as they are


@dataclass(frozen=True, eq=False)
class _MarkingWork:
    """Sights with the vertex of each corner, and the camera's frames: offset, length of each by its index.

    If sights are few, frames without a sight tell the background too.
    """

    recording_id: UUID
    camera_key: str
    sights: list[Sight]
    vertices: list[dict[str, UUID]]
    frames: dict[int, tuple[int, int]]
    corners: Sequence[CornerName]
    upper_corner: int
    lens: Lens | None
    nominal: SE3 | None
    model: ModelName
    paired_at_ms: float


def machine_marks(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """Mark the tips, and the other corners that are asked for, of at most `MOST_VERTICES` sweeps."""
    with context.database.reading() as session:
        work = _read(session, session.get_one(Analysis, claim.subject_id))
    with context.scratch() as folder:
        source = context.fetch(work.camera_key, folder)
        decoded = _decoded(context, work, source, folder, lease)
        sighted = {sight.frame for sight in work.sights}
        frames = {index: image for index, image in decoded.items() if index in sighted}
        usable = [number for number, sight in enumerate(work.sights) if sight.frame in frames]
        sights = [work.sights[number] for number in usable]
        height, width = frames[sights[0].frame].shape if sights else (1, 1)
        lease.report(0.5, "looking for the board's edges")
        proposals = propose(
            decoded,
            sights,
            (width, height),
            lens=work.lens,
            model=work.model,
            corners=work.corners,
            upper_corner=work.upper_corner,
            background=[index for index in decoded if index not in sighted],
            on_sight=lease.check,
        )
        rows = _rows(work, dict(zip(usable, proposals.answers, strict=True)))
        shown = _as_shown(work, source, frames, folder, lease)
        write = _storing_tiles(context, claim, work, rows, shown, folder / "crops.png")
    offset_ms = work.paired_at_ms + 1e3 * proposals.offset_s if proposals.offset_s else None
    result = _result(rows, proposals.failure, offset_ms, _contradicted(proposals.camera, work.nominal))

    def finish(session: Session) -> Json:
        write(session)
        return result

    return finish


def _storing_tiles(
    context: Context,
    claim: Claim,
    work: _MarkingWork,
    rows: list[dict[str, Any]],
    frames: Iterable[tuple[int, Image]],
    file: Path,
) -> Callable[[Session], object]:
    """Store a tile of each mark. Without room for them people look at whole frames."""
    frame_of = {
        str(vertex): sight.frame
        for sight, vertices in zip(work.sights, work.vertices, strict=True)
        for vertex in vertices.values()
    }
    if any(row["reason"] is None for row in rows):
        write_tiles(rows, frame_of, frames, file)
        try:
            key = store_file(context, claim, file, f"recordings/{work.recording_id}/crops")
        except ReadError:
            for row in rows:
                row.update(dict.fromkeys(TILE_COLUMNS))
        else:
            return keeping(claim, key, file, file.name, {})
    return lambda session: None


def _read(session: Session, analysis: Analysis) -> _MarkingWork:
    detection = session.get_one(Detection, analysis.detection_id)
    camera = camera_of(session, detection.recording_id, analysis.asked["camera"])
    corners = marked_corners(detection)
    paired = (
        select(Vertex, VertexFrame)
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .where(Vertex.detection_id == detection.id, VertexFrame.sensor_id == camera.id)
    )
    tips = session.execute(paired.where(Vertex.corner == TOP).order_by(Vertex.rank).limit(MOST_VERTICES)).all()
    boards: dict[int, dict[str, tuple[Vertex, VertexFrame]]] = {
        vertex.sweep_index: {TOP: (vertex, frame)} for vertex, frame in tips
    }
    for vertex, frame in session.execute(paired.where(Vertex.corner != TOP)):
        if vertex.sweep_index in boards:
            boards[vertex.sweep_index][vertex.corner] = (vertex, frame)
    roll = float(np.radians(detection.counts.get("roll", {}).get("mean_deg", 0.0)))
    rig_id = select(Recording.rig_id).where(Recording.id == camera.recording_id).scalar_subquery()
    of_rig = session.scalar(select(RigCamera).where(RigCamera.rig_id == rig_id, RigCamera.name == camera.name))
    indices = {frame.frame_index for _, frame in tips}
    columns = (CameraFrame.index, CameraFrame.offset, CameraFrame.length)
    places = {
        index: (offset, length)
        for index, offset, length in session.execute(select(*columns).where(CameraFrame.sensor_id == camera.id))
    }
    most = max(MOST_FRAMES - len(indices), 0) if tips else 0
    beside = spread_over([index for index in places if index not in indices], most)
    return _MarkingWork(
        camera.recording_id,
        camera.blob_key,
        [_sight(board, roll, v) for board, v in zip(boards.values(), _velocities(tips), strict=True)],
        [{corner: vertex.id for corner, (vertex, _) in board.items()} for board in boards.values()],
        {index: places[index] for index in indices.union(beside) if index in places},
        corners,
        int(detection.options.get("upper_corner") or 0),
        _stated_lens(of_rig, camera),
        from_document(of_rig.nominal) if of_rig else None,
        analysis.asked["model"],
        detection.pairing["offset_ns"] / 1e6,
    )


def _velocities(tips: Sequence[Row[Vertex, VertexFrame]]) -> NDArray[np.float64]:
    """(N, 3) m/s, by the detection's vertices near in time; zero for still poses."""
    points = [[vertex.x, vertex.y, vertex.z] for vertex, _ in tips]
    moved = velocities_of(points, [vertex.time_ns for vertex, _ in tips]) if tips else None
    return np.zeros((len(tips), 3)) if moved is None else moved


def _contradicted(camera: MountedLens | None, nominal: SE3 | None) -> str | None:
    """Say how the marks' mount is turned from the rig's, if that is too far for a fit about it."""
    if camera is None or nominal is None:
        return None
    turned = np.degrees(np.linalg.norm(vector_from_rotation(camera.mount.R @ nominal.R.T)))
    if turned <= DEFAULT_ROTATION_RANGE_DEG:
        return None
    left = np.degrees(np.arctan2(camera.mount.R[2, 1], camera.mount.R[2, 0]))
    return (
        f"By these marks the camera looks {abs(left):.0f} degrees to the {'left' if left > 0.0 else 'right'} of the "
        f"LiDAR's x axis, turned by {turned:.0f} degrees from the rig's mount. A calibration looks within "
        f"{DEFAULT_ROTATION_RANGE_DEG:.0f} degrees of that: state where the camera looks (--looks, or the rig)."
    )


def _stated_lens(of_rig: RigCamera | None, camera: Sensor) -> Lens | None:
    """Return the lens that the recording's CameraInfo states, if it is of images like the rig's."""
    facts = camera.facts or {}
    if of_rig is None or not facts.get("camera_info"):
        return None
    stated = lens_of_images(facts["camera_info"], of_rig.images["kind"] if of_rig.images else facts.get("image_kind"))
    size = (of_rig.image_width, of_rig.image_height)
    if not stated or not stated["model"] or (stated["width"], stated["height"]) != size:
        return None
    model: ModelName = stated["model"]
    values = parameters_of(stated, model)
    return Lens(model, np.array(list(values.values()), np.float64)) if values else None


def _sight(board: _Board, roll: float, velocity: NDArray[np.float64]) -> Sight:
    """Return the board at the frame's time."""
    at = {corner: vertex if frame.x is None else frame for corner, (vertex, frame) in board.items()}
    corners: dict[CornerName, NDArray[np.float64]] = {
        name: np.array([at[name].x, at[name].y, at[name].z]) for name in CORNERS if name in at
    }
    xyz, stated = corners[TOP], at[TOP].covariance
    covariance = _UNSTATED if stated is None else to_xyz(np.array([stated]), xyz[None])[0]
    return Sight(board[TOP][1].frame_index, corners, covariance, roll, velocity)


def _as_shown(
    work: _MarkingWork, source: Path, frames: Mapping[int, Image], folder: Path, lease: Lease
) -> Iterator[tuple[int, Image]]:
    """Yield the frames as people see them: in colour, or as they were measured if they have 16 bits."""
    if any(image.dtype == np.uint16 for image in frames.values()):
        yield from frames.items()
        return
    places = [work.frames[index] for index in frames]
    images = decoded_frames(source, places, folder, colour=True, widest=_WIDEST, must_stop=lease.check)
    for index, image in zip(frames, images, strict=True):
        yield index, frames[index] if image is None else image


def _decoded(context: Context, work: _MarkingWork, source: Path, folder: Path, lease: Lease) -> dict[int, Image]:
    """Decode grey frames by their index into a file of the scratch folder.

    Frames that are damaged, or of another kind or size, are left out. Frames of 16 bits are marked as they were
    measured: people see them stretched part by part.
    """
    indices = sorted(work.frames)
    places = [work.frames[index] for index in indices]
    images = decoded_frames(source, places, folder, colour=False, widest=_WIDEST, must_stop=lease.check, deep=True)
    frames: dict[int, Image] = {}
    whole: Image | None = None
    for number, (index, image) in enumerate(zip(indices, images, strict=True)):
        lease.report(0.5 * number / len(indices), "decoding frames")
        if image is None:
            continue
        if whole is None:
            require_room(context, shutil.disk_usage(folder).free, len(indices) * image.nbytes)
            shape = (len(indices), *image.shape)
            whole = np.lib.format.open_memmap(folder / "frames.npy", mode="w+", dtype=image.dtype, shape=shape)
        if (image.dtype, image.shape) == (whole.dtype, whole.shape[1:]):
            whole[number] = image
            frames[index] = whole[number]
    return frames


def _rows(work: _MarkingWork, answers_of: Mapping[int, Answers]) -> list[dict[str, Any]]:
    """Return all marks and reasons, each with its vertex."""
    rows: list[dict[str, Any]] = []
    for number, vertices in enumerate(work.vertices):
        answers = answers_of.get(number, {})
        for corner in CORNERS:
            if corner not in work.corners or corner not in vertices:
                continue
            row: dict[str, Any] = dict.fromkeys((*_COLUMNS, *TILE_COLUMNS, "reason"))
            answer = answers.get(corner)
            if isinstance(answer, MarkProposal):
                deviations = np.sqrt(np.diag(answer.covariance)).tolist()
                values = (*answer.pixel, *deviations, answer.short_side_px, [])
                row |= dict(zip(_COLUMNS, values, strict=True))
            else:
                row["reason"] = answer.reason if answer else "no_corner" if number in answers_of else "no_frame"
                row["edge_px"] = answer and answer.short_side_px
                row["places"] = [spot._asdict() for spot in answer.places] if answer else []
            rows.append({"vertex_id": str(vertices[corner]), "corner": corner, **row})
    return rows


def _result(
    rows: Sequence[dict[str, Any]], failure: RecordingFailure | None, offset_ms: float | None, warning: str | None
) -> Json:
    """Return the columns of all marks and reasons, and counts of the marks."""
    sigmas = [row["sigma_u"] for row in rows if row["reason"] is None]
    return {
        "corners": len(rows),
        "marked": len(sigmas),
        "reasons": dict(Counter(row["reason"] for row in rows if row["reason"])),
        "refusal": failure and failure.sentence,
        "sigma_px": float(np.median(sigmas)) if sigmas else None,
        "clock_offset_ms": offset_ms,
        "warning": warning,
        "marks": {name: [row[name] for row in rows] for name in rows[0]} if rows else {},
    }
