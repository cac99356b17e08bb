"""KITTI: ``calib_cam_to_cam.txt`` with ``calib_velo_to_cam.txt`` (raw), or ``calib.txt`` (object, odometry).

The raw files hold each camera twice: as recorded (``00``: K, D) and rectified (``rect_00``: P_rect, without
distortion). The images that KITTI calls synced are rectified.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from apexcal.geometry.se3 import SE3, Floats
from service.imports.found import (
    LIDAR,
    Found,
    FoundCamera,
    Lens,
    camera_matrix,
    image_size,
    numbers,
    refused,
    transform,
)

Members = Mapping[str, list[float]]
_LINE = re.compile(r"([A-Za-z0-9_]+):?[ \t]+([-+0-9.eE][-+0-9.eE \t]*)")
_RAW, _PLAIN = re.compile(r"K_(\d\d)"), re.compile(r"P(\d)")
_FIRST = "00"


def is_kitti(text: str) -> bool:
    """Whether a line holds a matrix as KITTI writes it: a name, then its numbers with blanks between."""
    return any(
        found and found[1].partition("_")[0] in ("R", "P", "P0", "K", "Tr") and len(found[2].split()) in (9, 12)
        for found in map(_LINE.fullmatch, map(str.strip, text.splitlines()))
    )


def read_kitti(files: Mapping[str, str]) -> Found:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    members: dict[str, list[float]] = {}
    for name, text in files.items():
        for line in text.splitlines():
            found = _LINE.fullmatch(line.strip())
            if found:
                members[found[1]] = numbers(f"{found[1]} of {name}", found[2].split())
    raw = [one[1] for one in map(_RAW.fullmatch, members) if one]
    plain = [one[1] for one in map(_PLAIN.fullmatch, members) if one]
    if raw:
        return _raw(members, raw)
    if plain:
        return _plain(members, plain)
    raise refused(
        f"{' and '.join(files)} holds no camera: there is neither K_00 nor P0.",
        "Send calib_cam_to_cam.txt together with calib_velo_to_cam.txt, or calib.txt.",
    )


def _raw(members: Members, places: list[str]) -> Found:
    notes: list[str] = []
    if not {"R", "T"} <= set(members):
        notes.append("calib_velo_to_cam.txt is not among the files: no mount on the LiDAR is known.")
    cameras: list[FoundCamera] = []
    for place in places:
        lens = Lens(
            "plumb_bob", _of(members, f"K_{place}", 9), _of(members, f"D_{place}", 5), _size(members, "S", place)
        )
        cameras.append(FoundCamera(place, lens=lens, T_camera_lidar=_mount(members, place)))
    for place in places:
        rectified = _rectified(members, place) if f"P_rect_{place}" in members else None
        if rectified is not None:
            cameras.append(rectified)
    return Found(cameras, notes=notes)


def _mount(members: Members, place: str) -> SE3 | None:
    """T_camera_lidar of a camera as recorded: R_xx, T_xx map camera 00 into it, R, T the LiDAR into camera 00."""
    if not {"R", "T"} <= set(members):
        return None
    first = transform(_FIRST, LIDAR, _of_matrix(members, "R", (3, 3)), _of_matrix(members, "T", (3,)))
    if place == _FIRST and f"R_{place}" not in members:
        return first
    R, t = _of_matrix(members, f"R_{place}", (3, 3)), _of_matrix(members, f"T_{place}", (3,))
    return transform(place, _FIRST, R, t) @ first


def _rectified(members: Members, place: str) -> FoundCamera | None:
    """A camera as rectified; None where P_rect is no camera matrix beside an offset (files of our own export)."""
    P = _of_matrix(members, f"P_rect_{place}", (3, 4))
    lens = _projection_lens(P, _size(members, "S_rect", place))
    if lens is None:
        return None
    name, mount = f"rect_{place}", None
    if {"R", "T", f"R_rect_{_FIRST}"} <= set(members):
        first = transform(_FIRST, LIDAR, _of_matrix(members, "R", (3, 3)), _of_matrix(members, "T", (3,)))
        mount = transform(name, _FIRST, _of_matrix(members, f"R_rect_{_FIRST}", (3, 3)), _offset(P)) @ first
    return FoundCamera(name, lens=lens, T_camera_lidar=mount)


def _plain(members: Members, places: list[str]) -> Found:
    """Object (``R0_rect``, ``Tr_velo_to_cam``) and odometry (``Tr``, which leads into the rectified camera)."""
    name = next((one for one in ("Tr_velo_to_cam", "Tr_velo_cam", "Tr") if one in members), None)
    Tr = None if name is None else _of_matrix(members, name, (3, 4))
    turn = next((one for one in ("R0_rect", "R_rect") if one in members), None)
    R_rect = np.eye(3) if turn is None else _of_matrix(members, turn, (3, 3))
    cameras: list[FoundCamera] = []
    for place in places:
        P = _of_matrix(members, f"P{place}", (3, 4))
        mount = None
        if Tr is not None:
            first = transform(_FIRST, LIDAR, Tr[:, :3], Tr[:, 3])
            mount = transform(f"P{place}", _FIRST, R_rect, _offset(P)) @ first
        cameras.append(FoundCamera(f"P{place}", lens=_projection_lens(P, None), T_camera_lidar=mount))
    notes = [] if Tr is not None else ["There is no Tr_velo_to_cam and no Tr: no mount on the LiDAR is known."]
    return Found(cameras, notes=notes)


def _projection_lens(P: Floats, size: tuple[int, int] | None) -> Lens | None:
    K = P[:, :3]
    if abs(K[0, 1]) + abs(K[1, 0]) + abs(K[2, 0]) + abs(K[2, 1]) > 0.0 or K[2, 2] != 1.0:
        return None
    return Lens("plumb_bob", camera_matrix(K[0, 0], K[1, 1], K[0, 2], K[1, 2]), [], size)


def _offset(P: Floats) -> Floats:
    """t of P = K [I | t]: where rectified camera 00 lies in this one."""
    try:
        return np.linalg.solve(P[:, :3], P[:, 3]).astype(np.float64)
    except np.linalg.LinAlgError:
        raise refused("A P has no focal length.", "Send KITTI's files as they are.") from None


def _size(members: Members, kind: str, place: str) -> tuple[int, int] | None:
    size = members.get(f"{kind}_{place}")
    return None if size is None or len(size) != 2 else image_size(f"The images of {place}", *map(round, size))


def _of(members: Members, name: str, count: int) -> list[float]:
    if name not in members:
        raise refused(f"There is no {name}.", "Send KITTI's files as they are.")
    return numbers(name, members[name], count)


def _of_matrix(members: Members, name: str, shape: tuple[int, ...]) -> Floats:
    return np.array(_of(members, name, int(np.prod(shape)))).reshape(shape)
