"""The mount that seeds agree on, and that chance offers none."""

import numpy as np
import pytest

from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector, vector_from_rotation
from apexcal.geometry.se3 import SE3
from workers.marks.mount_search import SeedPairs, search_mounts
from workers.marks.sights import Lens, MountedLens

SIZE = (1280, 720)
LENS = Lens("pinhole", np.array([900.0, 905.0, 640.0, 355.0]))
WIDE = Lens("kannala_brandt", np.array([430.0, 430.0, 640.0, 355.0, -0.02, 0.003, 0.0, 0.0]))


def mounted(random, lens=LENS):
    """A mount in any LiDAR frame: no nominal one would help."""
    turn = rotation_from_vector(random.normal(0.0, 0.1, 3)) @ FORWARD_LIDAR_TO_OPTICAL
    any_frame = rotation_from_vector(random.normal(0.0, 2.0, 3))
    return MountedLens(lens, SE3("camera", "lidar", turn @ any_frame.T, random.normal(0.0, 0.3, 3))), any_frame


def pairs_of(random, camera, any_frame, count=40, right=0.5, seeds=3):
    level = np.column_stack(
        [random.uniform(3.0, 14.0, count), random.uniform(-2.5, 2.5, count), random.uniform(-0.5, 0.9, count)]
    )
    points = level @ any_frame.T
    places = random.uniform((0.0, 0.0), SIZE, (count, seeds, 2))
    good = random.uniform(size=count) < right
    places[good, random.integers(0, seeds, good.sum())] = camera.pixels(points)[good] + random.normal(
        0.0, 3.0, (good.sum(), 2)
    )
    return SeedPairs(points, places, np.arange(count), np.ones(count, np.bool_))


@pytest.mark.parametrize("lens", [LENS, WIDE])
def test_a_mount_is_found_among_wrong_seeds(lens):
    random = np.random.default_rng(3)
    camera, frame = mounted(random, lens)
    pairs = pairs_of(random, camera, frame, right=0.6)
    (best, *others) = search_mounts(pairs, lens, lens.model, SIZE)
    assert not others
    turned = best.camera.mount @ camera.mount.inverse()
    assert np.degrees(np.linalg.norm(vector_from_rotation(turned.R))) < 1.0
    assert best.size >= 20


def test_a_mount_is_found_without_a_lens():
    random = np.random.default_rng(4)
    camera, frame = mounted(random)
    pairs = pairs_of(random, camera, frame, count=60, right=0.9, seeds=1)
    (best, *_) = search_mounts(pairs, None, "pinhole", SIZE)
    assert np.median(np.hypot(*(best.camera.pixels(pairs.points) - camera.pixels(pairs.points)).T)) < 8.0


def test_chance_offers_no_mount():
    for seed in range(3):
        random = np.random.default_rng([5, seed])
        camera, frame = mounted(random)
        assert search_mounts(pairs_of(random, camera, frame, count=30, right=0.0), LENS, "pinhole", SIZE) == []


def test_seeds_that_stay_in_one_place_are_no_evidence():
    random = np.random.default_rng(6)
    camera, frame = mounted(random)
    pairs = pairs_of(random, camera, frame, right=0.0, seeds=1)
    pairs.seeds[:] = np.array((640.0, 300.0)) + random.normal(0.0, 2.0, pairs.seeds.shape)
    assert search_mounts(pairs, LENS, "pinhole", SIZE) == []


def test_two_mounts_are_both_told():
    random = np.random.default_rng(7)
    camera, frame = mounted(random)
    pairs = pairs_of(random, camera, frame, right=1.0, seeds=2)
    aside = MountedLens(LENS, SE3("camera", "lidar", camera.mount.R, camera.mount.t + np.array((0.9, 0.0, 0.0))))
    pairs.seeds[:, 0] = camera.pixels(pairs.points)
    pairs.seeds[:, 1] = aside.pixels(pairs.points)
    assert len(search_mounts(pairs, LENS, "pinhole", SIZE)) == 2
