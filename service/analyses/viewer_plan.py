"""Plan a file for viewers: the published lenses, the pinholes of undistorted frames, and the cameras' poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sqlalchemy.orm import Session

from apexcal.documents.copies import CopyRequest
from apexcal.geometry.se3 import SE3
from service.analyses.copy_plan import frame_of, planned_pose, recorded_cameras
from service.exports.calibrated import CalibratedCamera
from service.platform.db.base import Json
from service.platform.db.fleets import Vehicle
from service.platform.db.recordings import Recording
from service.publications.camera_queries import published_cameras
from service.publications.selection import Selection


def plan_viewer_file(session: Session, recording: Recording, request: CopyRequest) -> Json:
    """Plain data for the worker, and ``results`` by camera.

    Raises:
        Problem: as for what a vehicle is given; 422 ``camera_not_recorded``.
    """
    sensors, cameras = recorded_cameras(session, recording, request)
    vehicle = session.get_one(Vehicle, recording.vehicle_id)
    offsets = {
        name: camera.clock_offset_ns
        for name, camera in published_cameras(session, vehicle, Selection(request.cameras, request.alias)).items()
    }
    lidar = frame_of(sensors["lidar"], cameras[0].lidar_frame)
    recorded = {camera.name: frame_of(sensors[camera.name], camera.frame) for camera in cameras}
    plan = viewer_file(cameras, lidar, recorded, offsets)
    facts = {"recording": recording.name, "alias": request.alias}
    facts |= {f"result of {camera.name}": camera.source for camera in cameras}
    return plan | {"for_viewers": True, "results": {camera.name: camera.source for camera in cameras}, "facts": facts}


def viewer_file(
    cameras: Sequence[CalibratedCamera], lidar: str, recorded: Mapping[str, str], offsets_ns: Mapping[str, int | None]
) -> Json:
    """Lenses and poses.

    Args:
        lidar: the points' frame.
        recorded: by camera, the frame that the recording states.
        offsets_ns: by camera, its clock minus the LiDAR's, if that is known.
    """
    frames: dict[str, str] = {}
    for camera in cameras:
        choices = (recorded[camera.name], camera.frame, f"{camera.name}_optical")
        frames[camera.name] = _first_free([lidar, *frames.values()], choices)
    return {
        "lidar_frame": lidar,
        "cameras": [_camera(camera, frames[camera.name], offsets_ns.get(camera.name) or 0) for camera in cameras],
        "poses": _poses(lidar, cameras, frames),
    }


def _first_free(taken: Sequence[str], choices: Sequence[str]) -> str:
    """A frame's name that no other frame has: drivers often give several cameras the same default name."""
    name = next((choice for choice in choices if choice not in taken), choices[-1])
    while name in taken:
        name += "_"
    return name


def _camera(camera: CalibratedCamera, frame: str, clock_offset_ns: int) -> Json:
    size = {"width": camera.width, "height": camera.height}
    f_x, f_y, c_x, c_y = (float(camera.intrinsics[name]) for name in ("f_x", "f_y", "c_x", "c_y"))
    K = [f_x, 0.0, c_x, 0.0, f_y, c_y, 0.0, 0.0, 1.0]
    # Viewers ignore a skew, so recorded frames of such a lens carry no calibration. Undistorted ones have none.
    raw = None if camera.skew else size | {"distortion_model": camera.written_as.foxglove, "K": K, "D": camera.D}
    return {
        "name": camera.name,
        "frame_id": frame,
        "clock_offset_ns": clock_offset_ns,
        "model": camera.model,
        "intrinsics": dict(camera.intrinsics),
        "raw": raw,
        "pinhole": size | {"distortion_model": "plumb_bob", "K": K, "D": [0.0] * 5},
    }


def _poses(lidar: str, cameras: Sequence[CalibratedCamera], frames: dict[str, str]) -> list[Json]:
    """The LiDAR in the vehicle where the rig states that, and each camera in the LiDAR's frame."""
    stated = next((camera.T_vehicle_lidar for camera in cameras if camera.T_vehicle_lidar), None)
    poses: list[SE3] = []
    if stated is not None and stated.to_frame not in (lidar, *frames.values()):
        poses.append(replace(stated, from_frame=lidar))
    poses += [replace(camera.T_lidar_camera, to_frame=lidar, from_frame=frames[camera.name]) for camera in cameras]
    return [planned_pose(pose, is_new=True) for pose in poses]
