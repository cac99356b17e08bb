import cv2
import numpy as np
import pytest

from apexcal.documents.camera_models import CAMERA_MODELS
from workers.simulation.camera import LENSES, make_camera


def cv2_pixels(model, intrinsics, T_camera_lidar, points):
    k = intrinsics
    matrix = np.array([[k["f_x"], 0, k["c_x"]], [0, k["f_y"], k["c_y"]], [0, 0, 1]])
    rotation, _ = cv2.Rodrigues(T_camera_lidar.R)
    if model == "kannala_brandt":
        bend = np.array([k["k1"], k["k2"], k["k3"], k["k4"]])
        found, _ = cv2.fisheye.projectPoints(points[:, None], rotation, T_camera_lidar.t, matrix, bend)
    else:
        bend = np.array([k[name] for name in CAMERA_MODELS[model].distortion])
        found, _ = cv2.projectPoints(points, rotation, T_camera_lidar.t, matrix, bend)
    return found.reshape(-1, 2)


@pytest.mark.parametrize("model", LENSES)
def test_every_lens_projects_as_opencv_does_and_has_rays_back(model):
    camera = make_camera(model, seed=5)
    random = np.random.default_rng(0)
    pixels = random.uniform((0, 0), (959, 599), (200, 2))
    points = camera.centre() + 7.0 * camera.rays(pixels)
    np.testing.assert_allclose(camera.project(points), pixels, atol=1e-6)
    expected = cv2_pixels(model, camera.intrinsics, camera.T_camera_lidar, points)
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-6)


def test_the_scanned_apex_is_where_the_sensor_looked_at_that_moment(short):
    sweeps = short.truth["sweeps"]
    apex = np.array(sweeps["scan_apex_xyz"])
    after_s = (np.array(sweeps["scan_ns"]) - np.array(sweeps["stamp_ns"])) * 1e-9
    looked_at = np.radians(short.rig.options.sector_deg) - 2 * np.pi * 10.0 * after_s
    np.testing.assert_allclose(np.arctan2(apex[:, 1], apex[:, 0]), looked_at, atol=1e-5)
    assert np.linalg.norm(apex - np.array(sweeps["apex_xyz"]), axis=1).max() < 0.1
