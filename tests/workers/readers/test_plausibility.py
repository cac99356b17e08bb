"""What no LiDAR can have measured stops a recording in words that name the cause; what real sensors do stops none."""

import numpy as np
import pytest
from formats import folder_of, npy
from making_recordings import png

from apexcal.documents.readings import ReadOptions
from tests.support.scenes.drawn import draw, draw_street
from workers.readers.inspection import inspect_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.plausibility import SweepSample, implausible
from workers.readers.recording import ReadError, Sweep

RNG = np.random.default_rng(5)
NOISE_M = 0.01


def hall(rings=16, columns=360, half_m=(6.0, 4.5), floor_m=1.6):
    """Points (N, 3) of a hall as a spinning sensor sees them, and their rings: the distance of each ray's wall."""
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, columns, endpoint=False), np.radians(np.linspace(-15, 15, rings)), indexing="ij"
    )
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    with np.errstate(divide="ignore"):
        walls = [half / np.abs(ray[..., i]) for i, half in enumerate(half_m)]
        floor = np.where(ray[..., 2] < 0, -floor_m / ray[..., 2], np.inf)
    range_m = np.minimum.reduce([*walls, floor]) + RNG.normal(0, NOISE_M, azimuth.shape)
    return (ray * range_m[..., None]).reshape(-1, 3), np.tile(np.arange(rings), columns)


def empty_world(height_m=1.0):
    """A VLP-16 above a simulator's flat floor: half of its rays meet nothing; 3 % of the points are a board's."""
    azimuth, elevation = np.meshgrid(np.linspace(-np.pi, np.pi, 900), np.radians(np.arange(-15, 0, 2)), indexing="ij")
    range_m = height_m / np.sin(-elevation)
    xyz = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    xyz = (xyz * range_m[..., None]).reshape(-1, 3)
    xyz[:, 2] += RNG.normal(0, 0.002, len(xyz))
    board = RNG.random(len(xyz)) < 0.03
    xyz[board] = np.array([3.0, 0.0, 0.0]) + RNG.uniform(-0.5, 0.5, (int(board.sum()), 3)) * [0.01, 1.0, 1.0]
    return xyz


