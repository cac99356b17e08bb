"""A rig from the vehicle's own tree of frames: nominal mounts, where the LiDAR is, and the joints to solve for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from apexcal.documents.fleets import NewRig
from apexcal.documents.imports import DraftCamera, DraftRequest, RigDraft
from apexcal.geometry.se3 import SE3, from_document
from service.exports.numbers import numbers
from service.exports.urdf_tree import read_joints
from service.imports.frame_tree import FrameTree, Joint, Way, unusable


def urdf_tree(document: bytes) -> FrameTree:
    """Raises :class:`Problem` 422 ``urdf_not_read``, ``frames_not_usable``."""
    joints = read_joints(document)
    return FrameTree(Joint(name, one.kind == "fixed", one.T_parent_child) for name, one in joints.items())


def recorded_tree(transforms: Iterable[Mapping[str, Any]]) -> FrameTree:
    """The tree of a recording's ``/tf_static``, as its facts keep it. A joint is named after its child."""
    return FrameTree(
        Joint(
            one["child"],
            True,
            from_document(
                {
                    "to_frame": one["parent"],
                    "from_frame": one["child"],
                    "rotation": {"quaternion_xyzw": one["quaternion_xyzw"]},
                    "translation_m": one["translation_m"],
                }
            ),
        )
        for one in transforms
    )


def draft(asked: DraftRequest, tree: FrameTree) -> RigDraft:
    """Raises :class:`Problem` 422 ``frames_not_usable``."""
    notes: list[str] = []
    lidar = asked.lidar_link
    vehicle = asked.vehicle_link or tree.root(lidar)
    rig: dict[str, Any] = {
        "name": asked.name,
        "lidar": {"frame": lidar, "topic": asked.lidar_topic},
        "cameras": [_camera(tree, lidar, camera, notes) for camera in asked.cameras],
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


def _camera(tree: FrameTree, lidar: str, asked: DraftCamera, notes: list[str]) -> dict[str, Any]:
    way = tree.way(lidar, asked.link)
    joint = _joint(way, asked)
    _check_fixed([one for one in way.joints if one is not joint])
    found: dict[str, Any] = {
        "name": asked.name,
        "frame": asked.link,
        "topic": asked.topic,
        "serial": asked.serial,
        "image_size": asked.image_size,
        "nominal": _document(tree.transform(asked.link, lidar)),
    }
    if joint is None:
        notes.append(
            f"The LiDAR is mounted on {asked.link}, so no joint on the camera's side is solved for. Results are "
            "T_camera_lidar."
        )
        return found
    notes.append(
        f"Results of {asked.name} are also given for the joint {joint.name!r}: the pose of {joint.child} in "
        f"{joint.parent}."
    )
    T_parent_lidar, T_child_camera = tree.transform(joint.parent, lidar), tree.transform(joint.child, asked.link)
    return found | {
        "joint": {"T_parent_lidar": _document(T_parent_lidar), "T_child_camera": _document(T_child_camera)}
    }


def _joint(way: Way, asked: DraftCamera) -> Joint | None:
    """The joint to solve for: the named one, else the first on the camera's side."""
    if asked.joint is None:
        found = way.down[0] if way.down else None
    else:
        found = next((one for one in way.down if asked.joint in (one.name, one.child)), None)
        if found is None:
            named = ", ".join(one.name for one in way.down) or "none"
            raise unusable(
                f"The joint {asked.joint!r} is not on the camera's side of the way from LiDAR to {asked.link!r}.",
                f"The joints there are {named}.",
            )
    if found is not None:
        _check_fixed([found])
    return found


def _check_fixed(joints: Iterable[Joint]) -> None:
    moving = next((one for one in joints if not one.fixed), None)
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
