"""Files of other programs: what they hold in our conventions, what is implausible of it, and clear refusals."""

from __future__ import annotations

import json
import time

import cv2
import numpy as np
import pytest

from apexcal.documents.imports import CalibrationFiles
from service.exports.calibrated import file_name
from service.exports.formats import FORMATS
from service.imports.formats import files_view
from service.platform.http.problems import Problem
from tests.service.exports.readers import files_of
from tests.service.exports.rigs import rig_of
from tests.support.places import DATA

K = [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0]
CAMERA_CALIBRATION = f"""
image_width: 640
image_height: 480
camera_name: front
camera_matrix: {{rows: 3, cols: 3, data: {K}}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [-0.1, 0.02, 1e-05, 0.002, 0]}}
"""
ECHOED = f"""
header: {{frame_id: camera}}
height: 480
width: 640
distortion_model: plumb_bob
d: [-0.1, 0.02, 1.0e-05, 0.002, 0.0]
k: {K}
---
header: {{frame_id: camera}}
"""
CAMCHAIN = """
cam0:
  camera_model: pinhole
  intrinsics: [500.0, 510.0, 320.0, 240.0]
  distortion_model: equidistant
  distortion_coeffs: [0.01, 0.002, 0.0, 0.0]
  resolution: [640, 480]
  rostopic: /rig/front/image_raw
cam1:
  camera_model: omni
  intrinsics: [1.0, 500.0, 510.0, 320.0, 240.0]
  T_cn_cnm1: [[1, 0, 0, -0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""

DIRECT = (
    "camera: {{camera_model: plumb_bob, distortion_coeffs: [0, 0, 0, 0, 0], intrinsics: [500, 510, 320, 240]}}\n"
    "results: {{T_lidar_camera: {}}}"
)


def read(files, **asked):
    if isinstance(files, str):
        files = {"lens.yaml": files}
    return files_view(CalibrationFiles(files=files, **asked))


def refusal(files, **asked) -> str:
    with pytest.raises(Problem) as found:
        read(files, **asked)
    assert (found.value.status, found.value.code) == (422, "calibration_file_not_read")
    return f"{found.value.detail} {found.value.hint}"


def only_lens(files, **asked):
    (camera,) = read(files, **asked).cameras
    return camera.lens


def matrix(mount) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = mount.rotation.matrix, mount.translation_m
    return T


@pytest.mark.parametrize("text", [CAMERA_CALIBRATION, ECHOED, ECHOED.replace("d: [", "D: [").replace("k: [", "K: [")])
def test_what_ros_writes(text):
    lens = only_lens(text)
    assert (lens.width, lens.height, lens.distortion_model, lens.K) == (640, 480, "plumb_bob", K)
    assert (lens.D, lens.model) == ([-0.1, 0.02, 1e-5, 0.002, 0.0], "brown_conrady")


def test_what_kalibr_writes():
    found = read(CAMCHAIN)
    assert found.format == "kalibr" and "cam1 is left out" in found.notes[0]
    (camera,), (between,) = found.cameras, found.camera_transforms
    assert (camera.name, camera.topic, camera.lens.K) == ("cam0", "/rig/front/image_raw", K)
    assert camera.lens.model == "kannala_brandt" and camera.T_camera_lidar is None
    assert (between.to_frame, between.from_frame, between.translation_m) == ("cam1", "cam0", [-0.2, 0.0, 0.0])


@pytest.mark.parametrize("model", ["pinhole", "brown_conrady", "kannala_brandt"])
@pytest.mark.parametrize("name", ["camera_info", "opencv", "kalibr", "kitti", "fast_livo2", "direct_visual"])
def test_what_we_write_is_read_to_the_same_bits(name, model):
    if name == "kitti" and model == "kannala_brandt":
        return
    less = {} if FORMATS[name].third_radial or model != "brown_conrady" else {"k5": 0.0}
    calibrated = rig_of(model, 0, **less)
    files = {one: text.decode() for one, text in files_of(name, calibrated).items()}
    if name in ("camera_info", "opencv"):
        found = [camera for one in sorted(files) for camera in read({one: files[one]}).cameras]
        order = sorted(calibrated.cameras, key=lambda one: one.name)
    elif name in ("kitti", "fast_livo2", "direct_visual"):
        folders = [
            {one: text for one, text in files.items() if one.startswith(f"{file_name(camera.name)}/")}
            for camera in calibrated.cameras
        ]
        size = (calibrated.cameras[0].width, calibrated.cameras[0].height)
        stated = {"image_size": size} if name == "direct_visual" else {}
        found, order = [read(folder, **stated).cameras[0] for folder in folders], calibrated.cameras
    else:
        found = [one for one in read(files).cameras if not one.name.startswith("rect")]
        order = calibrated.cameras
    assert len(found) == 3
    for camera, ours in zip(found, order, strict=True):
        assert [value for row in ours.K for value in row] == camera.lens.K and not camera.doubts
        assert (camera.lens.width, camera.lens.height) == (ours.width, ours.height)
        coefficients = ours.D if FORMATS[name].third_radial else ours.D[:4]
        assert camera.lens.D[: len(coefficients)] == coefficients and not any(camera.lens.D[len(coefficients) :])
        if name not in ("camera_info", "kalibr"):
            assert np.abs(matrix(camera.T_camera_lidar) - ours.T_camera_lidar.matrix).max() < 1e-12
    if name == "opencv":
        assert found[0].T_camera_lidar.from_frame == "velodyne"


def test_what_euroc_writes():
    sensor = """
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.7e-05]
"""
    contents = read(sensor)
    (camera,) = contents.cameras
    assert contents.format == "euroc" and "T_BS: no direction" in contents.notes[0] and camera.T_camera_lidar is None
    assert (camera.lens.model, camera.lens.K[0], camera.lens.width) == ("brown_conrady", 458.654, 752)
    assert camera.lens.D[:4] == [-0.28, 0.07, 0.0002, 1.7e-05]


def storage(**matrices) -> str:
    text = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, values in matrices.items():
        text.write(name, np.array(values))
    return text.releaseAndGetString()


def test_what_opencvs_stereo_calibration_writes():
    """By OpenCV itself: two files, which belong together; R and T lead from the first camera into the second."""
    M, D, turn = (
        np.array(K).reshape(3, 3),
        np.array([[-0.1, 0.02, 0.0, 0.0, 0.0]]),
        cv2.Rodrigues(np.array([0, 0.1, 0]))[0],
    )
    files = {
        "intrinsics.yml": storage(M1=M, D1=D, M2=M, D2=0.5 * D),
        "extrinsics.yml": storage(R=turn, T=np.array([[-0.12], [0.0], [0.01]]), Q=np.eye(4)),
    }
    contents = read(files, image_size=(640, 480))
    assert contents.format == "opencv_stereo"
    assert [camera.name for camera in contents.cameras] == ["1", "2"]
    assert [camera.lens.D[0] for camera in contents.cameras] == [-0.1, -0.05]
    (between,) = contents.camera_transforms
    assert (between.to_frame, between.from_frame, between.translation_m) == ("2", "1", [-0.12, 0.0, 0.01])
    assert np.allclose(matrix(between)[:3, :3], turn, atol=1e-12)


def test_what_sensors_calibration_writes():
    turned = [[0.0, -1.0, 0.0, 0.1], [0.0, 0.0, -1.0, 0.2], [1.0, 0.0, 0.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
    between = {"sensor_name": "top_lidar", "target_sensor_name": "front", "param_type": "extrinsic"}
    lens = {"sensor_name": "front", "target_sensor_name": "front", "param_type": "intrinsic"}
    size = {"img_dist_w": 640, "img_dist_h": 480}
    terms = {"cam_K": {"data": [K[:3], K[3:6], K[6:]]}, "cam_dist": {"data": [[-0.1, 0.1, 0.001, 0.002]]}}
    files = {
        "a.json": json.dumps(
            {"top_lidar-to-front-extrinsic": {**between, "param": {"sensor_calib": {"data": turned}}}}
        ),
        "b.json": json.dumps({"front-intrinsic": {**lens, "param": {**size, **terms}}}),
    }
    contents = read(files)
    (camera,) = contents.cameras
    assert (contents.format, camera.name) == ("sensors_calibration", "front")
    assert (camera.lens.K, camera.lens.width) == (K, 640)
    assert camera.T_camera_lidar.from_frame == "top_lidar" and (matrix(camera.T_camera_lidar) == turned).all()


def test_rectified_cameras_of_kitti_are_where_its_devkit_projects_to():
    """P_rect R_rect_00 (R|T) X of the devkit, and our lens and mount."""
    random = np.random.default_rng(3)
    R, _ = np.linalg.qr(random.normal(size=(3, 3)))
    R *= np.sign(np.linalg.det(R))
    R_rect, _ = np.linalg.qr(np.eye(3) + 0.01 * random.normal(size=(3, 3)))
    R_rect *= np.sign(np.diag(R_rect))
    T = np.array([-0.01, -0.07, -0.27])
    plain = np.array([[720.0, 0.0, 610.0], [0.0, 720.0, 172.0], [0.0, 0.0, 1.0]])
    P = plain @ np.hstack([np.eye(3), [[-0.53], [0.001], [0.002]]])

    def line(name, values):
        return f"{name}: {' '.join(map(repr, np.ravel(values).tolist()))}\n"

    velo = "calib_time: 15-Mar-2012 11:37:16\n" + line("R", R) + line("T", T)
    raw = line("S_00", [1392.0, 512.0]) + line("K_00", plain) + line("D_00", np.zeros(5))
    raw += line("S_rect_00", [1242.0, 375.0]) + line("R_rect_00", R_rect) + line("P_rect_00", P)
    object_calib = line("P0", P) + line("R0_rect", R_rect) + line("Tr_velo_to_cam", np.hstack([R, T[:, None]]))
    X = random.uniform(-5, 5, (50, 3))
    expected = (X @ R.T + T) @ R_rect.T @ P[:, :3].T + P[:, 3]
    expected = expected[:, :2] / expected[:, 2:]
    rectified = {one.name: one for one in read({"a.txt": velo, "b.txt": raw}).cameras}["rect_00"]
    (of_object,) = read({"calib.txt": object_calib}, image_size=(1242, 375)).cameras
    for camera in (rectified, of_object):
        assert (camera.lens.width, camera.lens.height, camera.lens.D) == (1242, 375, [0.0] * 5)
        M = matrix(camera.T_camera_lidar)
        seen = X @ M[:3, :3].T + M[:3, 3]
        k = np.array(camera.lens.K).reshape(3, 3)
        ours = seen @ k.T
        assert np.abs(ours[:, :2] / ours[:, 2:] - expected).max() < 1e-7
    assert "image_size" in refusal({"calib.txt": object_calib})


@pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not here")
def test_real_files():
    opencv = only_lens({"left.yml": (DATA / "chessboard" / "left_intrinsics.yml").read_text()})
    assert opencv.K[0] == 535.91573396163199 and opencv.D[4] == 0.23839153080878486 and opencv.width == 640
    ros = read({"camera_info.yaml": (DATA / "vlp16-diamond-board" / "camera_info.yaml").read_text()}).cameras[0]
    assert ros.lens.model == "kannala_brandt" and not ros.doubts


def test_opencv_in_json_and_without_a_size():
    text = json.dumps(
        {
            "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": K},
            "distortion_coefficients": [0.1, 0.02, 0.0, 0.0],
            "fisheye_model": 1,
        }
    )
    lens = only_lens(text, image_size=(640, 480))
    assert (lens.model, lens.width) == ("kannala_brandt", 640)
    assert "says no image size" in refusal(text)


def test_a_lens_for_another_image_size():
    assert "Scale K" in refusal(CAMERA_CALIBRATION, image_size=(1280, 960))
    assert "Exchange width and height" in refusal(CAMERA_CALIBRATION, image_size=(480, 640))


@pytest.mark.parametrize(
    ("change", "doubt"),
    [
        (("320.0", "900.0"), "principal point (900, 240) lies outside"),
        (("500.0", "5.0"), "outside of 0.2 to 3 image widths"),
        (("-0.1, 0.02", "-0.9, 0.02"), "stops growing at 0."),
    ],
)
def test_what_is_implausible_is_doubted(change, doubt):
    (camera,) = read(CAMERA_CALIBRATION.replace(*change)).cameras
    assert any(doubt in one for one in camera.doubts)
    assert not read(CAMERA_CALIBRATION).cameras[0].doubts


def test_a_mount_in_millimetres_is_doubted_and_one_that_mirrors_refused():
    calibrated = rig_of("pinhole", 0)
    name, text = next(iter(files_of("opencv", calibrated).items()))
    T = calibrated.cameras[0].T_camera_lidar
    far = text.decode().replace(repr(float(T.t[0])), "812.0")
    assert any("in metres?" in one for one in read({name: far}).cameras[0].doubts)
    head, tail = text.decode().rsplit("data: [", 1)
    numbers = tail.split(",")
    flipped = head + "data: [" + ",".join([str(-float(one)) for one in numbers[:3]] + numbers[3:])
    assert "mirrors" in refusal({name: flipped})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (CAMCHAIN.replace("camera_model: pinhole", "camera_model: eucm"), "no camera with a supported model"),
        (CAMCHAIN.replace("distortion_model: equi", "model: equi"), "has no distortion_model"),
        (CAMERA_CALIBRATION.replace("plumb_bob", "fov"), "is of the distortion model 'fov'"),
        (CAMERA_CALIBRATION.replace("500.0", ".nan"), "holds nan"),
        (CAMERA_CALIBRATION.replace("500.0", "true"), "holds True"),
        (CAMERA_CALIBRATION.replace("image_width: 640", "image_width: .inf"), "holds inf"),
        (CAMERA_CALIBRATION.replace("0.002, 0]", "0.002, 0, 0.3]"), "the further ones are not zero"),
        (CAMERA_CALIBRATION.replace("500.0", "0.0"), "no camera matrix"),
        ("image_width: 640", "has no camera matrix and no mount under a name that is read. It holds image_width."),
        ("[1, 2]", "holds no named values"),
        ("", "holds no named values"),
        ("a: [", "is no YAML"),
        ("<?xml version='1.0'?><opencv_storage/>", "is XML"),
        ("!!python/object/apply:os.system ['true']", "is no YAML"),
        ("a: &a [1]\nb: *a", "YAML aliases"),
        ("K_00: 1 2 3 4 5 6 7 8 9\n", "There is no D_00"),
        ("a: !!bool x", "is no YAML"),
        ("a: !!int ''", "is no YAML"),
        ("a: !!timestamp x", "is no YAML"),
        ("a: 1" + ":1" * 20_000, "has a value of 40001 letters"),
        ("K_00: 5 0 3 0 5 2 0 0 1\nD_00: 0 0 0 0 0\nS_00: 0 0\n", "images of 00 are 0 x 0"),
        ("camera: {camera_model: plumb_bob, distortion_coeffs: [0, 0, 0, 0, 0]}", "has no four intrinsics"),
        (DIRECT.format([0.0] * 7), "is no pose"),
        (DIRECT.format([0.0] * 6), "has 6 numbers, not 7"),
        ("cam_model: Ocam", "It holds cam_model (Ocam)"),
        ("cam_model: Pinhole", "It holds cam_model (Pinhole)"),
        ("x: {param_type: extrinsic, param: {}}", "neither a cam_K nor a sensor_calib"),
        ("extrin_calib: {Rcl: [1, 0, 0, 0, 2, 0, 0, 0, 1], Pcl: [0, 0, 0]}", "cannot be used"),
        (f"P0:{' 0' * 12}\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n", "no focal length"),
    ],
)
def test_what_is_no_calibration_is_refused(text, says):
    assert says in refusal(text)


def test_a_bomb_of_aliases_ends_at_once():
    lines = ["a0: &a0 {x: 1, y: 2}"]
    lines += [f"a{n}: &a{n}\n  <<: [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)]
    assert "YAML aliases" in refusal("\n".join(lines))


def test_deep_nesting_is_refused_before_it_is_built():
    # Libyaml's composer would overflow the stack, and with it end the process.
    assert "nested more than" in refusal("a: " + "[" * 29_000 + "]" * 29_000)


def test_a_line_of_blanks_takes_no_time():
    began = time.process_time()
    assert refusal("a" + " " * 50_000 + "x")
    assert time.process_time() - began < 2.0


def test_several_files_are_one_calibration_only_where_they_belong_together():
    assert "are not one camera's lens and its mount" in refusal(
        {"a.yaml": CAMERA_CALIBRATION, "b.yaml": CAMERA_CALIBRATION}
    )
    assert "It holds other" in refusal({"a.yaml": CAMERA_CALIBRATION, "b.yaml": "other: 1"})
