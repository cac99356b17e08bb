"""Each flaw of a sensor does what it says, by itself."""

import numpy as np
import pytest

from workers.simulation.disturbances import Disturbances
from workers.simulation.flaws import Flaws, Mount
from workers.simulation.lidar import BOARD, BOX, PERSON, SENSORS, WALL, Lidar
from workers.simulation.scene import Scene
from workers.simulation.walker import BOARD_EDGES_M, Walk

STARTS_S = (1.0, 4.0, 7.0, 10.0)


def scanned(flaws=None, mount=None, *, sensor="vlp16", scene=None, disturbances=None):
    """A sensor without noise, its walk, and some sweeps with their labels."""
    scene = scene or Scene()
    walk = Walk(5, 20.0, scene.ground_z, plan="yard", disturbances=disturbances)
    lidar = Lidar(
        *(SENSORS[sensor], scene, walk), sector_deg=60.0, noise_m=0.0, seed=5,
        disturbances=disturbances, flaws=flaws, mount=mount,
    )  # fmt: skip
    return walk, lidar, [lidar.labelled_sweep(k, start_s, 0) for k, start_s in enumerate(STARTS_S)]


def ranges(sweeps):
    return np.concatenate([np.linalg.norm(sweep.xyz, axis=1) for sweep, _ in sweeps])


def test_rings_are_off_by_a_constant_each():
    _, _, plain = scanned()
    _, _, biased = scanned(Flaws(ring_bias_m=0.02))
    off = ranges(biased) - ranges(plain)
    ring = np.concatenate([sweep.ring for sweep, _ in plain])
    met = [r for r in range(16) if np.count_nonzero(ring == r) > 20]
    assert len(met) > 8
    assert 0.008 < np.std([off[ring == r].mean() for r in met]) < 0.04
    assert max(off[ring == r].std() for r in met) < 0.002


def test_lasers_that_point_elsewhere_are_decoded_by_the_table():
    _, _, plain = scanned()
    _, _, turned = scanned(Flaws(ring_angle_deg=0.1))
    for sweep, label in turned:
        wall = sweep.xyz[label == WALL].astype(float)
        elevation = np.degrees(np.arctan2(wall[:, 2], np.hypot(wall[:, 0], wall[:, 1])))
        np.testing.assert_allclose(elevation, np.linspace(-15, 15, 16)[sweep.ring[label == WALL]], atol=1e-4)
    off = [sweep.xyz[label != BOARD][:, 2].min() for sweep, label in turned]
    assert max(abs(z - sweep.xyz[:, 2].min()) for z, (sweep, _) in zip(off, plain, strict=True)) > 0.01


def test_dark_surfaces_are_farther_and_lost_more_often():
    _, _, plain = scanned()
    _, _, shifted = scanned(Flaws(intensity_m=0.02))
    off = ranges(shifted) - ranges(plain)
    label = np.concatenate([label for _, label in plain])
    assert off[label == PERSON].mean() == pytest.approx(0.02 * (0.5 - 28 / 255), abs=0.002)
    assert off[label == BOARD].mean() == pytest.approx(0.02 * (0.5 - 190 / 255), abs=0.002)
    _, _, holed = scanned(Flaws(lost_share=0.5))
    kept = {
        what: sum(np.count_nonzero(label == what) for _, label in holed) / np.count_nonzero(label == what)
        for what in (PERSON, BOARD)
    }
    assert kept[PERSON] == pytest.approx(1.0 - 0.5 * (1.0 - 2.0 * 28 / 255), abs=0.1)
    assert kept[BOARD] > 0.9


def test_a_slanted_board_is_farther_by_what_is_said_at_60_degrees():
    _, _, plain = scanned()
    walk, _, slanted = scanned(Flaws(incidence_m=0.05))
    for start_s, (before, label), (after, _) in zip(STARTS_S, plain, slanted, strict=True):
        on = label == BOARD
        poses = walk.poses(start_s + before.offset_ns[on] * 1e-9)
        reach = np.linalg.norm(before.xyz[on], axis=1)
        cosine = np.abs(np.sum(np.cross(poses.edge_left, poses.edge_right) * before.xyz[on], axis=1)) / reach
        off = np.linalg.norm(after.xyz[on], axis=1) - reach
        np.testing.assert_allclose(off, 0.05 * (1.0 / cosine - 1.0), atol=0.003)


def test_surfaces_close_behind_one_another_mix_at_the_edges():
    wide = Disturbances(beam_mrad=4.0)
    between = {}
    for name, flaws in (("first", None), ("mixed", Flaws(mixing_m=0.8))):
        walk, _, sweeps = scanned(flaws, disturbances=wide, sensor="os1-128")
        depths = []
        for start_s, (sweep, _) in zip(STARTS_S, sweeps, strict=True):
            poses = walk.poses(start_s + sweep.offset_ns * 1e-9)
            away = np.cross(poses.edge_left, poses.edge_right)
            away *= np.sign(np.sum(away * poses.apex, axis=1, keepdims=True))
            depth = np.sum((sweep.xyz - poses.apex) * away, axis=1)
            near = np.linalg.norm(sweep.xyz - poses.apex, axis=1) < 1.2
            depths.append(depth[near])
        depth = np.concatenate(depths)
        between[name] = np.count_nonzero((depth > 0.005) & (depth < 0.05))
    assert between["mixed"] > between["first"] + 5


