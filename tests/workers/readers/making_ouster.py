"""Packets of Ouster sensors and their metadata, made for tests byte by byte as the manual prints them."""

import json
import struct

import numpy as np

START_NS = 1_700_000_000_000_000_000
SERIAL = 122_150_000_150
COLUMNS, IN_PACKET, TURN_NS = 512, 16, 100_000_000
COLUMN_NS = TURN_NS // COLUMNS
ARM_MM, HEIGHT_MM = 15.8, 36.2
# Profile: (bytes of a pixel, millimetres of a count of range, byte of the reflectivity)
PROFILES = {
    "LEGACY": (12, 1, 4),
    "RNG15_RFL8_NIR8": (4, 8, 2),
    "RNG19_RFL8_SIG16_NIR16": (12, 1, 4),
    "RNG19_RFL8_SIG16_NIR16_DUAL": (16, 1, 3),
    "FUSA_RNG15_RFL8_NIR8_DUAL": (8, 8, 2),
}


def altitudes(rows):
    return np.linspace(20.0, -20.0, rows)


def azimuths(rows):
    return np.tile([3.0, 1.0, -1.0, -3.0], rows // 4)


def metadata(profile="RNG19_RFL8_SIG16_NIR16", rows=32, *, nested=True, **other):
    layout = {
        "pixels_per_column": rows,
        "columns_per_packet": IN_PACKET,
        "columns_per_frame": COLUMNS,
        "udp_profile_lidar": profile,
        "header_type": "FUSA" if profile.startswith("FUSA") else "STANDARD",
    }
    beams = {
        "beam_altitude_angles": altitudes(rows).tolist(),
        "beam_azimuth_angles": azimuths(rows).tolist(),
        "lidar_origin_to_beam_origin_mm": ARM_MM,
    }
    frame = {"lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, HEIGHT_MM, 0, 0, 0, 1]}
    names = {"prod_line": "OS-1-32", "prod_sn": str(SERIAL)}
    if nested:
        document = {"beam_intrinsics": beams, "lidar_data_format": layout, "lidar_intrinsics": frame}
        return json.dumps(document | {"sensor_info": names} | other).encode()
    return json.dumps({**beams, "data_format": layout, **frame, **names, **other}).encode()


def packets(profile="RNG19_RFL8_SIG16_NIR16", turns=2.5, rows=32, *, range_mm=8000, first_frame=65_535):
    """(moment of the first column in ns, payload) of a sensor that sees the same distance everywhere.

    The reflectivity is the row; a second return, where there is one, stands a metre nearer.
    """
    size, unit, reflectivity = PROFILES[profile]
    for start in range(0, int(turns * COLUMNS), IN_PACKET):
        frame = (first_frame + start // COLUMNS) % 65_536
        body = bytearray()
        for column in range(start, start + IN_PACKET):
            at = 5_000_000_000 + column * COLUMN_NS
            pixels = bytearray()
            for row in range(rows):
                pixel = bytearray(size)
                struct.pack_into("<I" if unit == 1 else "<H", pixel, 0, range_mm // unit)
                pixel[reflectivity] = row
                if "DUAL" in profile:
                    struct.pack_into("<H", pixel, 4, (range_mm - 1000) // unit)
                pixels += pixel
            if profile == "LEGACY":
                head = struct.pack("<QHHI", at, column % COLUMNS, frame, 0)
                body += head + pixels + struct.pack("<I", 0xFFFFFFFF)
            else:
                body += struct.pack("<QHH", at, column % COLUMNS, 1) + pixels
        if profile.startswith("FUSA"):
            body = struct.pack("<B3xI3x", 1, frame) + SERIAL.to_bytes(5, "little") + bytes(16) + body + bytes(32)
        elif profile != "LEGACY":
            body = struct.pack("<HH3x", 1, frame) + SERIAL.to_bytes(5, "little") + bytes(20) + body + bytes(32)
        yield START_NS + start * COLUMN_NS, bytes(body)
