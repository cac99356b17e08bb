"""KITTI: ``calib_cam_to_cam.txt`` with ``calib_velo_to_cam.txt`` (raw), or ``calib.txt`` (object, odometry).

The raw files hold each camera twice: as recorded (``00``: K, D) and rectified (``rect_00``: P_rect, without
distortion). The images that KITTI calls synced are rectified.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from apexcal.geometry.se3 import SE3, Floats
from service.imports.contents import (
    LIDAR,
    Contents,
    FileCamera,
    FileLens,
    camera_matrix,
    image_size,
    matrix,
    numbers,
    refused,
    transform,
)
from service.imports.members import scalar
from service.imports.mounts import is_of_vehicle, sends_into_camera

Members = Mapping[str, list[float]]
_LINE = re.compile(r"([A-Za-z0-9_]+):?[ \t]+([-+0-9.eE][-+0-9.eE \t]*)")
_RAW, _PLAIN = re.compile(r"K_(\d\d)"), re.compile(r"P(\d)")
_FIRST = "00"


def is_kitti(text: str) -> bool:
    """Whether a line holds a matrix as KITTI writes it: a name, then its numbers with blanks between."""
    return any(
        match
        and match[1].partition("_")[0] in ("R", "P", "P0", "K", "Tr", "image")
        and len(match[2].split()) in (9, 12)
        for match in map(_LINE.fullmatch, map(str.strip, text.splitlines()))
    )


def bare_matrix(text: str) -> list[float] | None:
    """The 12 or 16 numbers of a text that has nothing else, between blanks or commas; None for any other text."""
    parts = text.replace(",", " ").split()
    if len(parts) not in (12, 16):
        return None
    values = [scalar(part) for part in parts]
    return None if None in values else [value for value in values if value is not None]


def read_kitti(files: Mapping[str, str]) -> Contents:
    """Files of KITTI, also of KITTI-360 (``perspective.txt``, and the bare ``calib_cam_to_velo.txt``).

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    members: dict[str, list[float]] = {}
    notes: list[str] = []
    for name, text in files.items():
        own = {
            match[1]: numbers(f"{match[1]} of {name}", match[2].split())
            for match in map(_LINE.fullmatch, map(str.strip, text.splitlines()))
            if match
        }
        values, into_camera = bare_matrix(text), sends_into_camera(PurePath(name).stem)
        if values is not None and into_camera is not None:
            T = matrix(name, values[:12], 3, 4)
            T_camera_lidar = transform(_FIRST, LIDAR, T[:, :3], T[:, 3])
            if not into_camera:
                T_camera_lidar = transform(LIDAR, _FIRST, T[:, :3], T[:, 3]).inverse()
            own = {"R": T_camera_lidar.R.ravel().tolist(), "T": T_camera_lidar.t.tolist()}
        elif values is not None or is_of_vehicle(PurePath(name).stem):
            notes.append(f"{name} is left out: by its name it is not between the LiDAR and a camera.")
            continue
        members |= own
    contents = _contents(files, members)
    return replace(contents, notes=[*notes, *contents.notes])


def _contents(files: Mapping[str, str], members: Members) -> Contents:
    raw = [match[1] for match in map(_RAW.fullmatch, members) if match]
    plain = [match[1] for match in map(_PLAIN.fullmatch, members) if match]
    if raw:
        return _raw(members, raw)
    if plain:
        return _plain(members, plain)
    if {"R", "T"} <= set(members):
        return Contents([FileCamera(_FIRST, T_camera_lidar=_mount(members, _FIRST))])
    raise refused(
        f"{' and '.join(files)} holds no camera: neither K_00 nor P0, but {', '.join(members) or 'nothing'}.",
        "Send calib_cam_to_cam.txt together with calib_velo_to_cam.txt, or calib.txt; of KITTI-360 perspective.txt "
        "together with calib_cam_to_velo.txt.",
    )


def _raw(members: Members, places: list[str]) -> Contents:
    notes: list[str] = []
    if not {"R", "T"} <= set(members):
        notes.append(
            "Neither calib_velo_to_cam.txt nor KITTI-360's calib_cam_to_velo.txt is among the files: no mount on the "
            "LiDAR is known."
        )
    cameras: list[FileCamera] = []
    for camera in places:
        lens = FileLens(
            "plumb_bob", _of(members, f"K_{camera}", 9), _of(members, f"D_{camera}", 5), _size(members, "S", camera)
        )
        cameras.append(FileCamera(camera, lens=lens, T_camera_lidar=_mount(members, camera)))
    for camera in places:
        rectified = _rectified(members, camera) if f"P_rect_{camera}" in members else None
        if rectified is not None:
            cameras.append(rectified)
    return Contents(cameras, notes=notes)


