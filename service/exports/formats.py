"""The table of all formats, and an export as the bytes of one file: a format of several files is a ZIP."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from service.exports import (
    autoware,
    camera_info,
    direct_visual,
    fast_livo2,
    kalibr,
    kitti,
    nuscenes,
    opencv,
    openlabel,
    ros2,
    urdf,
)
from service.exports.calibrated import Calibrated, CalibratedCamera, file_name
from service.exports.format import Files, Format, carried, lacking, obstacle
from service.platform.http.problems import Problem, unprocessable

FORMATS: dict[str, Format] = {
    format.name: format
    for format in (
        *(module.FORMAT for module in (camera_info, ros2, urdf, autoware, kitti)),
        kitti.OBJECT,
        *(module.FORMAT for module in (kalibr, opencv, fast_livo2, direct_visual, nuscenes, openlabel)),
        openlabel.VCD,
    )
}
# What ZIP writes where it knows no time: the same export has the same bytes.
_NO_TIME = (1980, 1, 1, 0, 0, 0)


class Exported(NamedTuple):
    """One file to hand out; ``notes`` say what its reader has to know beside it."""

    name: str
    media_type: str
    content: bytes
    notes: Sequence[str] = ()


def media_type(target: Format, kind: str) -> str:
    """The type of a format's one file, or of the ZIP of its files."""
    return f"application/vnd.apexcal.{target.name}+{kind}"


def find_format(name: str) -> Format:
    """Raises :class:`Problem` 422 ``unknown_format``."""
    if name not in FORMATS:
        names = ["json", *FORMATS]
        raise unprocessable(
            "unknown_format", f"There is no format {name!r}.", f"The formats are {', '.join(names)}.", formats=names
        )
    return FORMATS[name]


def export(target: Format, calibrated: Calibrated) -> Exported:
    """Raises :class:`Problem` 406 ``format_cannot_carry``, which names the formats that can."""
    if (refusal := obstacle(target, calibrated)) is not None:
        reason, remedy = refusal
        able = ["json", *(name for name, other in FORMATS.items() if obstacle(other, calibrated) is None)]
        raise Problem(
            406,
            "format_cannot_carry",
            reason,
            f"{remedy} Or take one of {', '.join(able)}.",
            format=target.name,
            formats=able,
        )
    tells_lens = target.mount_apart or not target.carries_lens
    notes = [camera.needs(carries_lens=target.carries_lens) for camera in calibrated.cameras if tells_lens]
    if not target.carries_lens:
        notes += [
            f"{camera.name}, this mount alone: {sentence}"
            for camera in calibrated.cameras
            for sentence in camera.mount_checks
        ]
        calibrated = calibrated.alone()
    pairs = [(camera, carried(target, camera)) for camera in calibrated.cameras]
    notes += [f"{lacking(target, camera)}: {less.sentence}." for camera, less in pairs if less]
    cameras = [less.camera if less else camera for camera, less in pairs]
    beside: Files = {}
    if target.of_undistorted:
        distorted = [camera for camera in cameras if camera.lens != "pinhole"]
        beside = opencv.FORMAT.write(replace(calibrated, cameras=distorted))
        notes += [_to_undistort(target, camera) for camera in distorted]
        cameras = [camera.undistorted() for camera in cameras]
    files = target.write(replace(calibrated, cameras=cameras))
    files |= {f"undistort/{name}": text for name, text in beside.items()}
    name = "-".join([*(file_name(part) for part in _named(calibrated)), target.name])
    if len(files) == 1 and target.kind != "zip":
        (inside, text), *_ = files.items()
        suffix = inside.partition(".")[2]
        return Exported(f"{name}.{suffix}", media_type(target, target.kind), text.encode(), notes)
    return Exported(f"{name}.zip", media_type(target, "zip"), _zipped(files), notes)


def _to_undistort(target: Format, camera: CalibratedCamera) -> str:
    call = (
        "cv2.fisheye.undistortImage(image, K, D, Knew=K)"
        if camera.written_as.is_cv2_fisheye
        else "cv2.undistort(image, K, D)"
    )
    return (
        f"{camera.name}: {target.title} is about undistorted images. Undistort them by {call}; "
        f"K and D are in undistort/{file_name(camera.name)}.yaml."
    )


def _named(calibrated: Calibrated) -> list[str]:
    names = [calibrated.vehicle]
    return names if len(calibrated.cameras) > 1 else [*names, calibrated.cameras[0].name]


def _zipped(files: Files) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(name, _NO_TIME), text, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
