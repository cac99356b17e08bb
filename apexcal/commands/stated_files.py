"""Calibration files of other programs as options name them, read by the service."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from apexcal.client import Client, InputError
from apexcal.documents.imports import ReadCamera, ReadFiles
from apexcal.transport import Document

# What the service takes of one file.
_LARGEST_BYTES = 60_000
_OF_LENSES = re.compile(r"(camera|calib|intrin|camchain|lens).*\.(ya?ml|json|txt)$", re.IGNORECASE)
_MOST_FILES = 8


def read_texts(paths: Sequence[Path]) -> dict[str, str]:
    """Files as texts, by name. Raises :class:`InputError` for what cannot be read."""
    for path in paths:
        if path.is_file() and path.stat().st_size > _LARGEST_BYTES:
            raise InputError(
                f"{path} is too large for a calibration file",
                f"Leave in it what is of one camera and the LiDAR: at most {_LARGEST_BYTES} bytes.",
            )
    return {path.name: read_text(path) for path in paths}


def read_text(path: Path) -> str:
    """A file as text. Raises :class:`InputError` for what cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot read {path}: {(error.strerror or '').lower()}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is no text") from None


def lens_files(path: Path) -> list[Path]:
    """Files in a recording's folder, or beside its file, whose names say that they may state a lens."""
    files = [*path.iterdir(), *path.glob("*/*")] if path.is_dir() else path.absolute().parent.iterdir()
    return sorted(file for file in files if _OF_LENSES.search(file.name) and file.is_file())[:_MOST_FILES]


def read_lens(
    client: Client, file: str, camera: str, image_size: tuple[int, int] | None = None, *, is_named: bool = False
) -> Document:
    """A camera's lens as ``intrinsics`` of a calibration takes it. ``FILE#NAME`` names a camera of the file.

    ``is_named``: whether the file has to name the camera. Raises :class:`InputError`, :class:`ApiError`
    ``calibration_file_not_read``.
    """
    path, name = _named(file)
    read = client.imports.read(read_texts([path]), image_size=image_size)
    lens = _camera_of(read, path, name or camera, is_named=is_named or bool(name)).lens
    if lens is None:
        raise InputError(f"{path} holds no lens")
    return lens.model_dump(include={"width", "height", "distortion_model", "K", "D"})


def _named(file: str) -> tuple[Path, str]:
    path, _, name = file.rpartition("#")
    return (Path(path), name) if path and not Path(file).exists() else (Path(file), "")


def _camera_of(files: ReadFiles, path: Path, camera: str, *, is_named: bool) -> ReadCamera:
    """The camera of this name, else of this topic, else the only one."""
    cameras = files.cameras
    matching = [each for each in cameras if camera == each.name or camera in (each.topic or "").split("/")]
    if not matching and len(cameras) == 1 and not is_named:
        return cameras[0]
    if len(matching) != 1:
        listed = ", ".join(each.name for each in cameras)
        raise InputError(
            f"{path} has the cameras {listed}, and none of them is clearly {camera}",
            f"Name one of them: {path}#{cameras[0].name}",
        )
    return matching[0]
