"""Calibration files as other programs write them: the right values computed here, or a refusal that helps."""

from __future__ import annotations

import json
import time

import cv2
import numpy as np
import pytest

from tests.service.imports.test_read_files import matrix, read, refusal

# A camera that looks along the LiDAR's x, turned a little, with its place in metres.
TURN = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0] @ np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
T_CAMERA_LIDAR = np.block([[TURN, np.array([[0.1], [-0.2], [0.3]])], [np.zeros((1, 3)), np.ones((1, 1))]])
T_LIDAR_CAMERA = np.linalg.inv(T_CAMERA_LIDAR)
K = [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0]
SIZE = "image_width: 640\nimage_height: 480\n"


def flow(values) -> str:
    return str(np.ravel(values).tolist())


def opencv_matrix(name, values) -> str:
    values = np.atleast_2d(values)
    rows, columns = values.shape
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {flow(values)}\n"


def only(files, **more):
    (camera,) = read(files, **more).cameras
    return camera


def lens_of(files, **more):
    lens = only(files, **more).lens
    return lens.model, lens.K, lens.D, (lens.width, lens.height)


def is_mount(camera) -> bool:
    return bool(np.abs(matrix(camera.T_camera_lidar) - T_CAMERA_LIDAR).max() < 1e-9)


RADTAN = ("brown_conrady", K, [-0.1, 0.02, 0.001, 0.002, 0.0], (640, 480))
UNDISTORTED = ("brown_conrady", K, [0.0] * 5, (640, 480))
FISHEYE = ("kannala_brandt", K, [0.1, 0.02, 0.003, 0.0004], (640, 480))
RATIONAL = ("rational_polynomial", K, [0.1, 0.02, 0.001, 0.002, 0.03, 0.4, 0.05, 0.006], (640, 480))
FOCALS = "  fx: 500.0\n  fy: 510.0\n  cx: 320.0\n  cy: 240.0\n"
PLUMB = {"k1": -0.1, "k2": 0.02, "p1": 0.001, "p2": 0.002}
FOUR = {"k1": 0.1, "k2": 0.02, "k3": 0.003, "k4": 0.0004}
FOCAL = {"fx": 500.0, "fy": 510.0}
PINHOLE = FOCAL | {"cx": 320.0, "cy": 240.0}
WIDE = {"width": 640, "height": 480}
MATRIX = np.reshape(K, (3, 3)).tolist()
MATLAB = {"RadialDistortion": [-0.1, 0.02], "TangentialDistortion": [0.001, 0.002], "ImageSize": [480, 640]}
OPEN3D = WIDE | {"intrinsic_matrix": np.transpose(MATRIX).ravel().tolist()}
D = [-0.1, 0.02, 0.001, 0.002, 0.0]
SHARED = "Camera.width: 640\nCamera.height: 480\n"


def orb(prefix, kind, terms) -> str:
    lines = [f'Camera.type: "{kind}"' if kind else "", SHARED.strip(), "Viewer.PointSize:2"]
    lines += [f"{prefix}.{name}: {value}" for name, value in (PINHOLE | terms).items()]
    return "%YAML:1.0\n\n" + "\n".join(lines) + "\n"


