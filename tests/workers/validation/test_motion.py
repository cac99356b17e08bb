"""The vehicle's motion from two sweeps, and mounts of moving vehicles that are far off."""

import numpy as np
import pytest

from tests.support.scenes.drive import Drive, record_pairs
from tests.support.scenes.road import draw_road
from tests.workers.validation.roads import calibration, camera
from workers.simulation.sensors import SENSORS
from workers.validation.edge_check import EdgeCheck
from workers.validation.motion import STANDING, Motion, motion_between


def moving(speed_m_s, turn_deg_s, frames):
    drive = Drive(speed_m_s=speed_m_s, turn_deg_s=turn_deg_s)
    return list(record_pairs(draw_road(5), drive, SENSORS["os1-64"], camera(), 5, frames))


@pytest.mark.parametrize(("speed_m_s", "turn_deg_s"), [(0.0, 0.0), (8.0, 12.0), (28.0, -3.0)])
def test_the_motion_of_two_sweeps(speed_m_s, turn_deg_s):
    ((sweep, following, _),) = moving(speed_m_s, turn_deg_s, 1)
    motion = motion_between(sweep, following)
    assert motion.linear == pytest.approx([speed_m_s, 0.0, 0.0], abs=0.3)
    assert np.degrees(motion.angular) == pytest.approx([0.0, 0.0, turn_deg_s], abs=0.5)
    assert motion.is_moving == (speed_m_s > 0.0)


def test_sweeps_of_other_places_or_moments_have_no_motion():
    (first, following, _), _, _, (_, later, _) = moving(8.0, 0.0, 4)
    mirrored = later.xyz[:, [1, 0, 2]] * np.float32([0.3, -0.3, 1.0])
    assert motion_between(first, type(later)(**{**fields(later), "xyz": mirrored})) is None
    assert motion_between(first, type(later)(**{**fields(following), "stamp_ns": 10**9})) is None


def fields(sweep):
    return {name: getattr(sweep, name) for name in type(sweep).__dataclass_fields__}


def test_points_are_moved_by_turn_and_way():
    motion = Motion(np.array([0.0, 0.0, 0.5]), np.array([20.0, 0.0, 0.0]), moment_ns=10_000_000)
    moved = motion.applied(np.array([[10.0, 0.0, 0.0], [10.0, 0.0, 0.0]]), np.array([10_000_000, 50_000_000]))
    angle = 0.02
    assert moved[0].tolist() == [10.0, 0.0, 0.0]
    assert moved[1] == pytest.approx([10.0 * np.cos(angle) + 0.8, 10.0 * np.sin(angle), 0.0], abs=1e-4)


def test_a_moving_vehicle_passes_where_points_stay_behind_and_far_mounts_are_found():
    seen = moving(28.0, 10.0, 4)
    motions = [motion_between(sweep, following) for sweep, following, _ in seen]

    def verdict(turn_deg, motions):
        check = EdgeCheck(calibration(turn_deg))
        for (sweep, _, image), motion in zip(seen, motions, strict=True):
            check.add(sweep, image[..., 1], motion)
        return check.verdict(), check.score

    (sound, score), (_, unmoved) = verdict((0.0, 0.0, 0.0), motions), verdict((0.0, 0.0, 0.0), [STANDING] * 4)
    assert sound.verdict in ("pass", "not_told") and score > 1.1 * unmoved
    assert {axis.axis for axis in sound.axes if axis.verdict == "pass"} >= {"pitch", "yaw"}
    judged, _ = verdict((0.0, 5.0, 0.0), motions)
    assert judged.verdict == "stop" and "about -5 degrees of yaw" in judged.sentence
