"""A rig from the vehicle's own tree of frames: nominal mounts, where the LiDAR is, and the joints to solve for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from apexcal.documents.fleets import NewRig
from apexcal.documents.imports import DraftCamera, DraftRequest, RigDraft
from apexcal.geometry.se3 import SE3, from_document
from service.exports.format import numbers
from service.exports.urdf_tree import read_joints
from service.imports.frame_tree import FrameTree, Joint, JointPath, unusable


def urdf_tree(document: bytes) -> FrameTree:
    """Raises :class:`Problem` 422 ``urdf_not_read``, ``frames_not_usable``."""
    joints = read_joints(document)
    return FrameTree(Joint(name, joint.kind == "fixed", joint.T_parent_child) for name, joint in joints.items())


def recorded_tree(transforms: Iterable[Mapping[str, Any]]) -> FrameTree:
    """The tree of a recording's ``/tf_static``, as its facts keep it. A joint is named after its child."""
    return FrameTree(
        Joint(
            transform["child"],
            True,
            from_document(
                {
                    "to_frame": transform["parent"],
                    "from_frame": transform["child"],
                    "rotation": {"quaternion_xyzw": transform["quaternion_xyzw"]},
                    "translation_m": transform["translation_m"],
                }
            ),
        )
        for transform in transforms
    )


def draft(request: DraftRequest, tree: FrameTree) -> RigDraft:
    """Raises :class:`Problem` 422 ``frames_not_usable``."""
    notes: list[str] = []
    lidar = request.lidar_link
    vehicle = request.vehicle_link or tree.root(lidar)
    rig: dict[str, Any] = {
        "name": request.name,
        "lidar": {"frame": lidar, "topic": request.lidar_topic},
        "cameras": [_camera(tree, lidar, camera, notes) for camera in request.cameras],
    }
    if vehicle != lidar:
        _check_fixed(tree.way(lidar, vehicle).joints)
        rig["T_vehicle_lidar"] = _document(tree.transform(vehicle, lidar))
    try:
        return RigDraft(rig=NewRig.model_validate(rig), notes=notes)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise unusable(f"The rig would be refused: {where}: {first['msg']}.", "Name other links.") from None


def _camera(tree: FrameTree, lidar: str, camera: DraftCamera, notes: list[str]) -> dict[str, Any]:
    way = tree.way(lidar, camera.link)
    joint = _joint(way, camera)
    _check_fixed([other for other in way.joints if other is not joint])
    drafted: dict[str, Any] = {
        "name": camera.name,
        "frame": camera.link,
        "topic": camera.topic,
        "serial": camera.serial,
        "image_size": camera.image_size,
        "nominal": _document(tree.transform(camera.link, lidar)),
    }
    if joint is None:
        notes.append(
            f"The LiDAR is mounted on {camera.link}, so no joint on the camera's side is solved for. Results are "
            "T_camera_lidar."
        )
        return drafted
    notes.append(
        f"Results of {camera.name} are also given for the joint {joint.name!r}: the pose of {joint.child} in "
        f"{joint.parent}."
    )
    T_parent_lidar, T_child_camera = tree.transform(joint.parent, lidar), tree.transform(joint.child, camera.link)
    return drafted | {
        "joint": {"T_parent_lidar": _document(T_parent_lidar), "T_child_camera": _document(T_child_camera)}
    }


def _joint(way: JointPath, camera: DraftCamera) -> Joint | None:
    """The joint to solve for: the named one, else the first on the camera's side."""
    if camera.joint is None:
        joint = way.down[0] if way.down else None
    else:
        joint = next((candidate for candidate in way.down if camera.joint in (candidate.name, candidate.child)), None)
        if joint is None:
            named = ", ".join(candidate.name for candidate in way.down) or "none"
            raise unusable(
                f"The joint {camera.joint!r} is not on the camera's side of the way from LiDAR to {camera.link!r}.",
                f"The joints there are {named}.",
            )
    if joint is not None:
        _check_fixed([joint])
    return joint


def _check_fixed(joints: Iterable[Joint]) -> None:
    moving = next((joint for joint in joints if not joint.fixed), None)
    if moving is not None:
        raise unusable(
            f"The joint {moving.name!r} between {moving.parent!r} and {moving.child!r} moves.",
            "A calibration holds along fixed joints.",
        )


def _document(T: SE3) -> dict[str, Any]:
    """A transform as requests send it."""
    return {
        "to_frame": T.to_frame,
        "from_frame": T.from_frame,
        "rotation": {"matrix": [numbers(row) for row in T.R]},
        "translation_m": numbers(T.t),
    }
