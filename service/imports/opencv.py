"""OpenCV's two files of stereo_calib. Its other files are read by their names (``named_lens``)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.imports.contents import Contents, matrix, transform
from service.imports.named_lens import named_cameras


def is_opencv_stereo(document: Mapping[str, Any]) -> bool:
    """Whether it has the matrices of two cameras as OpenCV's stereo_calib names them."""
    return {"M1", "M2"} <= set(document)


def read_opencv_stereo(name: str, document: Mapping[str, Any]) -> Contents:
    """``intrinsics.yml`` (M1, D1, M2, D2), with ``extrinsics.yml`` (R, T: camera 1 into 2) or alone; without a size.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    pair = {number: {"K": document[f"M{number}"], "D": document.get(f"D{number}")} for number in "12"}
    cameras, notes = named_cameras(name, pair)
    if not {"R", "T"} <= set(document):
        return Contents(cameras, notes=notes)
    R = matrix(f"R of {name}", document["R"], 3, 3)
    return Contents(cameras, [transform("2", "1", R, matrix(f"T of {name}", document["T"], 3))], notes)
