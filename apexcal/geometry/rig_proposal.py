"""A rig proposed from what a recording and a URDF say, with the questions that they leave open.

Command, client and pages take their rigs from :func:`propose_rig`; nothing else derives one.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import radians
from typing import Any, Final, NamedTuple

import numpy as np
from pydantic import ValidationError

from apexcal.documents.base import first_fault, legible_text
from apexcal.documents.errors import InputError
from apexcal.documents.fleets import NewRig
from apexcal.documents.name_words import telling, words
from apexcal.documents.readings import ImageKind
from apexcal.documents.rig_proposals import AS_TREE, LIDAR, Direction, RigAnswers, RigProposal, RigQuestion
from apexcal.geometry.camera_axes import OPTICAL, axis_direction, optical_frame, upright
from apexcal.geometry.frame_tree import FrameTree, Joint, JointPath, unusable
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_euler
from apexcal.geometry.se3 import SE3, Floats

_YAW_DEG: Final[dict[Direction, float]] = {"forward": 0.0, "left": 90.0, "backward": 180.0, "right": -90.0}
# The default frames of LiDARs' drivers: velodyne, os_lidar, hesai_lidar, pandar, rslidar, livox_frame, laser.
_LIDAR_WORDS: Final = frozenset(("velodyne", "lidar", "hesai", "pandar", "rslidar", "livox", "laser", "ouster"))
_MOST_CHOICES: Final = 100
_LONGEST_NAME: Final = 200


class RecordedSensor(NamedTuple):
    """A sensor as a recording holds it: ``lidar``, or a camera by its name in the rig.

    ``image_size`` is width and height, pixels. ``R`` has the 9 numbers of its CameraInfo by rows.
    """

    name: str
    topic: str
    frame_id: str
    image_size: tuple[int, int] | None = None
    image_kind: ImageKind | None = None
    R: Sequence[float] | None = None


class _Mount(NamedTuple):
    """A camera's mount in a tree: ``T_camera_lidar``, and the joint's transforms if there is one to solve for.

    ``T_top_lidar`` leads to the frame that says where up and forward are.
    """

    T_camera_lidar: SE3
    joint: dict[str, Any] | None
    T_top_lidar: SE3


def propose_rig(
    sensors: Sequence[RecordedSensor], trees: Mapping[str, FrameTree], answers: RigAnswers, name: str = "rig"
) -> RigProposal:
    """Return a rig that the service takes, where its mounts come from, and what is only assumed.

    Args:
        sensors: the LiDAR first, then the cameras.
        trees: by their names in sentences; the first tree that leads from the LiDAR to a camera counts.
        answers: a person's.

    Raises:
        InputError: ``frames_not_usable``, also for answers about sensors that there are not.
    """
    _check_answers(answers, sensors)
    frames = _recorded_frames(sensors) | answers.frames
    turned = [camera for camera, looks in answers.looks.items() if looks != AS_TREE]
    every = list(dict.fromkeys(frame for tree in trees.values() for frame in tree.frames))
    notes: list[str] = []
    questions: list[RigQuestion] = []
    for sensor in sensors:
        is_open = every and frames[sensor.name] not in every and sensor.name not in (*answers.frames, *turned)
        if is_open and not (sensor.name == LIDAR and len(turned) == len(sensors) - 1):
            question = _frame_question(sensor, frames, every)
            frames[sensor.name] = question.assumed
            questions.append(question)
    lidar, *cameras = sensors
    rig: dict[str, Any] = {
        "name": name,
        "lidar": {"frame": frames[LIDAR], "topic": lidar.topic},
        "cameras": [_camera(camera, frames, trees, answers, notes, questions) for camera in cameras],
        "T_vehicle_lidar": _vehicle(frames[LIDAR], trees.values()),
    }
    try:
        return RigProposal(rig=NewRig.model_validate(rig), notes=notes, questions=questions)
    except ValidationError as error:
        where, wrong = first_fault(error)
        raise unusable(f"The rig would be refused: {where}: {wrong}.", "Name other frames.") from None


def _check_answers(answers: RigAnswers, sensors: Sequence[RecordedSensor]) -> None:
    names = [sensor.name for sensor in sensors]
    cameras = [name for name in names if name != LIDAR]
    strange = [name for name in answers.frames if name not in names]
    strange += [name for name in (*answers.looks, *answers.joints) if name not in cameras]
    if strange:
        raise unusable(
            f"There is no {strange[0]!r} in the recording.", f"Its sensors are {', '.join(names)}; name one of these."
        )


def _recorded_frames(sensors: Sequence[RecordedSensor]) -> dict[str, str]:
    """Return a frame for each sensor: the recorded one if it is a valid name that no other sensor has."""
    frames: dict[str, str] = {}
    for sensor in sensors:
        frame = sensor.frame_id.removeprefix("/")
        if not _is_name(frame) or frame in frames.values():
            frame = LIDAR if sensor.name == LIDAR else f"camera_{sensor.name}_optical"
        frames[sensor.name] = frame
    return frames


def _is_name(text: str) -> bool:
    try:
        return 0 < len(text) <= _LONGEST_NAME and text == text.strip() and bool(legible_text(text))
    except ValueError:
        return False


def _frame_question(sensor: RecordedSensor, frames: Mapping[str, str], every: Sequence[str]) -> RigQuestion:
    """Return the question for a sensor's frame in the tree, with the likeliest one assumed if there is one."""
    own = frames[sensor.name]
    free = [frame for frame in every if frame not in frames.values()]
    likely = [frame for frame in free if words(frame) & (_LIDAR_WORDS if sensor.name == LIDAR else OPTICAL)]
    wanting = telling(f"{sensor.name} {sensor.frame_id}")
    likely.sort(key=lambda frame: -len(wanting & words(frame)))
    shared = [len(wanting & words(frame)) for frame in likely[:2]]
    is_clear = len(likely) == 1 or (len(likely) > 1 and shared[0] > shared[1])
    recorded = f"the frame {sensor.frame_id!r}" if sensor.frame_id else "no frame"
    return RigQuestion(
        sensor=sensor.name,
        asks="frames",
        sentence=f"The recording states {recorded} for {sensor.name}, and the vehicle's tree has none of this name.",
        choices=list(dict.fromkeys([*likely, *free]))[:_MOST_CHOICES],
        assumed=likely[0] if is_clear else own,
    )