LENSES = {
    "camodocal pinhole": (
        f"%YAML:1.0\n---\nmodel_type: PINHOLE\ncamera_name: camera\n{SIZE}distortion_parameters:\n   k1: -0.1\n"
        "   k2: 0.02\n"
        f"   p1: 1.0e-03\n   p2: 2.0e-03\nprojection_parameters:\n{FOCALS}",
        RADTAN,
    ),
    "camodocal pinhole full": (
        f"%YAML:1.0\n---\nmodel_type: PINHOLE_FULL\n{SIZE}distortion_parameters: {{k1: 0.1, k2: 0.02, p1: 0.001, "
        f"p2: 0.002, k3: 0.03, k4: 0.4, k5: 0.05, k6: 0.006}}\nprojection_parameters:\n{FOCALS}",
        RATIONAL,
    ),
    "camodocal Kannala-Brandt": (
        f"%YAML:1.0\n---\nmodel_type: KANNALA_BRANDT\n{SIZE}projection_parameters: {{k2: 0.1, k3: 0.02, k4: 0.003, "
        "k5: 0.0004, mu: 500.0, mv: 510.0, u0: 320.0, v0: 240.0}\n",
        FISHEYE,
    ),
    "ORB-SLAM2": (orb("Camera", "", PLUMB), RADTAN),
    "ORB-SLAM3 pinhole": (orb("Camera1", "PinHole", PLUMB | {"k3": 0.0}), RADTAN),
    "ORB-SLAM3 fisheye": (orb("Camera1", "KannalaBrandt8", FOUR), FISHEYE),
    "ORB-SLAM3 rectified": (orb("Camera1", "Rectified", {}), UNDISTORTED),
    "stella_vslam fisheye": (
        f"Camera:\n  model: fisheye\n  name: mono\n{FOCALS}  k1: 0.1\n  k2: 0.02\n  k3: 0.003\n  k4: 0.0004\n"
        "  cols: 640\n  rows: 480\nViewer: {point_size: 2}\n",
        FISHEYE,
    ),
    "stella_vslam perspective": (
        f"Camera:\n  model: perspective\n{FOCALS}  k1: -0.1\n  k2: 0.02\n  p1: 0.001\n  p2: 0.002\n  k3: 0.0\n"
        "  cols: 640\n  rows: 480\n",
        RADTAN,
    ),
    "Kalibr after a directive": (
        "%YAML:1.0\n\ncam0:\n  camera_model: pinhole\n  intrinsics: [500.0, 510.0, 320.0, 240.0]\n  "
        "distortion_model: radtan\n"
        f"  distortion_coeffs: [-0.1, 0.02, 0.001, 0.002]\n  resolution: [640, 480]\n  T_imu_cam: "
        f"{np.eye(4).tolist()}\n",
        RADTAN,
    ),
    "a byte order mark and tabs": (
        "\ufeff# lens\r\n%YAML 1.2\r\n---\r\nimage_width:\t640\r\nimage_height:\t480\r\n"
        "distortion_model:\tequidistant\r\n"
        f"K: {K}\r\nD:\t[0.1, 0.02, 0.003, 0.0004]\r\n",
        FISHEYE,
    ),
    "ost.txt": (
        "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[narrow_stereo]\n\ncamera matrix\n"
        "500.000000 0.000000 320.000000\n0.000000 510.000000 240.000000\n0.000000 0.000000 1.000000\n\ndistortion\n"
        "-0.100000 0.020000 0.001000 0.002000 0.000000\n\nrectification\n1.0 0.0 0.0\n0.0 1.0 0.0\n0.0 0.0 1.0\n\n"
        "projection\n480.0 0.0 321.0 0.0\n0.0 490.0 241.0 0.0\n0.0 0.0 1.0 0.0\n\n",
        RADTAN,
    ),
    "camera_calibration's fisheye in OpenCV's storage": (
        f"%YAML:1.0\n---\n{SIZE}distortion_model: equidistant\n"
        f"{opencv_matrix('camera_matrix', np.reshape(K, (3, 3)))}"
        f"{opencv_matrix('distortion_coefficients', [0.1, 0.02, 0.003, 0.0004])}",
        FISHEYE,
    ),
    "Autoware, a fisheye": (
        "%YAML:1.0\n---\n"
        + opencv_matrix("CameraExtrinsicMat", np.eye(4))
        + opencv_matrix("CameraMat", np.reshape(K, (3, 3)))
        + opencv_matrix("DistCoeff", [0.1, 0.02, 0.003, 0.0004])
        + "ImageSize: [640, 480]\nReprojection Error: 0.0\nDistModel: equidistant",
        FISHEYE,
    ),
    "livox_camera_calib": (
        "%YAML:1.0\n\n"
        + opencv_matrix("CameraMat", MATRIX)
        + opencv_matrix("DistCoeffs", D).replace("data: ", "data:")
        + SHARED,
        RADTAN,
    ),
    "R3LIVE": (
        f"r3live_vio:\n  image_width: 640\n  image_height: 480\n  camera_intrinsic: {K}\n"
        "  camera_dist_coeffs: [-0.1, 0.02, 0.001, 0.002, 0.0]\n  camera_ext_R: [1,0,0, 0,1,0, 0,0,1]\n"
        "  camera_ext_t: [0, 0, 0]\n",
        RADTAN,
    ),
    "a script's tolist": (
        json.dumps(WIDE | {"mtx": MATRIX, "dist": [D]}),
        RADTAN,
    ),
    "eight coefficients called plumb_bob": (
        f"{SIZE}camera: front\nCameraMat: {K}\nDistModel: plumb_bob\nDistCoeff: [0.1, 0.02, 0.001, 0.002, "
        f"0.03, 0.4, 0.05, 0.006]\n",
        RATIONAL,
    ),
    "MATLAB before R2022b": (
        json.dumps(MATLAB | {"IntrinsicMatrix": [[500, 0, 0], [0, 510, 0], [321, 241, 1]]}),
        RADTAN,
    ),
    "MATLAB's cameraIntrinsics": (
        json.dumps(
            MATLAB
            | {"FocalLength": [500, 510], "PrincipalPoint": [321, 241], "RadialDistortion": [-0.1, 0.02, 0.0]}
            | {"K": [[500, 0, 321], [0, 510, 241], [0, 0, 1]]}
        ),
        RADTAN,
    ),
    "Basalt, kb4": (
        json.dumps(
            {
                "value0": {
                    "T_imu_cam": [{"px": 0, "py": 0, "pz": 0, "qx": 0, "qy": 0, "qz": 0, "qw": 1}],
                    "intrinsics": [{"camera_type": "kb4", "intrinsics": PINHOLE | FOUR}],
                    "resolution": [[640, 480]],
                }
            }
        ),
        FISHEYE,
    ),
    "RealSense": (
        json.dumps(WIDE | FOCAL | {"ppx": 320.0, "ppy": 240.0, "model": "brown_conrady", "coeffs": D}),
        RADTAN,
    ),
    "Open3D, said to be undistorted": (
        json.dumps(OPEN3D | {"distortion_model": "none"}),
        UNDISTORTED,
    ),
    "Kimera": (
        "%YAML:1.0\n# General sensor definitions.\ncamera_id: left_cam\n\nT_BS:\n  cols: 4\n  rows: 4\n"
        f"  data: {flow(np.eye(4))}\nrate_hz: 20\nresolution: [640, 480]\ncamera_model: pinhole\n"
        "intrinsics: [500.0, 510.0, 320.0, 240.0] #fu, fv, cu, cv\ndistortion_model: equidistant\n"
        "distortion_coefficients: [0.1, 0.02, 0.003, 0.0004]\n",
        FISHEYE,
    ),
    "SVO and maplab": (
        "cameras:\n- camera:\n    label: cam0\n    image_height: 480\n    image_width: 640\n    type: pinhole\n"
        "    intrinsics:\n      cols: 1\n      rows: 4\n      data: [500.0, 510.0, 320.0, 240.0]\n"
        "    distortion:\n      type: equidistant\n      parameters:\n        cols: 1\n        rows: 4\n"
        "        data: [0.1, 0.02, 0.003, 0.0004]\n  T_B_C:\n    cols: 4\n    rows: 4\n"
        f"    data: {flow(np.eye(4))}\n",
        FISHEYE,
    ),
    "nerfstudio": (
        json.dumps(
            FOUR
            | {"camera_model": "OPENCV_FISHEYE", "w": 640, "h": 480, "fl_x": 500.0, "fl_y": 510.0}
            | {"cx": 320.0, "cy": 240.0, "frames": [{"transform_matrix": np.eye(4).tolist()}] * 3}
        ),
        FISHEYE,
    ),
    "terms within members": (
        f"front:\n  {SIZE.replace(chr(10), chr(10) + '  ')}camera_matrix: {PINHOLE}\n  distortion: {PLUMB}\n",
        RADTAN,
    ),
    "RealSense, without distortion": (
        json.dumps({"color": {**PINHOLE, "model": "distortion.inverse_brown_conrady", "coeffs": [0.0] * 5, **WIDE}}),
        UNDISTORTED,
    ),
    "FAST-LIVO2 for ROS 2": (
        "/**:\n  ros__parameters:\n    cam_model: Pinhole\n    cam_width: 640\n    cam_height: 480\n    scale: 0.5\n"
        "    cam_fx: 500.0\n    cam_fy: 510.0\n    cam_cx: 320.0\n    cam_cy: 240.0\n    cam_d0: -0.1\n    "
        "cam_d1: 0.02\n"
        "    cam_d2: 0.001\n    cam_d3: 0.002\n",
        RADTAN,
    ),
}


