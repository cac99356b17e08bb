"""Calibrations that other programs wrote."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID

from apexcal.documents.imports import ImportFormat, ReadFiles, StatedComparison
from apexcal.transport import Resource, at


class Imports(Resource):
    """``client.imports``: what files of other programs hold. The service stores nothing of it."""

    def read(
        self, files: Mapping[str, str], format: ImportFormat | None = None, image_size: Sequence[int] | None = None
    ) -> ReadFiles:
        """Lenses and mounts in files (texts by name) of ROS, OpenCV, Kalibr or KITTI."""
        return self._http.post("/calibration-files/reading", ReadFiles, _files(files, format, image_size))

    def compare(
        self,
        result_id: UUID | str,
        *,
        T_camera_lidar: Mapping[str, Any] | None = None,
        files: Mapping[str, str] | None = None,
        camera: str | None = None,
        image_size: Sequence[int] | None = None,
    ) -> StatedComparison:
        """How far a result is from a stated mount, or from that of ``camera`` in files."""
        body = {
            "T_camera_lidar": T_camera_lidar,
            "files": None if files is None else _files(files, None, image_size),
            "camera": camera,
        }
        return self._http.post(at("results", result_id, "comparison"), StatedComparison, body)


def _files(files: Mapping[str, str], format: ImportFormat | None, image_size: Sequence[int] | None) -> dict[str, Any]:
    return {"files": dict(files), "format": format, "image_size": image_size and list(image_size)}
