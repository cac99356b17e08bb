"""A street of smooth facades, cast here ray by ray: their ranges depend on the phase of the firings."""

import numpy as np
import pytest

from apexcal.documents.errors import InputError
from tests.support.scenes.still import looking_at
from workers.readers.recording import Sweep
from workers.vertices.motion import count_steps, is_drive
from workers.vertices.sensor_grid import learn_grid
from workers.vertices.static_background import StaticBackground
from workers.vertices.still_poses import _places, find_poses
from workers.vertices.suggestion import suggest
from workers.vertices.sweep_source import Listed

ELEVATIONS = np.radians(np.arange(-15.0, 16.0, 2.0))
COLUMNS = 1800
HEIGHT_M = 1.8
FACADES_M = (14.0, -12.0)
DOORSTEPS_M = [(x, y) for x in range(-60, 90, 15) for y in (13.0, -11.0)]  # boxes before the facades


def meets_box(directions, low, high):
    """Range at which rays from the origin enter a box; infinite for those that miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = np.array(low) / directions, np.array(high) / directions
    first, last = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    return np.where((first < last) & (first > 0.0), first, np.inf)


def street(
    number, boxes, random, elevations=ELEVATIONS, columns=COLUMNS, reach_m=80.0, driven_m=0.0, facades_m=FACADES_M,
    doorsteps_m=DOORSTEPS_M,
):  # fmt: skip
    """The sweep of that number: ground, facades, steps at the doors, and boxes (low, high)."""
    rings = len(elevations)
    azimuth = (np.arange(columns) + random.uniform()) * (2.0 * np.pi / columns)
    elevation = np.repeat(elevations[:, None], columns, axis=1)
    directions = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(directions[..., 2] < 0.0, -HEIGHT_M / directions[..., 2], np.inf)
        for side in facades_m:
            wall = side / directions[..., 1]
            distance = np.minimum(distance, np.where(wall > 0.0, wall, np.inf))
    steps = [((x - driven_m, y - 0.5, -HEIGHT_M), (x - driven_m + 2.0, y + 0.5, 0.4)) for x, y in doorsteps_m]
    for low, high in [*boxes, *steps]:
        looks = looking_at(azimuth, np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]))
        distance[:, looks] = np.minimum(distance[:, looks], meets_box(directions[:, looks], low, high))
    seen = distance < reach_m
    distance = distance + 0.01 * random.normal(size=distance.shape)
    count = int(seen.sum())
    return Sweep(
        stamp_ns=1_000_000_000 + number * 100_000_000,
        xyz=(distance[..., None] * directions)[seen].astype(np.float32),
        intensity=np.zeros(count, np.float32),
        ring=np.repeat(np.arange(rings), columns).reshape(rings, columns)[seen].astype(np.uint16),
        offset_ns=np.zeros(count, np.int64),
    )


def person(x, y):
    """A box of a person's size that stands there."""
    return (x - 0.2, y - 0.3, -HEIGHT_M), (x + 0.2, y + 0.3, 0.0)


def test_facades_do_not_make_a_short_walk_still_poses():
    random = np.random.default_rng(1)
    walk = Listed([street(k, [person(8.0, -2.0 + 0.12 * k)], random) for k in range(30)])
    assert find_poses(walk, stated=False) is None
    poses = Listed(
        [street(k, [person(*at)], random) for k, at in enumerate(random.uniform((6, -6), (14, 6), (12, 2)))]
    )
    assert find_poses(poses, stated=False).count == 12


def test_twelve_sweeps_tell_who_walks_between_facades():
    """All points are compared, with fewer sweeps: of every k-th point, pieces of a facade have a person's size."""
    random = np.random.default_rng(3)
    walk = Listed([street(k, [person(9.0, -2.4 + 0.2 * k)], random, reach_m=40.0) for k in range(24)])
    background = StaticBackground.of(walk)
    few = background.thinned(12)
    assert len(few.near) == 12
    assert {few.stamps_ns[0], few.stamps_ns[-1]} == {walk.sweep(0).stamp_ns, walk.sweep(23).stamp_ns}
    steps = count_steps(_places(walk, background, range(24)))
    assert steps.jumps == 0
    assert steps.walks > 18


@pytest.mark.parametrize("speed_m_s", [0.5, 6.0])
def test_a_drive_between_smooth_facades_is_refused(speed_m_s):
    random = np.random.default_rng(4)
    drive = Listed([street(k, [], random, driven_m=0.1 * speed_m_s * k) for k in range(20)])
    with pytest.raises(InputError) as refused:
        suggest(drive)
    assert refused.value.code == "everything_moves"


def car(x, y):
    return (x - 2.1, y - 0.9, 0.2 - HEIGHT_M), (x + 2.1, y + 0.9, -0.3)


def lane(number, y, speed_m_s):
    """Cars 9 m apart that pass on a lane 80 m long."""
    return [car((x + 0.1 * speed_m_s * number + 40.0) % 80.0 - 40.0, y) for x in range(-40, 40, 9)]


@pytest.mark.parametrize("speeds_m_s", [(3.0,), (8.0,), (3.0, -3.0)])
@pytest.mark.parametrize("walls", [{"doorsteps_m": ()}, {"facades_m": (), "doorsteps_m": ()}])
def test_traffic_that_passes_a_parked_car_is_no_drive(speeds_m_s, walls):
    """Before, each of these was: cars of one lane lie on four sides, and facades agree with a shift along them."""
    random = np.random.default_rng(6)
    lanes = list(zip((4.0, -4.0), speeds_m_s, strict=False))
    sweeps = [street(k, [box for y, v in lanes for box in lane(k, y, v)], random, **walls) for k in range(16)]
    assert not is_drive(Listed(sweeps), learn_grid(sweeps))


def test_people_who_walk_alike_are_no_drive():
    """In an open field they are all that is upright."""
    random = np.random.default_rng(5)
    walk = [street(k, [], random) for k in range(12)]
    grid = learn_grid(walk)
    assert not is_drive(Listed(walk), grid)
    people = [(x, y) for x in (6.0, 8.0, 10.0) for y in (-3.0, -1.0, 1.0)]
    walks = [[person(x, y + 0.14 * k) for x, y in people] for k in range(12)]
    both = [street(k, boxes, random, facades_m=(), doorsteps_m=()) for k, boxes in enumerate(walks)]
    assert not is_drive(Listed(both), grid)


def test_a_facade_at_grazing_incidence_is_the_same_in_all_sweeps():
    random = np.random.default_rng(2)
    source = Listed([street(k, [], random) for k in range(16)])
    seen = StaticBackground.of(source).compare(source.sweep(3))
    along = np.abs(source.sweep(3).xyz[:, 0])
    far = (along > 40.0) & (along < 60.0)
    assert far.sum() > 500
    assert seen.moved[far].mean() < 0.03
