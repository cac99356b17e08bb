"""A format's record, and its refusal of calibrations that it cannot carry.

Numbers are written so that reading gives the same bits.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from apexcal.documents.camera_models import CAMERA_MODELS, ModelName
from apexcal.documents.checks import figure
from apexcal.geometry.se3 import SE3, Floats
from service.exports.calibrated import Calibrated, CalibratedCamera, file_name

if TYPE_CHECKING:
    from service.exports.dropped import Dropped


def numbers(values: Floats | list[float]) -> list[float]:
    """Numbers by rows, as Python's own: they are written so that reading gives the same bits. No negative zeros."""
    return [float(value) + 0.0 for value in np.ravel(values)]


def yaml_number(value: float) -> str:
    """Write a number with a point, because YAML 1.1 takes ``1e-05`` for text."""
    text = repr(float(value) + 0.0)
    return text if "." in text else text.replace("e", ".0e")


def yaml_list(values: Floats | list[float]) -> str:
    """Numbers by rows, in brackets."""
    return f"[{', '.join(map(yaml_number, numbers(values)))}]"


# A person's mark errs by as much, so what is left out is less than the error of one pair.
MOST_DROPPED_PX = 1.0
_STATE_VEHICLE = "Say T_vehicle_lidar in the rig."
# Name inside the export -> text.
Files = dict[str, str]

# A frame in which neither a shell nor the substitutions of ROS 2's launch and of xacro replace anything.
_PLAIN_FRAME = re.compile(r"[A-Za-z0-9_/][A-Za-z0-9_./-]*")
RADIAL_TANGENTIAL: frozenset[ModelName] = frozenset(
    name for name, model in CAMERA_MODELS.items() if model.is_radial_tangential
)
KNOWN_ELSEWHERE: frozenset[ModelName] = frozenset(name for name, model in CAMERA_MODELS.items() if model.written_as)
WITHOUT_RATIONAL: frozenset[ModelName] = KNOWN_ELSEWHERE - {"rational_polynomial"}


@dataclass(frozen=True)
class Format:
    """One format: what writes it, and what it can say.

    ``direction`` says what its transform maps into what. ``skew``: whether its readers use the camera matrix whole.
    ``third_radial``: whether it has OpenCV's k3. ``carries_lens``: otherwise its mount is the one
    for the lens that the vehicle uses, see :meth:`CalibratedCamera.alone`. ``of_undistorted``: whether its images are
    undistorted ones, see :meth:`CalibratedCamera.undistorted`. ``mount_apart``: whether it writes mount
    and lens into different files, so that a reader may take the mount alone.
    ``one_tree``: whether all frames must hang together. ``plain_frames``: whether its readers may take a frame's name
    for arguments or commands.
    """

    name: str
    title: str
    write: Callable[[Calibrated], Files]
    kind: str
    direction: str
    lenses: frozenset[ModelName] = KNOWN_ELSEWHERE
    skew: bool = False
    third_radial: bool = True
    carries_lens: bool = True
    of_undistorted: bool = False
    mount_apart: bool = False
    needs_vehicle: bool = False
    one_lidar: bool = False
    one_tree: bool = False
    plain_frames: bool = False


def each_camera(writers: Mapping[str, Callable[[CalibratedCamera], str]]) -> Callable[[Calibrated], Files]:
    """Return a writer of each camera's files; ``{}`` in their names stands for the camera's."""
    return lambda calibrated: {
        name.format(file_name(camera.name)): write(camera)
        for camera in calibrated.cameras
        for name, write in writers.items()
    }


def obstacle(target: Format, calibrated: Calibrated) -> tuple[str, str] | None:
    """Why the format cannot carry this, and what to change, as sentences; None where it can."""
    for camera in calibrated.cameras:
        reason = (_of_lens(target, camera) if target.carries_lens else None) or _of_mount(target, camera)
        if reason:
            return reason
    frames = " and ".join(calibrated.lidar_frames)
    if reason := _clash(calibrated):
        return reason, "Ask for one camera."
    if target.one_lidar and len(calibrated.lidar_frames) > 1:
        return f"{target.title} has one LiDAR, and the cameras are calibrated to {frames}.", "Ask for one camera."
    if target.one_tree and _is_apart(calibrated):
        return f"{target.title} is one tree, and nothing says how {frames} lie together.", _STATE_VEHICLE
    return None


