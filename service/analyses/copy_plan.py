"""Plan a copy of a recording: which calibration goes into which of its topics and frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.copies import CopyRequest
from apexcal.geometry.frame_tree import FrameTree, Joint, recorded_tree, unusable
from apexcal.geometry.se3 import SE3
from service.exports.calibrated import CalibratedCamera
from service.exports.format import numbers
from service.platform.db.base import Json
from service.platform.db.fleets import Vehicle
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import unprocessable
from service.publications.camera_queries import published_exports
from service.publications.selection import Selection


def plan_copy(session: Session, recording: Recording, request: CopyRequest) -> Json:
    """Plain data for the worker, and ``results`` by camera.

    Raises:
        Problem: as for what a vehicle is given; 422 ``camera_not_recorded``, ``lens_without_equal``,
            ``frames_not_usable``.
    """
    sensors, cameras = recorded_cameras(session, recording, request)
    lidar_frame = frame_of(sensors["lidar"], cameras[0].lidar_frame)
    frames = {camera.name: frame_of(sensors[camera.name], camera.T_own_lidar.to_frame) for camera in cameras}
    fixed = (recording.facts or {}).get("static_transforms") or ()
    tree = recorded_tree(pose for pose in fixed if pose.get("origin") != "robot_description")
    return {
        "lidar_frame": lidar_frame,
        "cameras": [_camera(camera, sensors[camera.name], frames[camera.name]) for camera in cameras],
        "poses": _poses(tree, lidar_frame, cameras, frames, request.joints),
        "results": {camera.name: camera.source for camera in cameras},
    }


def recorded_cameras(
    session: Session, recording: Recording, request: CopyRequest
) -> tuple[dict[str, Sensor], list[CalibratedCamera]]:
    """The recording's sensors by name, and those of its cameras that are wanted and given a calibration.

    Raises:
        Problem: as for what a vehicle is given; 422 ``camera_not_recorded``.
    """
    of_recording = select(Sensor).where(Sensor.recording_id == recording.id)
    sensors = {sensor.name: sensor for sensor in session.scalars(of_recording)}
    vehicle = session.get_one(Vehicle, recording.vehicle_id)
    published = published_exports(session, vehicle, Selection(request.cameras, request.alias)).cameras
    cameras = [camera for camera in published if camera.name in sensors]
    names = {camera.name for camera in cameras}
    missing = [name for name in (*request.cameras, *request.joints) if name not in names]
    if missing or not cameras:
        raise unprocessable(
            "camera_not_recorded",
            f"The recording {recording.name!r} has no calibrated camera {missing[0]!r}."
            if missing
            else f"No camera of the recording {recording.name!r} has a calibration.",
            "Name cameras that were recorded and have a published calibration.",
        )
    return sensors, cameras


def frame_of(sensor: Sensor, otherwise: str) -> str:
    """A sensor's frame as the recording names it, else as the rig does."""
    return sensor.frame_id.removeprefix("/") or otherwise


def _camera(camera: CalibratedCamera, sensor: Sensor, frame: str) -> Json:
    # CameraInfo has no skew; P, the lens of rectified images, has no distortion either.
    lost = "a skew" if camera.skew else "a distortion" if camera.is_rectified and any(camera.D) else None
    if lost:
        raise unprocessable(
            "lens_without_equal",
            f"The lens of {camera.name} has {lost}, which readers of CameraInfo ignore.",
            "Calibrate with skew locked at 0 (`locked`), and rectified images as pinhole.",
        )
    return {
        "name": camera.name,
        "topic": sensor.topic,
        "frame_id": frame,
        "width": camera.width,
        "height": camera.height,
        "distortion_model": camera.written_as.camera_info,
        "K": [value for row in camera.K for value in row],
        "D": camera.D,
        "is_rectified": camera.is_rectified,
    }


def _poses(
    tree: FrameTree,
    lidar: str,
    cameras: Sequence[CalibratedCamera],
    frames: Mapping[str, str],
    joints: Mapping[str, str],
) -> list[Json]:
    """The poses to write, one for each camera; each is solved in the tree with those before it."""
    poses: list[Json] = []
    for camera in cameras:
        T_camera_lidar = replace(camera.T_own_lidar, to_frame=frames[camera.name], from_frame=lidar)
        others = [frame for name, frame in frames.items() if name != camera.name]
        pose, is_new = _pose(tree, T_camera_lidar, others, joints.get(camera.name))
        tree.put(Joint(pose.from_frame, True, pose))
        poses.append(planned_pose(pose, is_new=is_new))
    return poses


def planned_pose(pose: SE3, *, is_new: bool) -> Json:
    """A pose as the worker writes it; ``is_new``: in no recorded transform's place."""
    return {
        "parent": pose.to_frame,
        "child": pose.from_frame,
        "translation_m": numbers(pose.t),
        "quaternion_xyzw": pose.quaternion_xyzw,
        "is_new": is_new,
    }


def _pose(tree: FrameTree, T_camera_lidar: SE3, others: Sequence[str], named: str | None) -> tuple[SE3, bool]:
    """``T_parent_child`` that makes the tree say the calibration, and whether it is a new one."""
    camera, lidar = T_camera_lidar.to_frame, T_camera_lidar.from_frame
    T_lidar_camera = T_camera_lidar.inverse()
    if camera not in tree.frames:
        return T_lidar_camera, True
    root = tree.root(camera)
    if lidar not in tree.frames or tree.root(lidar) != root:
        # The camera's own tree is hung on the LiDAR.
        return T_lidar_camera @ tree.transform(camera, root), True
    joint = _joint(tree, camera, lidar, others, named)
    T_parent_lidar, T_camera_child = tree.transform(joint.parent, lidar), tree.transform(camera, joint.child)
    return T_parent_lidar @ T_lidar_camera @ T_camera_child, False


def _joint(tree: FrameTree, camera: str, lidar: str, others: Sequence[str], named: str | None) -> Joint:
    """The joint whose pose is replaced: it must not carry another calibrated camera."""
    down = tree.way(lidar, camera).down
    if not down:
        raise unusable(
            f"In /tf_static the LiDAR's frame {lidar!r} lies below the camera's, {camera!r}.",
            "Only frames on the camera's side are moved. Record with the camera below the LiDAR or the vehicle.",
        )
    shared = {joint.child for other in others if other in tree.frames for joint in tree.above(other)}
    free = [joint for joint in down if joint.child not in shared]
    if named is not None:
        free = [joint for joint in free if named in (joint.name, joint.child)]
    if not free:
        raise unusable(
            f"No frame between {lidar!r} and {camera!r} can be moved by itself"
            + (f" under the name {named!r}." if named else "."),
            f"The frames there are {', '.join(joint.child for joint in down)}; some of them carry other cameras.",
        )
    return free[0]