def _camera(
    camera: RecordedSensor,
    frames: Mapping[str, str],
    trees: Mapping[str, FrameTree],
    answers: RigAnswers,
    notes: list[str],
    questions: list[RigQuestion],
) -> dict[str, Any]:
    if camera.image_size is None:
        raise unusable(f"The recording does not say how large the images of {camera.name} are.", "Record them again.")
    looks = answers.looks.get(camera.name)
    mount = doubt = None
    if looks in (None, AS_TREE):
        mount, doubt = _of_trees(camera, frames, trees, answers.joints.get(camera.name), notes)
    if doubt and not (mount and looks) and not any(each.sensor in (LIDAR, camera.name) for each in questions):
        assumed, choices = (AS_TREE, [AS_TREE, *_YAW_DEG]) if mount else ("forward", [*_YAW_DEG])
        questions.append(
            RigQuestion(sensor=camera.name, asks="looks", sentence=doubt, choices=choices, assumed=assumed)
        )
    if mount is None:
        T_top_lidar = upright(trees.values(), frames[LIDAR], frames[camera.name])
        turn = rotation_from_euler((-radians(_YAW_DEG.get(looks or "forward", 0.0)), 0.0, 0.0))
        R = (FORWARD_LIDAR_TO_OPTICAL @ turn @ T_top_lidar.R).round(15)
        mount = _Mount(SE3(frames[camera.name], frames[LIDAR], R), None, T_top_lidar)
    R, kind = camera.R, camera.image_kind
    rotation = {"matrix": [R[:3], R[3:6], R[6:]]} if R and kind == "rectified" else None
    return {
        "name": camera.name,
        "frame": mount.T_camera_lidar.to_frame,
        "topic": camera.topic,
        "image_size": camera.image_size,
        "nominal": _document(mount.T_camera_lidar),
        "joint": mount.joint,
        "images": kind and {"kind": kind, "rotation": rotation},
    }


