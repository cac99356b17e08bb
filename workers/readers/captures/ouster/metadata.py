"""The metadata of an Ouster sensor: the document beside a capture, or on its driver's ``metadata`` topic."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import ReadError

_MARK: Final = b"beam_altitude_angles"
METADATA_BYTES: Final = 1_000_000
_MOST_ROWS, _MOST_COLUMNS, _MOST_IN_PACKET = 256, 4096, 64


@dataclass(frozen=True, slots=True)
class PixelLayout:
    """The layout of a pixel in a packet.

    Attributes:
        size: bytes of a pixel.
        range_bits: of the range, which begins the pixel.
        unit_mm: what one count of the range is.
        reflectivity: the byte that holds it.
    """

    size: int
    range_bits: int
    unit_mm: int
    reflectivity: int


# Ouster firmware user manual, "UDP data profiles"; of two returns the first is the stronger one.
_RANGE_15: Final = PixelLayout(4, 15, 8, 2)
_RANGE_15_TWO: Final = PixelLayout(8, 15, 8, 2)
_RANGE_19: Final = PixelLayout(12, 19, 1, 4)
_RANGE_19_TWO: Final = PixelLayout(16, 19, 1, 3)
LEGACY: Final = "LEGACY"
LAYOUTS: Final[Mapping[str, PixelLayout]] = {
    LEGACY: PixelLayout(12, 20, 1, 4),
    "RNG15_RFL8_NIR8": _RANGE_15,
    "RNG15_RFL8_WIN8": _RANGE_15,
    "RNG15_RFL8_NIR8_DUAL": _RANGE_15_TWO,
    "RNG15_RFL8_NIR8_ZONE16": _RANGE_15_TWO,
    "FUSA_RNG15_RFL8_NIR8_DUAL": _RANGE_15_TWO,
    "RNG19_RFL8_SIG16_NIR16": _RANGE_19,
    "RNG19_RFL8_SIG16_NIR16_ZONE16": _RANGE_19,
    "RNG19_RFL8_SIG16_NIR16_DUAL": _RANGE_19_TWO,
    "RNG19_RFL8_SIG16_ZONE16_DUAL": _RANGE_19_TWO,
}


@dataclass(frozen=True, slots=True)
class OusterSensor:
    """An Ouster sensor and the layout of its packets.

    Attributes:
        title: the product, for example ``OS-1-64``.
        serial: of the sensor; 0 where the document does not say it.
        columns: of a turn.
        packet: dtype of a whole packet: ``columns`` with ``t`` (nanoseconds), ``number``, ``valid`` and ``pixels``.
        frame_at: byte of a packet at which the frame's number stands, 16 bits.
        serial_at: byte at which its serial number stands, 40 bits; None where packets hold none.
        pixel: layout of a pixel.
        ring: (H,) uint16 of each row, 0 the lowest beam.
        direction: (H, columns, 3) float32, metres of a point in the sensor's frame per millimetre of range.
        origin: (H, columns, 3) float32, metres, where that line begins.
    """

    title: str
    serial: int
    columns: int
    packet: np.dtype[np.void]
    frame_at: int
    serial_at: int | None
    pixel: PixelLayout
    ring: NDArray[np.uint16]
    direction: NDArray[np.float32]
    origin: NDArray[np.float32]


def is_ouster_metadata(data: bytes) -> bool:
    """Whether a file is what an Ouster sensor says of itself."""
    return data.lstrip()[:1] == b"{" and _MARK in data


def read_metadata(data: bytes, where: str) -> OusterSensor:
    """Read the document, as firmware 2.0 and newer write it, flat or nested.

    Raises:
        ReadError: ``lidar_metadata_unusable``.
    """
    try:
        document = _flat(json.loads(data))
        layout = cast(dict[str, Any], document.get("lidar_data_format") or document["data_format"])
        profile = str(layout.get("udp_profile_lidar", LEGACY))
        if profile not in LAYOUTS:
            raise _unusable(where, f"packets of the profile {profile} are not read")
        rows, columns = int(layout["pixels_per_column"]), int(layout["columns_per_frame"])
        in_packet = int(layout["columns_per_packet"])
        angles = [np.radians(_numbers(document[f"beam_{kind}_angles"], rows)) for kind in ("altitude", "azimuth")]
        arm = document.get("lidar_origin_to_beam_origin_mm")
        arm_mm = float(document["beam_to_lidar_transform"][3] if arm is None else arm)
        if not abs(arm_mm) < 1000.0:
            raise ValueError("a beam that leaves the sensor inside of it is expected")
        T_sensor_lidar = _numbers(document["lidar_to_sensor_transform"], 16).reshape(4, 4)
        serial = str(document.get("prod_sn", ""))
    except (ValueError, KeyError, IndexError, TypeError, RecursionError) as error:
        raise _unusable(where, f"{type(error).__name__} at {str(error)[:80]}") from error
    if not (0 < rows <= _MOST_ROWS and 0 < in_packet <= _MOST_IN_PACKET and in_packet <= columns <= _MOST_COLUMNS):
        raise _unusable(where, f"it claims {rows} x {columns} pixels, {in_packet} columns a packet")
    packet, frame_at, serial_at = _packet(profile, rows, in_packet, fusa=layout.get("header_type") == "FUSA")
    direction, origin = _rays(angles[0], angles[1], columns, arm_mm, T_sensor_lidar)
    return OusterSensor(
        title=str(document.get("prod_line", "Ouster"))[:60],
        serial=int(serial) if serial.isdecimal() and len(serial) < 16 else 0,
        columns=columns,
        packet=packet,
        frame_at=frame_at,
        serial_at=serial_at,
        pixel=LAYOUTS[profile],
        ring=np.argsort(np.argsort(angles[0], kind="stable"), kind="stable").astype(np.uint16),
        direction=direction,
        origin=origin,
    )


def _unusable(where: str, why: str) -> ReadError:
    return ReadError(
        "lidar_metadata_unusable",
        f"{where}: the Ouster sensor's metadata cannot be used ({why}).",
        "Take the sensor's metadata anew (`ouster-cli source SENSOR metadata`), or record its driver's points.",
    )


def _flat(document: Any) -> dict[str, Any]:
    """The document without the groups in which newer firmware puts what older had side by side."""
    if not isinstance(document, dict):
        raise TypeError("no object")
    flat: dict[str, Any] = {}
    for group in cast(dict[str, Any], document).values():
        if isinstance(group, dict):
            flat |= cast(dict[str, Any], group)
    return flat | cast(dict[str, Any], document)


def _numbers(values: Sequence[float], count: int) -> NDArray[np.float64]:
    numbers = np.array(values, float)
    if numbers.shape != (count,) or not np.isfinite(numbers).all() or np.abs(numbers).max() > 1e5:
        raise ValueError(f"{count} numbers are expected")
    return numbers


def _packet(profile: str, rows: int, in_packet: int, *, fusa: bool) -> tuple[np.dtype[np.void], int, int | None]:
    """(dtype of a packet, byte of the frame's number, byte of the serial number)."""
    size = LAYOUTS[profile].size
    pixels = ("pixels", "u1", (rows, size))
    if profile == LEGACY:  # no head of the packet; a column's frame stands in it, and its status after its pixels
        head = [("t", "<u8"), ("number", "<u2"), ("frame", "<u2"), ("encoder", "<u4")]
        return np.dtype([("columns", np.dtype([*head, pixels, ("valid", "<u4")]), (in_packet,))]), 10, None
    column = np.dtype([("t", "<u8"), ("number", "<u2"), ("valid", "<u2"), pixels])
    packet = np.dtype([("head", "V32"), ("columns", column, (in_packet,)), ("foot", "V32")])
    return packet, 4 if fusa else 2, 11 if fusa else 7


def _rays(
    altitude: NDArray[np.float64],
    azimuth: NDArray[np.float64],
    columns: int,
    arm_mm: float,
    T_sensor_lidar: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Direction and origin of every pixel's ray (firmware user manual, "Lidar range to XYZ").

    Args:
        altitude, azimuth: (H,) radians, of the beams.
        columns: W, of a turn.
        arm_mm: from the axis to where the beams leave.
        T_sensor_lidar: (4, 4), millimetres.

    Returns:
        (H, W, 3) float32 each; see :class:`OusterSensor`.
    """
    encoder = 2.0 * np.pi * (1.0 - np.arange(columns) / columns)
    turned = encoder - azimuth[:, None]
    up = np.broadcast_to(np.sin(altitude)[:, None], turned.shape)
    unit = np.stack([np.cos(turned), np.sin(turned), up], -1)
    unit[..., :2] *= np.cos(altitude)[:, None, None]
    arm = np.stack([np.cos(encoder), np.sin(encoder), np.zeros(columns)], -1) * arm_mm
    R, t = T_sensor_lidar[:3, :3], T_sensor_lidar[:3, 3]
    direction = unit @ R.T / 1000.0
    origin = ((arm - unit * arm_mm) @ R.T + t) / 1000.0
    return direction.astype(np.float32), origin.astype(np.float32)