def _mount(members: Members, camera: str) -> SE3 | None:
    """T_camera_lidar of a camera as recorded: R_xx, T_xx map camera 00 into it, R, T the LiDAR into camera 00."""
    if not {"R", "T"} <= set(members):
        return None
    first = transform(_FIRST, LIDAR, _of_matrix(members, "R", (3, 3)), _of_matrix(members, "T", (3,)))
    if camera == _FIRST and f"R_{camera}" not in members:
        return first
    R, t = _of_matrix(members, f"R_{camera}", (3, 3)), _of_matrix(members, f"T_{camera}", (3,))
    return transform(camera, _FIRST, R, t) @ first


def _rectified(members: Members, camera: str) -> FileCamera | None:
    """A camera as rectified; None where P_rect is no camera matrix beside an offset (files of our own export)."""
    P = _of_matrix(members, f"P_rect_{camera}", (3, 4))
    lens = _projection_lens(P, _size(members, "S_rect", camera))
    if lens is None:
        return None
    name, mount = f"rect_{camera}", None
    if {"R", "T", f"R_rect_{_FIRST}"} <= set(members):
        first = transform(_FIRST, LIDAR, _of_matrix(members, "R", (3, 3)), _of_matrix(members, "T", (3,)))
        mount = transform(name, _FIRST, _of_matrix(members, f"R_rect_{_FIRST}", (3, 3)), _offset(P)) @ first
    return FileCamera(name, lens=lens, T_camera_lidar=mount)


def _plain(members: Members, places: list[str]) -> Contents:
    """Object (``R0_rect``, ``Tr_velo_to_cam``) and odometry (``Tr``, which leads into the rectified camera)."""
    name = next((key for key in ("Tr_velo_to_cam", "Tr_velo_cam", "Tr") if key in members), None)
    Tr = None if name is None else _of_matrix(members, name, (3, 4))
    turn = next((key for key in ("R0_rect", "R_rect") if key in members), None)
    R_rect = np.eye(3) if turn is None else _of_matrix(members, turn, (3, 3))
    cameras: list[FileCamera] = []
    for camera in places:
        P = _of_matrix(members, f"P{camera}", (3, 4))
        mount = None
        if Tr is not None:
            first = transform(_FIRST, LIDAR, Tr[:, :3], Tr[:, 3])
            mount = transform(f"P{camera}", _FIRST, R_rect, _offset(P)) @ first
        cameras.append(FileCamera(f"P{camera}", lens=_projection_lens(P, None), T_camera_lidar=mount))
    notes = [] if Tr is not None else ["There is no Tr_velo_to_cam and no Tr: no mount on the LiDAR is known."]
    return Contents(cameras, notes=notes)


def _projection_lens(P: Floats, size: tuple[int, int] | None) -> FileLens | None:
    K = P[:, :3]
    if abs(K[0, 1]) + abs(K[1, 0]) + abs(K[2, 0]) + abs(K[2, 1]) > 0.0 or K[2, 2] != 1.0:
        return None
    return FileLens("plumb_bob", camera_matrix(K[0, 0], K[1, 1], K[0, 2], K[1, 2]), [], size)


def _offset(P: Floats) -> Floats:
    """t of P = K [I | t]: where rectified camera 00 lies in this one."""
    try:
        return np.linalg.solve(P[:, :3], P[:, 3]).astype(np.float64)
    except np.linalg.LinAlgError:
        raise refused("A P has no focal length.", "Send KITTI's files as they are.") from None


def _size(members: Members, kind: str, camera: str) -> tuple[int, int] | None:
    size = members.get(f"{kind}_{camera}")
    return None if size is None or len(size) != 2 else image_size(f"The images of {camera}", *map(round, size))


def _of(members: Members, name: str, count: int) -> list[float]:
    if name not in members:
        raise refused(f"There is no {name}.", "Send KITTI's files as they are.")
    return numbers(name, members[name], count)


def _of_matrix(members: Members, name: str, shape: tuple[int, ...]) -> Floats:
    return np.array(_of(members, name, int(np.prod(shape)))).reshape(shape)
