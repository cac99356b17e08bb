"""What files hold, as answers show it."""

from __future__ import annotations

from apexcal.documents.imports import CalibrationFiles, ReadCamera, ReadFiles, ReadLens
from apexcal.documents.transforms import SolvedTransform
from apexcal.geometry.se3 import SE3, to_document
from service.imports.formats import read_files
from service.imports.found import FoundCamera
from service.imports.plausibility import known_lens, lens_doubts, mount_doubts


def files_view(sent: CalibrationFiles) -> ReadFiles:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    kind, found = read_files(sent)
    return ReadFiles(
        format=kind,
        cameras=[_camera(camera, sent.image_size) for camera in found.cameras],
        camera_transforms=[transform_view(one) for one in found.camera_transforms],
        notes=found.notes,
    )


def transform_view(T: SE3) -> SolvedTransform:
    """A transform in every form of its rotation."""
    return SolvedTransform.model_validate(to_document(T))


def _camera(camera: FoundCamera, size: tuple[int, int] | None) -> ReadCamera:
    doubts: list[str] = []
    lens = mount = None
    if camera.lens is not None:
        known = known_lens(camera.name, camera.lens, size)
        doubts += lens_doubts(known)
        lens = ReadLens(
            width=known.width,
            height=known.height,
            distortion_model=camera.lens.distortion_model,
            K=known.K,
            D=known.D,
            model=known.model,
        )
    if camera.T_camera_lidar is not None:
        doubts += mount_doubts(camera.T_camera_lidar)
        mount = transform_view(camera.T_camera_lidar)
    return ReadCamera(name=camera.name, topic=camera.topic, lens=lens, T_camera_lidar=mount, doubts=doubts)