@pytest.mark.parametrize("program", LENSES)
def test_a_lens(program):
    text, expected = LENSES[program]
    model, K_read, D, size = lens_of({"lens.yaml": text})
    assert (model, size) == (expected[0], expected[3])
    assert K_read == pytest.approx(expected[1]) and pytest.approx(expected[2]) == D


ROWS = ["{:.12f},{:.12f},{:.12f},{:.12f}".format(*row) for row in T_CAMERA_LIDAR]


def ros_transform(parent, child, T) -> str:
    """T is the child's pose in its parent; the quaternion by OpenCV's rotation vector."""
    vector = cv2.Rodrigues(T[:3, :3])[0].ravel()
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle * np.sin(angle / 2)
    px, py, pz = T[:3, 3]
    return (
        (
            f"header: {{seq: 0, frame_id: {parent}}}\ntransform:\n  rotation: {{x: {x!r}, y: {y!r}, z: {z!r}, "
            f"w: {np.cos(angle / 2)!r}}}\n  translation: {{x: {px!r}, y: {py!r}, z: "
            f"{pz!r}}}\nchild_frame_id: {child}\n"
        )
        .replace("np.float64(", "")
        .replace(")", "")
    )


CALIBRATED = f"{SIZE}camera_matrix: {K}\ndistortion_model: plumb_bob\ndistortion_coefficients: {D}\n"
MOUNTS = {
    "FAST-Calib, several scenes": (
        "multi_calib_result.txt",
        f"# FAST-LIVO2 calibration format\nRcl: {flow(TURN)}\nPcl: {flow(T_CAMERA_LIDAR[:3, 3])}\n",
    ),
    "FAST-LIVO": (
        "avia.yaml",
        f"camera:\n  img_topic: /left\n  Rcl: {flow(TURN)}\n  Pcl: {flow(T_CAMERA_LIDAR[:3, 3])}\n",
    ),
    "KITTI-360": ("calib_cam_to_velo.txt", " ".join(map(repr, T_LIDAR_CAMERA[:3].ravel().tolist()))),
    "KITTI's velo_to_cam": (
        "calib_velo_to_cam.txt",
        "calib_time: 15-Mar-2012\n"
        + "".join(
            f"{name}: {' '.join(map(repr, np.ravel(part).tolist()))}\n"
            for name, part in (("R", TURN), ("T", T_CAMERA_LIDAR[:3, 3]))
        ),
    ),
    "livox_camera_calib, renamed": ("T_camera_lidar.txt", "\n".join(ROWS)),
    "Autoware": ("a.yaml", "%YAML:1.0\n---\n" + opencv_matrix("CameraExtrinsicMat", T_LIDAR_CAMERA)),
    "OpenVINS' spelling": ("a.yaml", f"T_cam0_lidar: {T_CAMERA_LIDAR.tolist()}\n"),
    "the other way round": ("a.json", json.dumps({"results": {"T_lidar_cam": T_LIDAR_CAMERA.ravel().tolist()}})),
    "VINS' spelling": ("a.yaml", "%YAML:1.0\n" + opencv_matrix("lidar_T_cam0", T_LIDAR_CAMERA)),
    "by a word": ("a.yaml", f"lidar2camera: {T_CAMERA_LIDAR[:3].tolist()}\n"),
    "rotation and translation": (
        "a.yaml",
        f"cam_to_lidar:\n  rotation: {T_LIDAR_CAMERA[:3, :3].tolist()}\n  translation: "
        f"{flow(T_LIDAR_CAMERA[:3, 3])}\n",
    ),
    "a pose in a file whose name has its direction": (
        "lidar_to_camera.json",
        json.dumps({"translation": dict(zip("xyz", T_CAMERA_LIDAR[:3, 3], strict=True)), "rotation": TURN.tolist()}),
    ),
    "Apollo": ("front_6mm_extrinsics.yaml", ros_transform("velodyne128", "front_6mm", T_LIDAR_CAMERA)),
    "tf2's echo": (
        "tf.yaml",
        "transforms:\n- " + ros_transform("camera_optical", "os_lidar", T_CAMERA_LIDAR).replace("\n", "\n  "),
    ),
}