def _is_apart(calibrated: Calibrated) -> bool:
    roots = {frame: calibrated.T_root_lidar(frame) for frame in calibrated.lidar_frames}
    return len({frame if root is None else root.to_frame for frame, root in roots.items()}) > 1


def _clash(calibrated: Calibrated) -> str | None:
    """Say which files or frames would clash; None if none do."""
    placed: dict[str, SE3] = {}
    for camera in calibrated.cameras:
        if camera.T_vehicle_lidar is None:
            continue
        first, own = placed.setdefault(camera.lidar_frame, camera.T_vehicle_lidar), camera.T_vehicle_lidar
        if first.to_frame != own.to_frame or not np.allclose(first.matrix, own.matrix, rtol=0.0, atol=1e-9):
            return f"Two rigs place {camera.lidar_frame} differently on the vehicle."
    frames = [camera.frame for camera in calibrated.cameras]
    names = [file_name(camera.name).upper() for camera in calibrated.cameras]
    if len(set(frames)) < len(frames) or len(set(names)) < len(names):
        return "Two cameras have frames or names that would be one in the files."
    children = [camera.joint.T_child_camera.to_frame for camera in calibrated.cameras if camera.joint]
    twice = next((frame for frame in children if children.count(frame) > 1), None)
    if twice is not None:
        return f"Two cameras place {twice} by the joint that each is calibrated for."
    return None


def _odd_frames(camera: CalibratedCamera) -> list[str]:
    others = [camera.T_vehicle_lidar.to_frame] if camera.T_vehicle_lidar else []
    if camera.joint:
        others += [camera.joint.T_parent_lidar.to_frame, camera.joint.T_child_camera.to_frame]
    return [name for name in (camera.frame, camera.lidar_frame, *others) if not _PLAIN_FRAME.fullmatch(name)]


def carried(target: Format, camera: CalibratedCamera) -> Dropped | None:
    """The camera as the format's readers see it, and what they leave out; None if they leave out nothing."""
    terms = ["skew"] if camera.skew and not target.skew else []
    if _third_radial(camera) and not target.third_radial:
        terms.append("k5")
    if not target.carries_lens or not terms:
        return None
    # Imported here: it needs OpenCV.
    from service.exports.dropped import drop

    return drop(camera, terms)


def _of_lens(target: Format, camera: CalibratedCamera) -> tuple[str, str] | None:
    if camera.lens not in target.lenses:
        remedy = f"Calibrate as {' or '.join(sorted(target.lenses))}."
        return f"{target.title} has no lens model for {camera.name}'s {camera.lens} distortion.", remedy
    dropped = carried(target, camera)
    if dropped is None or dropped.max_px <= MOST_DROPPED_PX:
        return None
    locks = ["skew"] if camera.skew and not target.skew else []
    locks += ["k5"] if _third_radial(camera) and not target.third_radial else []
    remedy = f"Calibrate with {' and '.join(locks)} locked at 0 (`locked`)."
    return f"{lacking(target, camera)}: {dropped.sentence}.", remedy


def lacking(target: Format, camera: CalibratedCamera) -> str:
    """Return the terms of the camera's lens that the format's readers leave out."""
    if camera.skew and not target.skew:
        skew = figure(camera.skew, 3)
        return f"The lens of {camera.name} has a skew of {skew}, which readers of {target.title} ignore"
    return f"The lens of {camera.name} has a third radial coefficient (k5), {target.title} has two"


def _third_radial(camera: CalibratedCamera) -> bool:
    return camera.lens in RADIAL_TANGENTIAL and bool(camera.D[4])


def _of_mount(target: Format, camera: CalibratedCamera) -> tuple[str, str] | None:
    if target.needs_vehicle and camera.T_vehicle_lidar is None:
        reason = f"{target.title} starts at the vehicle's frame, and the rig {camera.rig} does not say where that is."
        return reason, _STATE_VEHICLE
    if target.plain_frames and (odd := _odd_frames(camera)):
        reason = f"{target.title} takes no frame named {odd[0]!r}, but letters, digits and _ . / - alone."
        return reason, "Name the frame plainly in a new rig."
    return None
