"""The table of formats that are read, and the reading of files whose format their content tells.

What files hold is shown as answers have it, with doubts about each lens and mount.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from apexcal.documents.imports import CalibrationFiles, ImportFormat, ReadCamera, ReadFiles, ReadLens
from apexcal.documents.transforms import SolvedTransform
from apexcal.geometry.se3 import SE3, to_document
from service.imports.camera_info import is_camera_info, read_camera_info
from service.imports.contents import Contents, FileCamera, refused
from service.imports.kalibr import is_euroc, is_kalibr, read_euroc, read_kalibr
from service.imports.kitti import is_kitti, read_kitti
from service.imports.lidar_tools import (
    is_direct_visual,
    is_fast_livo2,
    is_sensors_calibration,
    read_direct_visual,
    read_fast_livo2,
    read_sensors_calibration,
)
from service.imports.opencv import is_opencv, is_opencv_stereo, read_opencv, read_opencv_stereo
from service.imports.plausibility import known_lens, lens_doubts, mount_doubts
from service.imports.yaml_text import read_yaml

_KNOWN = (
    "Known are ROS camera_info (YAML), OpenCV's FileStorage (YAML or JSON; also stereo_calib's two files), Kalibr's "
    "camchain, EuRoC's sensor.yaml, KITTI's calib_cam_to_cam.txt, calib_velo_to_cam.txt and calib.txt, FAST-LIVO2's "
    "configuration with its camera file, direct_visual_lidar_calibration's calib.json, and SensorsCalibration's JSON."
)
_Member = Mapping[str, Any]


class _Kind(NamedTuple):
    """A format: whether a document is of it, and its reader. ``files``: how many belong together."""

    fits: Callable[[_Member], bool]
    read: Callable[[str, _Member], Contents]
    files: int = 1


# The first that fits.
_KINDS: Final[Mapping[ImportFormat, _Kind]] = {
    "direct_visual": _Kind(is_direct_visual, read_direct_visual),
    "fast_livo2": _Kind(is_fast_livo2, read_fast_livo2, files=2),
    "sensors_calibration": _Kind(is_sensors_calibration, read_sensors_calibration, files=4),
    "euroc": _Kind(is_euroc, read_euroc),
    "kalibr": _Kind(is_kalibr, read_kalibr),
    "opencv_stereo": _Kind(is_opencv_stereo, read_opencv_stereo, files=2),
    "camera_info": _Kind(is_camera_info, read_camera_info),
    "opencv": _Kind(is_opencv, read_opencv),
}


class Read(NamedTuple):
    """What files hold, and in which format they came."""

    format: ImportFormat
    contents: Contents


def read_files(sent: CalibrationFiles) -> Read:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    if sent.format == "kitti" or (sent.format is None and any(map(is_kitti, sent.files.values()))):
        return Read("kitti", read_kitti(sent.files))
    for name, text in sent.files.items():
        if text.lstrip().startswith("<"):
            raise refused(f"{name} is XML.", f"Save it as YAML. {_KNOWN}")
    document: dict[str, Any] = {}
    for name, text in sent.files.items():
        members = read_yaml(name, text)
        if twice := sorted(set(members) & set(document)):
            raise refused(f"Two files have {twice[0]}.", "Send the files of one calibration.")
        document |= members
    storage = any(text.startswith("%YAML:") for text in sent.files.values())
    return _read(" and ".join(sent.files), document, len(sent.files), sent.format, storage=storage)


def _read(name: str, document: _Member, files: int, stated: ImportFormat | None, *, storage: bool) -> Read:
    """``storage``: whether a file begins as OpenCV's FileStorage does; then it is no other program's."""
    fitting: list[ImportFormat] = [
        format
        for format, kind in _KINDS.items()
        if kind.fits(document) and (not storage or format in ("opencv", "opencv_stereo"))
    ]
    if storage:
        fitting.append("opencv")
    format = stated or next(iter(fitting), None)
    if format is None or format == "kitti":
        raise refused(f"{name} is not a known calibration file.", _KNOWN)
    if files > _KINDS[format].files:
        raise refused(f"There are {files} files.", f"Of {format} {_KINDS[format].files} belong together.")
    if stated not in (None, "opencv", *fitting):
        raise refused(f"{name} does not look like {stated}.", _KNOWN)
    return Read(format, _KINDS[format].read(name, document))


def files_view(sent: CalibrationFiles) -> ReadFiles:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    kind, content = read_files(sent)
    return ReadFiles(
        format=kind,
        cameras=[_camera(camera, sent.image_size) for camera in content.cameras],
        camera_transforms=[transform_view(transform) for transform in content.camera_transforms],
        notes=content.notes,
    )


def transform_view(T: SE3) -> SolvedTransform:
    """A transform in every form of its rotation."""
    return SolvedTransform.model_validate(to_document(T))


def _camera(camera: FileCamera, size: tuple[int, int] | None) -> ReadCamera:
    doubts: list[str] = []
    lens = mount = None
    if camera.lens is not None:
        read = known_lens(camera.name, camera.lens, size)
        doubts += lens_doubts(read)
        lens = ReadLens(
            width=read.width,
            height=read.height,
            distortion_model=camera.lens.distortion_model,
            K=read.K,
            D=read.D,
            model=read.model,
        )
    if camera.T_camera_lidar is not None:
        doubts += mount_doubts(camera.T_camera_lidar)
        mount = transform_view(camera.T_camera_lidar)
    return ReadCamera(name=camera.name, topic=camera.topic, lens=lens, T_camera_lidar=mount, doubts=doubts)