@pytest.mark.parametrize("program", MOUNTS)
def test_a_mount_alone_and_with_a_lens_of_another_file(program):
    name, text = MOUNTS[program]
    alone = read({name: text})
    (camera,) = alone.cameras
    assert camera.lens is None and is_mount(camera) and not camera.doubts
    assert any("no lens: send the file" in note for note in alone.notes)
    both = only({"lens.yaml": CALIBRATED, name: text})
    assert is_mount(both) and both.lens.K == K


def test_a_mount_beside_its_lens():
    single = LENSES["FAST-LIVO2 for ROS 2"][0].split("parameters:\n")[1].replace("    ", "")
    assert is_mount(only({"single_calib_result.txt": single + MOUNTS["FAST-Calib, several scenes"][1]}))
    # As the refusals ask for it.
    assert is_mount(only({"a.yaml": CALIBRATED + f"T_camera_lidar: {flow(T_CAMERA_LIDAR)}\n"}))


def test_kitti_360():
    R_rect = cv2.Rodrigues(np.array([0.0, 0.01, 0.0]))[0]

    def line(name, values):
        return f"{name}: {' '.join(f'{value:.12e}' for value in np.ravel(values))}\n"

    perspective = line("S_00", [1408, 376]) + line("K_00", K) + line("D_00", [-0.1, 0.02, 0.001, 0.002, 0])
    perspective += line("R_00", np.eye(3)) + line("T_00", np.zeros(3)) + line("S_rect_00", [1408, 376])
    perspective += line("R_rect_00", R_rect) + line("P_rect_00", np.hstack([np.reshape(K, (3, 3)), np.zeros((3, 1))]))
    files = {
        "perspective.txt": perspective,
        "calib_cam_to_velo.txt": MOUNTS["KITTI-360"][1],
        "calib_cam_to_pose.txt": line("image_00", T_CAMERA_LIDAR[:3]),
        "calib_sick_to_velo.txt": MOUNTS["KITTI-360"][1],
    }
    contents = read(files)
    cameras = {camera.name: camera for camera in contents.cameras}
    assert is_mount(cameras["00"]) and sum("is left out: by its name" in note for note in contents.notes) == 2
    rectified = np.eye(4)
    rectified[:3, :3] = R_rect
    assert np.abs(matrix(cameras["rect_00"].T_camera_lidar) - rectified @ T_CAMERA_LIDAR).max() < 1e-9
    # The IMU's file has R and T as the camera's has them.
    imu = {"a.txt": perspective, "calib_imu_to_velo.txt": line("R", np.eye(3)) + line("T", [1, 2, 3])}
    assert all(camera.T_camera_lidar is None for camera in read(imu).cameras)


