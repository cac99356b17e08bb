"""The table of formats that are read, and the reading of files whose format their content tells.

Contents are shown in the form of answers, with doubts about each lens and mount.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import PurePath
from typing import Any, Final, NamedTuple

from apexcal.documents.imports import CalibrationFiles, ImportFormat, ReadCamera, ReadFiles, ReadLens
from apexcal.documents.transforms import SolvedTransform
from apexcal.geometry.se3 import SE3, to_document
from service.imports.camera_info import is_camera_info, read_camera_info
from service.imports.contents import Contents, FileCamera, refused
from service.imports.kalibr import is_kalibr, read_kalibr
from service.imports.kitti import bare_matrix, is_kitti, read_kitti
from service.imports.lidar_tools import (
    is_direct_visual,
    is_sensors_calibration,
    read_direct_visual,
    read_sensors_calibration,
)
from service.imports.members import AS_CAMERA_INFO, blocks, listed
from service.imports.mounts import AS_MOUNT, is_pose, with_mounts
from service.imports.named_lens import named_cameras
from service.imports.nuscenes import is_nuscenes, read_nuscenes
from service.imports.opencv import is_opencv_stereo, read_opencv_stereo
from service.imports.ost import is_ost, read_ost
from service.imports.plausibility import known_lens, lens_doubts, mount_doubts
from service.imports.yaml_text import read_yaml

_Member = Mapping[str, Any]


class _Kind(NamedTuple):
    """A format: whether a document is of it, and its reader. ``files``: how many belong together."""

    fits: Callable[[_Member], bool]
    read: Callable[[str, _Member], Contents]
    files: int = 1


def _read_camera_info(name: str, document: _Member) -> Contents:
    return with_mounts(read_camera_info(name, document), document)


def _read_named(name: str, document: _Member) -> Contents:
    cameras, notes = named_cameras(name, document)
    contents = with_mounts(Contents(cameras, notes=notes), document)
    if contents.cameras:
        return contents
    what = " ".join([f"{name} has no camera matrix and no mount under a name that is read.", *contents.notes])
    raise refused(f"{what} {listed(document)}", f"{AS_MOUNT} {AS_CAMERA_INFO}" if contents.notes else AS_CAMERA_INFO)


def _has(*names: str) -> Callable[[_Member], bool]:
    return lambda document: any(not set(names).isdisjoint(block) for _, block in blocks(document))


# The first that fits.
_KINDS: Final[Mapping[ImportFormat, _Kind]] = {
    "direct_visual": _Kind(is_direct_visual, read_direct_visual),
    "sensors_calibration": _Kind(is_sensors_calibration, read_sensors_calibration, files=4),
    "kalibr": _Kind(is_kalibr, read_kalibr),
    "opencv_stereo": _Kind(is_opencv_stereo, read_opencv_stereo, files=2),
    "camera_info": _Kind(is_camera_info, _read_camera_info),
    "euroc": _Kind(_has("T_BS"), _read_named),
    "fast_livo2": _Kind(_has("cam_model", "Rcl"), _read_named),
    "camodocal": _Kind(_has("model_type"), _read_named),
    "orb_slam": _Kind(_has("Camera", "Camera1"), _read_named),
    "opencv": _Kind(lambda document: True, _read_named),
}


class Read(NamedTuple):
    """The contents of files, and their format."""

    format: ImportFormat
    contents: Contents


def read_files(sent: CalibrationFiles) -> Read:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    of_kitti = {name: text for name, text in sent.files.items() if sent.format == "kitti" or is_kitti(text)}
    if of_kitti:
        of_kitti |= {name: text for name, text in sent.files.items() if bare_matrix(text)}
    reads = {" and ".join(of_kitti): Read("kitti", read_kitti(of_kitti))} if of_kitti else {}
    of_nuscenes = {name: text for name, text in sent.files.items() if is_nuscenes(text)}
    if of_nuscenes:
        reads[" and ".join(of_nuscenes)] = Read("nuscenes", read_nuscenes(of_nuscenes))
    documents: dict[str, _Member] = {}
    for name, text in sent.files.items():
        if name in of_kitti or name in of_nuscenes:
            continue
        if is_ost(text):
            reads[name] = Read("camera_info", read_ost(name, text))
        elif numbers := bare_matrix(text):
            documents[name] = {PurePath(name).stem: numbers}
        else:
            document = read_yaml(name, text)
            documents[name] = {PurePath(name).stem: document} if is_pose(document) else document
    together: dict[str, Any] = {}
    for document in documents.values():
        together |= document
    if len(documents) > 1 and any(kind.files > 1 and kind.fits(together) for kind in _KINDS.values()):
        documents = {" and ".join(documents): together}
    reads |= {name: _read(name, document, sent.format) for name, document in documents.items()}
    return _joined(reads)


def _read(name: str, document: _Member, stated: ImportFormat | None) -> Read:
    fitting: list[ImportFormat] = [format for format, kind in _KINDS.items() if kind.fits(document)]
    if stated is not None and stated not in fitting:
        raise refused(f"{name} does not look like {stated}.", f"Leave the format out. {listed(document)}")
    format = stated or fitting[0]
    return Read(format, _KINDS[format].read(name, document))


def _joined(reads: Mapping[str, Read]) -> Read:
    """Join the contents of several files: one has the lens, another the mount."""
    lenses = [name for name, read in reads.items() if any(camera.lens for camera in read.contents.cameras)]
    name = lenses[0] if lenses else next(iter(reads))
    format, contents = reads[name]
    notes = [note for read in reads.values() for note in read.contents.notes]
    if len(reads) == 1:
        if not lenses:
            notes.append(f"{name} holds a mount and no lens: send the file with the camera's lens together with it.")
        return Read(format, replace(contents, notes=notes))
    mounts = [camera for other, read in reads.items() if other != name for camera in read.contents.cameras]
    cameras = contents.cameras
    if len(lenses) != 1 or not len(cameras) == len(mounts) == 1 or cameras[0].T_camera_lidar is not None:
        raise refused(
            f"{' and '.join(reads)} are not one camera's lens and its mount.",
            "Send the files of one calibration: one with the lens of one camera, and one with its mount.",
        )
    return Read(
        format, replace(contents, cameras=[replace(cameras[0], T_camera_lidar=mounts[0].T_camera_lidar)], notes=notes)
    )


def files_view(sent: CalibrationFiles, *, needs_size: bool = True) -> ReadFiles:
    """Show the contents of files. A lens without an image size has 0 x 0 pixels where ``needs_size`` is false.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    kind, content = read_files(sent)
    return ReadFiles(
        format=kind,
        cameras=[_camera(camera, sent.image_size or (None if needs_size else (0, 0))) for camera in content.cameras],
        camera_transforms=[transform_view(transform) for transform in content.camera_transforms],
        notes=content.notes,
    )


def transform_view(T: SE3) -> SolvedTransform:
    """Return a transform in every form of its rotation."""
    return SolvedTransform.model_validate(to_document(T))


def _camera(camera: FileCamera, size: tuple[int, int] | None) -> ReadCamera:
    doubts: list[str] = []
    lens = mount = None
    if camera.lens is not None:
        read = known_lens(camera.name, camera.lens, camera.lens.size if size == (0, 0) and camera.lens.size else size)
        doubts += lens_doubts(read) if read.width else []
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