def test_a_surface_needs_its_share_of_the_beam():
    counts = []
    for least in (0.0, 0.5):
        _, _, sweeps = scanned(Flaws(mixing_m=0.01, least_share=least), disturbances=Disturbances(beam_mrad=6.0))
        counts.append(sum(np.count_nonzero(label == BOARD) for _, label in sweeps))
    assert counts[1] < 0.9 * counts[0]


def test_a_motor_that_wavers_and_an_encoder_that_jitters():
    def steps(flaws):
        _, _, sweeps = scanned(flaws)
        sweep = sweeps[0][0]
        xyz = sweep.xyz[sweep.ring == 0].astype(float)
        return np.diff(np.sort(np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0]))))

    assert np.ptp(steps(None)) < 1e-3
    assert 0.001 < np.ptp(steps(Flaws(wander_deg=0.1))) < 0.01
    assert 0.01 < steps(Flaws(jitter_mrad=0.2)).std() < 0.03


def test_the_seam_cuts_the_sweep_where_it_is_said_to_be():
    _, lidar, sweeps = scanned(mount=Mount(seam_deg=10.0))
    sweep = sweeps[0][0]
    azimuth = np.degrees(np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0]).astype(float))
    first, last = azimuth[np.argmin(sweep.offset_ns)], azimuth[np.argmax(sweep.offset_ns)]
    assert 9.0 < first <= 10.01 < last < 11.0
    assert np.abs(azimuth).max() < 60.3
    assert sweep.offset_ns.max() > 90_000_000
    np.testing.assert_allclose(lidar.scan_seconds(np.deg2rad([10.0, 0.0, 20.0])), [0.0, 1 / 360, 35 / 360])


@pytest.mark.parametrize("mount", [Mount(8.0, -5.0), Mount(180.0, 3.0), Mount(-20.0, 0.0, -70.0)])
def test_a_tilted_sensor_sees_the_same_world(mount):
    walk, lidar, sweeps = scanned(mount=mount)
    met = 0
    for start_s, (sweep, label) in zip(STARTS_S, sweeps, strict=True):
        elevation = np.degrees(np.arctan2(sweep.xyz[:, 2], np.hypot(sweep.xyz[:, 0], sweep.xyz[:, 1])))
        np.testing.assert_allclose(elevation, np.linspace(-15, 15, 16)[sweep.ring], atol=1e-4)
        wall = sweep.xyz[label == WALL] @ mount.rotation().T
        np.testing.assert_allclose(wall[:, 0], Scene().wall_x, atol=0.01)
        on = label == BOARD
        met += np.count_nonzero(on)
        poses = walk.poses(start_s + sweep.offset_ns[on] * 1e-9)
        from_apex = sweep.xyz[on] - lidar.seen(poses.apex)
        normal = lidar.seen(np.cross(poses.edge_left, poses.edge_right))
        assert np.abs(np.sum(from_apex * normal, axis=1)).max(initial=0.0) < 0.004
    assert met > 50


def test_rings_that_fire_less_often_have_wider_steps():
    _, _, sweeps = scanned(sensor="mixed128", mount=Mount(seam_deg=90.0))
    sweep, label = sweeps[0]
    for ring, step in ((40, 0.1), (20, 0.2)):
        xyz = sweep.xyz[(sweep.ring == ring) & (label != 0)].astype(float)
        apart = np.diff(np.sort(np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0]))))
        assert np.median(apart) == pytest.approx(step, abs=1e-3)


def test_boxes_stand_where_they_are_said_to_and_hide_what_is_behind():
    box = np.array([[20.0, 0.0, 0.3, 2.0, 0.9, 0.2, 1.6]])
    _, _, sweeps = scanned(scene=Scene(boxes=box))
    seen = np.concatenate([sweep.xyz[label == BOX] for sweep, label in sweeps]).astype(float)
    assert len(seen) > 100
    c, s = np.cos(0.3), np.sin(0.3)
    along = c * (seen[:, 0] - 20.0) + s * seen[:, 1]
    across = -s * (seen[:, 0] - 20.0) + c * seen[:, 1]
    height = seen[:, 2] - Scene().ground_z
    assert np.abs(along).max() < 2.005
    assert np.abs(across).max() < 0.905
    assert 0.19 < height.min() < height.max() < 1.605
    surface = np.minimum(np.minimum(2.0 - np.abs(along), 0.9 - np.abs(across)), 1.6 - height)
    assert np.abs(surface).max() < 0.01


def test_hands_are_at_the_lower_edges_and_hide_some_of_the_board():
    _, _, plain = scanned(sensor="os1-128")
    walk, _, gripped = scanned(sensor="os1-128", disturbances=Disturbances(hand_m=0.06))
    seen = [sum(np.count_nonzero(label == BOARD) for _, label in sweeps) for sweeps in (plain, gripped)]
    assert 0.7 * seen[0] < seen[1] < seen[0]
    poses = walk.poses(np.array(STARTS_S))
    from_apex = poses.hands[:, :, :3] - poses.apex[:, None]
    along = np.einsum("tha,ate->the", from_apex, np.stack([poses.edge_left, poses.edge_right]).transpose(2, 1, 0))
    assert along[:, :2].max(axis=2).min() > BOARD_EDGES_M[0] - 0.01  # on the edges away from the apex


def test_a_coat_is_wider_than_a_shirt():
    counts = []
    for torso_m in (0.13, 0.22):
        _, _, sweeps = scanned(sensor="os1-128", disturbances=Disturbances(torso_m=torso_m, body_behind_m=0.3))
        counts.append(sum(np.count_nonzero(label == PERSON) for _, label in sweeps))
    assert counts[1] > 1.1 * counts[0]