def test_several_cameras_of_one_file():
    text = LENSES["ORB-SLAM3 pinhole"][0] + "Camera2.fx: 400.0\nCamera2.fy: 400.0\nCamera2.cx: 320\nCamera2.cy: 240\n"
    text += "Camera2.k1: 0.1\nCamera2.k2: 0.0\nCamera2.p1: 0.0\nCamera2.p2: 0.0\n"
    cameras = {camera.name: camera.lens for camera in read({"a.yaml": text}).cameras}
    assert (cameras["Camera1"].K[0], cameras["Camera2"].K[0], cameras["Camera2"].D[0]) == (500.0, 400.0, 0.1)


MEI = (
    f"%YAML:1.0\n---\nmodel_type: MEI\n{SIZE}mirror_parameters: {{xi: 2.2}}\ndistortion_parameters: "
    f"{{k1: 0.01, k2: 0.1, p1: 0, p2: 0}}\n"
    "projection_parameters: {gamma1: 1300.0, gamma2: 1300.0, u0: 320.0, v0: 240.0}\n"
)
SENSOR = {"token": "a", "sensor_token": "b", "translation": [1.7, 0, 1.5], "rotation": [0.5, -0.5, 0.5, -0.5]}
ASKED = {
    "a matrix without distortion": (
        json.dumps({"K": K, "width": 640, "height": 480}),
        ["no distortion under a known name", "K, width, height", "distortion_model: none"],
    ),
    "Open3D": (
        json.dumps(OPEN3D),
        ["no distortion under a known name", "intrinsic_matrix"],
    ),
    "Waymo": (
        json.dumps({"name": "FRONT", "intrinsic": [2000.0, 2000.0, 960.0, 640.0, 0.03, *[0.0] * 4], **WIDE}),
        ["has no camera matrix", "name (FRONT), intrinsic, width, height"],
    ),
    "Argoverse": (
        json.dumps(
            {"camera_data_": [{"key": "ring", "value": {"focal_length_x_px_": 1400.0, "distortion_": [0.1]}}]}
        ),
        ["has no camera matrix", "camera_data_.0.value.focal_length_x_px_"],
    ),
    "a distortion of another name": (
        f"%YAML:1.0\n---\n{SIZE}{opencv_matrix('camera_matrix', np.reshape(K, (3, 3)))}lensWarp: [0.1, 0.2, "
        f"0, 0, 0]\n",
        ["no distortion under a known name", "lensWarp"],
    ),
    "camera_info without D": (
        f"{SIZE}K: {K}\ndistortion_model: plumb_bob\nd_vec: [0.1]\n",
        ["no distortion under a known name", "d_vec"],
    ),
    "Kalibr without coefficients": (
        "cam0: {camera_model: pinhole, intrinsics: [500, 510, 320, 240], distortion_model: radtan, "
        "resolution: [640, 480]}",
        ["no distortion under a known name"],
    ),
    "stereo_calib without D2": (f"M1: {K}\nM2: {K}\nD1: [0, 0, 0, 0]\n", ["no distortion under a known name"]),
    "vikit with other coefficients": (
        LENSES["FAST-LIVO2 for ROS 2"][0].replace("cam_d", "cam_q"),
        ["no distortion under a known name", "cam_q0"],
    ),
    "vikit with a fifth": (
        LENSES["FAST-LIVO2 for ROS 2"][0] + "    cam_d5: 0.3\n",
        ["has the coefficients d0, d1, d2, d3, d5", "d0, d1, d2, d3, d4"],
    ),
    "ORB-SLAM3 without distortion": (orb("Camera1", "PinHole", {}), ["no distortion under a known name"]),
    "k1 to k4 without a model": (
        f"{SIZE}{FOCALS.replace('  ', '')}k1: 0.1\nk2: 0.1\nk3: 0.1\nk4: 0.1\n",
        ["the model plumb_bob takes k1, k2, p1, p2, k3"],
    ),
    "camodocal MEI": (MEI, ["distortion model 'MEI', which is not supported"]),
    "RealSense's inverse model": (
        LENSES["RealSense"][0].replace("brown_", "inverse_brown_"),
        ["'inverse_brown_conrady', which is not supported"],
    ),
    "Autoware, a model that there is not": (
        LENSES["Autoware, a fisheye"][0].replace("equidistant", "omni"),
        ["distortion model 'omni'"],
    ),
    "A2D2": (
        json.dumps(
            {"CamMatrix": MATRIX, "CamMatrixOriginal": [[600, 0, 330], [0, 600, 240], [0, 0, 1]], "Distortion": [D]}
        ),
        ["several camera matrices: CamMatrix, CamMatrixOriginal"],
    ),
    "nuScenes": (
        json.dumps([SENSOR | {"camera_intrinsic": MATRIX}, SENSOR | {"camera_intrinsic": []}]),
        ["poses or names of nuScenes' sensors, not both", "sensor.json together"],
    ),
    "VINS' main file": (
        '%YAML:1.0\nimu: 1\ncam0_calib: "cam0_mei.yaml"\n' + opencv_matrix("body_T_cam0", np.eye(4)),
        ["body_T_cam0: no direction", "cam0_calib (cam0_mei.yaml)"],
    ),
    "easy_handeye": (
        "parameters: {eye_on_hand: false}\ntransformation: {qw: 1.0, qx: 0.0, qy: 0.0, qz: 0.0, x: 0.1, y: "
        "0.2, z: 0.3}\n",
        ["parameters.eye_on_hand", "transformation.qw"],
    ),
    "ZED": ("[LEFT_CAM_HD]\nfx=500\nfy=510\ncx=320\ncy=240\nk1=-0.1\n", ["It begins with '[LEFT_CAM_HD]'"]),
    "COLMAP": (
        "# Camera list\n1 OPENCV 640 480 500 510 320.5 240.5 -0.1 0.02 0.001 0.002\n",
        ["holds no named values", "# Camera list"],
    ),
    "four of ost.txt": (
        LENSES["ost.txt"][0].replace("0.002000 0.000000", "0.002000"),
        ["does not say their distortion model", "ost.yaml"],
    ),
}