def _of_trees(
    camera: RecordedSensor,
    frames: Mapping[str, str],
    trees: Mapping[str, FrameTree],
    joint: str | None,
    notes: list[str],
) -> tuple[_Mount | None, str | None]:
    """Return the camera's pose in the first tree that holds it, with notes, and the questions that remain."""
    why = ""
    for label, tree in trees.items():
        try:
            mount = _placed(tree, frames[LIDAR], frames[camera.name], joint)
        except InputError as error:
            if joint is not None:
                raise
            why = f" {error.message}"
        else:
            if mount is not None:
                return mount, _view(camera, mount, label, notes)
    return None, f"Nothing says how {camera.name} is mounted: no tree leads from {frames[LIDAR]} to it.{why}"


def _placed(tree: FrameTree, lidar: str, frame: str, joint_name: str | None) -> _Mount | None:
    """Return where the tree has the camera of this frame; None where it does not lead there. Raises as the tree."""
    if not {lidar, frame} <= tree.frames.keys() or tree.root(lidar) != tree.root(frame):
        return None
    T_top_lidar = upright([tree], lidar, frame)
    frame, T_optical_frame = optical_frame(tree, T_top_lidar.to_frame, frame)
    way = tree.way(lidar, frame)
    joint = _joint(way, frame, joint_name)
    _check_fixed(way.joints)
    T_camera_lidar = T_optical_frame @ tree.transform(frame, lidar)
    if joint is None:
        return _Mount(T_camera_lidar, None, T_top_lidar)
    T_child_camera = tree.transform(joint.child, frame) @ T_optical_frame.inverse()
    T_parent_lidar = tree.transform(joint.parent, lidar)
    around = {"T_parent_lidar": _document(T_parent_lidar), "T_child_camera": _document(T_child_camera)}
    return _Mount(T_camera_lidar, around, T_top_lidar)


def _joint(way: JointPath, frame: str, name: str | None) -> Joint | None:
    """Return the joint to solve for: the named one, else the first on the camera's side."""
    if name is None:
        return way.down[0] if way.down else None
    joint = next((each for each in way.down if name in (each.name, each.child)), None)
    if joint is None:
        raise unusable(
            f"The joint {name!r} is not on the camera's side of the way from LiDAR to {frame!r}.",
            f"The joints there are {', '.join(each.name for each in way.down) or 'none'}.",
        )
    return joint


def _check_fixed(joints: Iterable[Joint]) -> None:
    moving = next((joint for joint in joints if not joint.fixed), None)
    if moving is not None:
        raise unusable(
            f"The joint {moving.name!r} between {moving.parent!r} and {moving.child!r} moves.",
            "A calibration holds along fixed joints.",
        )


def _vehicle(lidar: str, trees: Collection[FrameTree]) -> dict[str, Any] | None:
    """Return ``T_vehicle_lidar`` to the root above the LiDAR, where fixed joints lead there."""
    for tree in trees:
        above = tree.above(lidar) if lidar in tree.frames else []
        if above and all(joint.fixed for joint in above):
            return _document(tree.transform(above[-1].parent, lidar))
    return None


def _view(camera: RecordedSensor, mount: _Mount, label: str, notes: list[str]) -> str | None:
    """Note where a camera looks in a tree, and which joint is solved for. Return a doubt about this, if any."""
    T, joint = mount.T_camera_lidar, mount.joint
    axis = axis_direction(T, mount.T_top_lidar, f"{camera.name} {camera.topic} {camera.frame_id}")
    view = f"{camera.name}: {T.to_frame} looks {axis.sides}, as {label} says"
    solved = f" Results are also given for {joint['T_child_camera']['to_frame']}." if joint else ""
    notes.append(f"{view}, and is {float(np.linalg.norm(T.t)):.2f} m from {T.from_frame}.{solved}")
    if not axis.is_unlikely:
        return None
    return f"{view}. That is unlikely: its axes may be exchanged (z ahead in an optical frame, x ahead in a body's)."


def _document(T: SE3) -> dict[str, Any]:
    """Return a transform as requests send it."""
    return {
        "to_frame": T.to_frame,
        "from_frame": T.from_frame,
        "rotation": {"matrix": [_numbers(row) for row in T.R]},
        "translation_m": _numbers(T.t),
    }


def _numbers(values: Floats) -> list[float]:
    """Return Python's own numbers, without negative zeros."""
    return [float(value) + 0.0 for value in values]