def five_as_four(xyz, ring):
    """Rows of x, y, z, intensity and ring, read as rows of four values."""
    rows = np.column_stack([xyz, RNG.uniform(0, 1, len(xyz)), ring]).astype(np.float32)
    return rows.reshape(-1)[: rows.size // 4 * 4].reshape(-1, 4)[:, :3]


def robot(xyz, ring):
    """A third of the points are those of the robot itself, 0.1 to 0.3 m away."""
    own = RNG.random(len(xyz)) < 0.33
    range_m = np.linalg.norm(xyz, axis=1, keepdims=True)
    return np.where(own[:, None], xyz / range_m * RNG.uniform(0.1, 0.3, (len(xyz), 1)), xyz)


def tilted(xyz, turn_deg):
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    return xyz @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T


MAP_M = np.array([691_000.0, 5_334_000.0, 500.0])
PLANE = np.array([1.0, 1.0, 0.0])
# How the points of a hall are changed, and what the sentence names; empty: nothing stops them.
CASES = {
    "as they are": (lambda xyz, ring: xyz, ""),
    "walls at whole metres without noise": (lambda xyz, ring: np.where(np.abs(xyz) > 4.4, np.rint(xyz), xyz), ""),
    "a robot that sees itself": (robot, ""),
    "each point twice": (lambda xyz, ring: np.repeat(xyz[::2], 2, axis=0), ""),
    "tilted by 30 degrees": (lambda xyz, ring: tilted(xyz, 30), ""),
    "a flat floor and a board": (lambda xyz, ring: empty_world(), ""),
    "a small cabin": (lambda xyz, ring: xyz * 0.25, ""),
    "a street": (lambda xyz, ring: xyz * 8.0, ""),
    "millimetres": (lambda xyz, ring: xyz * 1000, "probably millimetres"),
    "millimetres of a small cabin": (lambda xyz, ring: xyz * 250, "probably"),
    "centimetres": (lambda xyz, ring: xyz * 100, "probably centimetres"),
    "whole millimetres": (lambda xyz, ring: np.rint(xyz * 1000), "probably millimetres"),
    "a map's frame": (lambda xyz, ring: xyz + MAP_M, "of a map"),
    "kilometres": (lambda xyz, ring: xyz / 1000, "not metres"),
    "a unit cube": (lambda xyz, ring: xyz / np.abs(xyz).max() / 2, "not metres"),
    "z = 0": (lambda xyz, ring: xyz * PLANE, "z is 0.00 m in all its points"),
    "z = 0 but for a hundredth": (
        lambda xyz, ring: np.where(RNG.random((len(xyz), 1)) < 0.01, xyz, xyz * PLANE),
        "z is",
    ),
    "z is the height of the lens above the base": (lambda xyz, ring: xyz * PLANE + [0, 0, 0.036], "z is 0.04 m"),
    "x = y": (lambda xyz, ring: xyz[:, [0, 0, 2]], "one plane"),
    "a plane that leans": (lambda xyz, ring: tilted(xyz * PLANE, 40), "one plane"),
    "all points alike": (lambda xyz, ring: np.broadcast_to([3.0, 1.0, 0.5], xyz.shape) + 0.0, "same points"),
    "a buffer filled tenfold": (lambda xyz, ring: np.repeat(xyz[::10], 10, axis=0), "same points"),
    "five values read as four": (five_as_four, "five values a point"),
    "another byte order": (lambda xyz, ring: xyz * 1e20, "byte order"),
    "a radar's few": (lambda xyz, ring: xyz[::90], "64 points"),
}


def sample_of(xyz, ring=None, sweeps=3):
    sample = SweepSample()
    for k in range(sweeps):
        points = xyz.astype(np.float32)
        zeros = np.zeros(len(points))
        rings = np.zeros(len(points), np.uint16) if ring is None else ring.astype(np.uint16)
        sample.add(Sweep(k * 10**8, points, zeros.astype(np.float32), rings, zeros.astype(np.int64)))
    return sample


@pytest.mark.parametrize("case", CASES)
def test_points_are_judged_by_what_a_lidar_can_be(case):
    change, words = CASES[case]
    fault = implausible(sample_of(change(*hall())), "/points", 0.1)
    assert (fault is None) == (words == ""), fault
    assert fault is None or (words in fault.sentence and "--accept" in fault.remedy and fault.verdict == "stop")


def test_rings_follow_elevation_and_sweeps_are_whole_turns():
    xyz, ring = hall()
    assert implausible(sample_of(xyz, ring), "L", 0.1) is None
    shuffled = np.random.default_rng(1).permutation(16)[ring]
    assert "do not follow elevation" in implausible(sample_of(xyz, shuffled), "L", 0.1).sentence
    assert "754 clouds a second" in implausible(sample_of(xyz, ring), "L", 1 / 754).sentence
    for step_s in (None, 0.01, 0.05, 0.2, 30.0):
        assert implausible(sample_of(xyz, ring), "L", step_s) is None


@pytest.mark.parametrize("seed", range(6))
def test_nothing_stops_a_drawn_sensor(seed):
    """Seeds 0 to 299 pass; the others take long."""
    _, lidar = (draw(seed) if seed % 2 else draw_street(seed)).simulated(2.0)
    sample = SweepSample()
    sample.add(lidar.sweep(0, 0.0, 0))
    assert implausible(sample, "L", 0.1) is None


def test_a_sample_is_spread_over_the_recording_and_bounded():
    xyz, _ = hall(columns=400)
    sample = sample_of(xyz, sweeps=500)
    assert len(sample.xyz) == len(sample.counts) <= 16 and all(len(part) <= 1000 for part in sample.xyz)
    assert sample.counts[0] == 6400


def test_it_stops_inspect_and_ingestion_until_the_owner_accepts_it(tmp_path):
    files = {f"images/{i}.png": png(64, 48, i) for i in range(8)}
    for i in range(8):
        xyz, ring = hall()
        files[f"clouds/{i}.npy"] = npy(np.column_stack([xyz * PLANE, ring * 1.0, ring]).astype(np.float32))
    folder_of(tmp_path / "walk", files)
    options = ReadOptions(point_times="stamp_only")
    (fault,) = (
        each for each in inspect_recording(tmp_path / "walk", options=options).faults if each.verdict == "stop"
    )
    with pytest.raises(ReadError) as caught:
        normalise(tmp_path / "walk", tmp_path / "out", options=options)
    assert (caught.value.code, caught.value.message, caught.value.hint) == (fault.code, fault.sentence, fault.remedy)
    assert caught.value.fields == {"can_accept": True} and not list((tmp_path / "out").iterdir())
    accepting = options.model_copy(update={"accept_implausible": True})
    manifest = normalise(tmp_path / "walk", tmp_path / "out", options=accepting)
    assert any("The owner has accepted it" in warning for warning in manifest.warnings)
    inspection = inspect_recording(tmp_path / "walk", options=accepting)
    assert inspection.calibratable and [each.verdict for each in inspection.faults if each.code == fault.code] == [
        "look"
    ]
