"""Sensors without rings: boards on still poses, of a drawn rosette and of a real recording."""

import csv

import numpy as np
import pytest

from apexcal.documents.errors import InputError
from apexcal.documents.readings import ReadOptions
from benchmarks.detection.real import DATA
from benchmarks.detection.ringless import run
from benchmarks.detection.sizes import GROSS_M
from workers.readers.detect import open_recording
from workers.readers.recording import Sweep
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

_EDGES_M = 0.8, 0.6
_SIZE = {"board_width_m": 0.8, "board_height_m": 0.6}
_REGION = Region.from_document({"all": [{"box": {"min": [1.0, -3.0, -1.2], "max": [6.0, 3.0, 2.0]}}]})
_WALL_M, _SWEEPS, _POINTS = 7.0, 16, 1_250


def board(random, roll_deg):
    """A corner of a board and its two edges from there, the first to the lower left, metres."""
    roll = np.radians(roll_deg + random.normal(0.0, 4.0))
    yaw = random.uniform(-0.4, 0.4)
    left = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    first = _EDGES_M[0] * (np.cos(roll) * left - np.sin(roll) * up)
    second = _EDGES_M[1] * (-np.sin(roll) * left - np.cos(roll) * up)
    middle = np.array([random.uniform(3.0, 4.5), random.uniform(-0.4, 0.4), random.uniform(-0.2, 0.2)])
    return middle - 0.5 * (first + second), first, second


def rosette(random, pose, shown, index):
    """A sweep of petals over 40 degrees: what a board leaves free shows a wall."""
    angle = np.cumsum(random.uniform(0.0, 0.02, _POINTS)) + random.uniform(0.0, 6.28)
    radius = np.radians(20.0) * np.sin(3.618 * angle)
    rays = np.column_stack([np.ones(_POINTS), np.tan(radius * np.cos(angle)), np.tan(radius * np.sin(angle))])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    corner, first, second = pose
    normal = np.cross(first, second)
    reach = (normal @ corner) / (rays @ normal)
    off = reach[:, None] * rays - corner
    p, q = off @ first / (first @ first), off @ second / (second @ second)
    on_board = shown & (p > 0.0) & (p < 1.0) & (q > 0.0) & (q < 1.0)
    reach = np.where(on_board, reach, _WALL_M / rays[:, 0]) + random.normal(0.0, 0.015, _POINTS)
    xyz = (reach[:, None] * rays).astype(np.float32)
    none = np.zeros(_POINTS)
    return Sweep(100_000_000 * index, xyz, none.astype(np.float32), none.astype(np.uint16), none.astype(np.int64))


