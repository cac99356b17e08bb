"""The table of all formats, and an export as the bytes of one file: a format of several files is a ZIP."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from service.exports import autoware, camera_info, kalibr, kitti, nuscenes, opencv, openlabel, ros2, urdf
from service.exports.calibrated import Calibrated, file_name
from service.exports.format import Files, Format, carried, lacking, obstacle
from service.platform.http.problems import Problem

FORMATS: dict[str, Format] = {
    one.name: one
    for one in (
        *(one.FORMAT for one in (camera_info, ros2, urdf, autoware, kitti, kalibr, opencv, nuscenes, openlabel)),
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


def media_type(wanted: Format, kind: str) -> str:
    """The type of a format's one file, or of the ZIP of its files."""
    return f"application/vnd.apexcal.{wanted.name}+{kind}"


def find_format(name: str) -> Format:
    """Raises :class:`Problem` 422 ``unknown_format``."""
    if name not in FORMATS:
        known = ["json", *FORMATS]
        raise Problem(
            422,
            "unknown_format",
            f"There is no format {name!r}.",
            f"The formats are {', '.join(known)}.",
            formats=known,
        )
    return FORMATS[name]


def export(wanted: Format, calibrated: Calibrated) -> Exported:
    """Raises :class:`Problem` 406 ``format_cannot_carry``, which names the formats that can."""
    if (found := obstacle(wanted, calibrated)) is not None:
        reason, remedy = found
        able = ["json", *(name for name, one in FORMATS.items() if obstacle(one, calibrated) is None)]
        raise Problem(
            406,
            "format_cannot_carry",
            reason,
            f"{remedy} Or take one of {', '.join(able)}.",
            format=wanted.name,
            formats=able,
        )
    tells_lens = wanted.mount_apart or not wanted.carries_lens
    notes = [one.needs(carries_lens=wanted.carries_lens) for one in calibrated.cameras if tells_lens]
    if not wanted.carries_lens:
        notes += [
            f"{one.name}, this mount alone: {sentence}" for one in calibrated.cameras for sentence in one.mount_checks
        ]
        calibrated = calibrated.alone()
    pairs = [(camera, carried(wanted, camera)) for camera in calibrated.cameras]
    notes += [f"{lacking(wanted, camera)}: {less.sentence}." for camera, less in pairs if less]
    files = wanted.write(replace(calibrated, cameras=[less.camera if less else camera for camera, less in pairs]))
    name = "-".join([*(file_name(part) for part in _named(calibrated)), wanted.name])
    if len(files) == 1 and wanted.kind != "zip":
        (inside, text), *_ = files.items()
        suffix = inside.partition(".")[2]
        return Exported(f"{name}.{suffix}", media_type(wanted, wanted.kind), text.encode(), notes)
    return Exported(f"{name}.zip", media_type(wanted, "zip"), _zipped(files), notes)


def _named(calibrated: Calibrated) -> list[str]:
    names = [calibrated.vehicle]
    return names if len(calibrated.cameras) > 1 else [*names, calibrated.cameras[0].name]


def _zipped(files: Files) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(name, _NO_TIME), text, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