@pytest.mark.parametrize("program", ASKED)
def test_what_is_missing_is_asked_for(program):
    text, says = ASKED[program]
    refused = refusal({"file.yaml": text})
    assert all(each in refused for each in says), refused


def test_long_names_take_no_time():
    began = time.process_time()
    refusal({"a.json": json.dumps({"to" * 12_000 + "\n": [0.0] * 16, "_T" * 12_000: [0.0] * 16})})
    assert time.process_time() - began < 2.0


def test_a_mount_whose_direction_nobody_states_is_asked_for():
    refused = refusal({"extrinsic.txt": "\n".join(ROWS)})
    assert "no direction between LiDAR and camera is stated" in refused and "T_camera_lidar" in refused
    parts = f"camera_ext_R: {flow(TURN)}\ncamera_ext_t: {flow(T_CAMERA_LIDAR[:3, 3])}\n"
    contents = read({"r3live.yaml": CALIBRATED + parts})
    assert contents.cameras[0].T_camera_lidar is None and "camera_ext_R: no direction" in " ".join(contents.notes)
    # Autoware's camera calibration writes the identity.
    contents = read({"a.yaml": LENSES["Autoware, a fisheye"][0]})
    assert contents.cameras[0].T_camera_lidar is None and "is the identity" in " ".join(contents.notes)


@pytest.mark.parametrize("R", [T_LIDAR_CAMERA[:3, :3], np.eye(3)], ids=["inverted", "body"])
def test_a_mount_that_leads_the_other_way_or_into_the_body_is_doubted(R):
    rows = np.hstack([R, np.full((3, 1), 0.1)])
    (doubt,) = only({"a.yaml": f"T_camera_lidar: {rows.tolist()}\n"}).doubts
    assert "does the transform lead the other way" in doubt


@pytest.mark.parametrize("text", ["cam:\n  1: 2\n", "cam:\n  on: 2\n  fx: 500\n", "- {1: 2}\n- {b: 2}\n"])
def test_keys_that_are_no_text_are_refused_in_words(text):
    assert "holds" in refusal(text)