def recorded(seed, roll_deg, poses=5, shown=True):
    random = np.random.default_rng(seed)
    boards = [board(random, roll_deg) for _ in range(poses)]
    sweeps = [rosette(random, boards[k // _SWEEPS], shown, k) for k in range(poses * _SWEEPS)]
    return Listed(sweeps), boards


@pytest.mark.parametrize(("upper_corner", "roll_deg"), [(0, 49.0), (1, 90.0), (-1, 0.0)])
def test_still_poses_show_a_board_without_rings(upper_corner, roll_deg):
    source, boards = recorded(3, roll_deg)
    options = _SIZE | {"upper_corner": upper_corner}
    found = detect_range(source, _REGION, "refined", options, indices=range(len(source)), still=True)
    assert [vertex.sweep_index // _SWEEPS for vertex in found.vertices] == list(range(len(boards)))
    assert found.poses.count == len(boards)
    assert found.rejected["same_pose"] >= 14 * len(boards)  # of 16 each: a sweep by itself may show too little
    off = np.array(
        [np.array(vertex.xyz) - corner for vertex, (corner, _, _) in zip(found.vertices, boards, strict=True)]
    )
    assert np.sqrt(np.mean(off[:, 1:] ** 2)) < 0.010
    assert np.abs(off).max() < 0.035
    for vertex, (corner, first, second) in zip(found.vertices, boards, strict=True):
        assert vertex.corners is not None
        bottom = vertex.corners.xyz[vertex.corners.names.index("bottom")]
        assert np.linalg.norm(np.array(bottom) - corner - first - second) < 0.04
    shard = detect_range(source, _REGION, "refined", options, indices=range(24, 52), still=True)
    assert shard.vertices == [vertex for vertex in found.vertices if 24 <= vertex.sweep_index < 52]


def test_a_sensor_without_rings_is_refused_where_the_board_moves():
    source, _ = recorded(3, 49.0, poses=2)
    with pytest.raises(InputError) as caught:
        detect_range(source, _REGION, "refined", _SIZE, indices=range(8))
    assert caught.value.code == "points_without_rings"


@pytest.mark.parametrize(
    ("edges_m", "poses", "shown", "reason"),
    [
        ((0.8, 0.6), 2, False, "no_points"),
        ((0.0, 0.0), 2, True, "size_not_stated"),
        ((0.6, 0.45), 2, True, "upright_object"),
        ((1.2, 0.9), 2, True, "not_a_board"),
        ((0.8, 0.6), 1, True, "upright_object"),
    ],
)
def test_what_is_no_such_board_is_refused(edges_m, poses, shown, reason):
    source, _ = recorded(5, 0.0, poses, shown)
    options = {"board_width_m": edges_m[0], "board_height_m": edges_m[1], "upper_corner": -1 if edges_m[0] else 0}
    found = detect_range(source, _REGION, "refined", options, indices=range(len(source)), still=True)
    assert not found.vertices
    assert reason in found.rejected


def test_a_real_board_with_level_edges():
    """Its size is that of the publisher's picks. A pick is one return: it lies up to 56 mm off the board's plane."""
    path = DATA / "infrared-level-board"
    if not path.exists():
        pytest.skip("../shared/data is absent")
    recording = open_recording(path / "clouds", ReadOptions(point_times="stamp_only", rings=1))
    try:
        (lidar,) = (sensor for sensor in recording.sensors if sensor.kind == "lidar")
        source = Listed(list(recording.sweeps(lidar)))
    finally:
        recording.close()
    region = Region.from_document({"all": [{"box": {"min": [2.5, -1.2, -0.6], "max": [4.2, 0.8, 0.9]}}]})
    options = {"board_width_m": 0.6, "board_height_m": 0.34, "upper_corner": 1}
    found = detect_range(source, region, "refined", options, indices=range(4), still=True)
    assert [vertex.sweep_index for vertex in found.vertices] == [0, 1, 2, 3]
    with (path / "corners.csv").open() as file:
        rows = list(csv.DictReader(file))
    off = []
    for row in rows:
        vertex = found.vertices[int(row["pose"]) // 2 - 1]
        place = ["top", "left", "bottom", "right"][int(row["corner"]) - 1]
        xyz = vertex.xyz if place == "top" else vertex.corners.xyz[vertex.corners.names.index(place)]
        off.append(np.hypot(xyz[1] - float(row["y"]), xyz[2] - float(row["z"])))
    assert len(off) == 8
    assert np.median(off) < 0.020
    assert max(off) < 0.030


# Before, one vertex of each of these lay 0.1 m or farther from every corner that the board has.
# Of `people`, seed 700 is refused as a whole: people fill most windows, and their depth is taken for noise.
@pytest.mark.parametrize(("seed", "case"), [(700, "level"), pytest.param(910, "people", marks=pytest.mark.slow)])
def test_vertices_of_drawn_poses_are_the_boards(seed, case):
    row = run((seed, case))
    assert len(row.off_m) >= 4
    assert max(row.off_m) < GROSS_M
    assert row.twice == 0
    assert row.answer == "region"


# Before, 59002 (level edges, a tip stated) gave 2 vertices and 59003 (the reverse) 5, 1 to 13 cm from any corner.
@pytest.mark.slow
@pytest.mark.parametrize("seed", [701, 59002, 59003])
def test_a_board_that_is_held_otherwise_gives_no_vertex(seed):
    assert not run((seed, "turned")).off_m


@pytest.mark.slow
def test_a_board_that_never_stands_still_is_refused_with_what_works():
    row = run((700, "walk"))
    assert not row.off_m
    assert row.answer.endswith("points_without_rings")
