"""The table of formats that are read, and the reading of files whose format their content tells.

What files hold is shown as answers have it, with doubts about each lens and mount.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from apexcal.documents.imports import CalibrationFiles, ImportFormat, ReadCamera, ReadFiles, ReadLens
from apexcal.documents.transforms import SolvedTransform
from apexcal.geometry.se3 import SE3, to_document
from service.imports.camera_info import is_camera_info, read_camera_info
from service.imports.contents import Contents, FileCamera, refused
from service.imports.kalibr import is_kalibr, read_kalibr
from service.imports.kitti import is_kitti, read_kitti
from service.imports.opencv import is_opencv, read_opencv
from service.imports.plausibility import known_lens, lens_doubts, mount_doubts
from service.imports.yaml_text import read_yaml

_KNOWN = (
    "Known are ROS camera_info (YAML), OpenCV's FileStorage (YAML or JSON), Kalibr's camchain, and KITTI's "
    "calib_cam_to_cam.txt, calib_velo_to_cam.txt and calib.txt."
)


class Read(NamedTuple):
    """What files hold, and in which format they came."""

    format: ImportFormat
    contents: Contents


def read_files(sent: CalibrationFiles) -> Read:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    if sent.format == "kitti" or (sent.format is None and any(map(is_kitti, sent.files.values()))):
        return Read("kitti", read_kitti(sent.files))
    if len(sent.files) > 1:
        raise refused(f"There are {len(sent.files)} files.", "Send one; only KITTI's are sent together.")
    ((name, text),) = sent.files.items()
    if text.lstrip().startswith("<"):
        raise refused(f"{name} is XML.", f"Save it as YAML. {_KNOWN}")
    return _read_one(name, text, sent.format)


def _read_one(name: str, text: str, stated: ImportFormat | None) -> Read:
    document = read_yaml(name, text)
    fits: Mapping[ImportFormat, bool] = {
        "kalibr": is_kalibr(document),
        "camera_info": is_camera_info(document) and not text.startswith("%YAML:"),
        "opencv": is_opencv(text, document),
    }
    kind = stated or next((candidate for candidate, is_one in fits.items() if is_one), None)
    if kind == "kalibr":
        return Read(kind, read_kalibr(name, document))
    if kind == "camera_info":
        if not is_camera_info(document):
            raise refused(f"{name} has no distortion_model or no K.", _KNOWN)
        return Read(kind, read_camera_info(name, document))
    if kind == "opencv":
        return Read(kind, read_opencv(name, document))
    raise refused(f"{name} is not a known calibration file.", _KNOWN)


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
