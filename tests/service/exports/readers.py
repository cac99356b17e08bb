"""How other programs read the exports, written from their formats' documentation and with their own readers.

Each reader answers, for every camera by its place, a function from LiDAR points (n, 3) to pixels (n, 2).
"""

from __future__ import annotations

import io
import json
import shlex
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import strptime
from xml.etree import ElementTree

import cv2
import numpy as np
import pykitti
import raillabel
import yaml
from pyquaternion import Quaternion
from scipy.spatial.transform import Rotation
from urdf_parser_py.urdf import URDF
from vcd.core import OpenLABEL
from vcd.scl import Scene

from service.exports.calibrated import Calibrated, CalibratedCamera, file_name
from service.exports.formats import FORMATS, export

Projection = Callable[[np.ndarray], np.ndarray]


def files_of(name: str, calibrated: Calibrated) -> dict[str, bytes]:
    made = export(FORMATS[name], calibrated)
    if not made.name.endswith(".zip"):
        return {made.name: made.content}
    with zipfile.ZipFile(io.BytesIO(made.content)) as archive:
        return {one: archive.read(one) for one in archive.namelist()}


def only(files: dict[str, bytes], end: str) -> bytes:
    (found,) = [content for name, content in files.items() if name.endswith(end)]
    return found


def rigid(R, t) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def move(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


def plumb_bob(points: np.ndarray, K: np.ndarray, D) -> np.ndarray:
    zero = np.zeros(3)
    return cv2.projectPoints(points[:, None].copy(), zero, zero, K, np.array(D, np.float64))[0][:, 0]


def fisheye(points: np.ndarray, K: np.ndarray, D) -> np.ndarray:
    zero = np.zeros(3)
    return cv2.fisheye.projectPoints(points[:, None].copy(), zero, zero, K, np.array(D, np.float64))[0][:, 0]


def by_camera_info(text: bytes, camera: CalibratedCamera) -> Projection:
    """sensor_msgs/CameraInfo: K by rows; plumb_bob k1 k2 t1 t2 k3, rational_polynomial with k4 k5 k6 behind them,
    equidistant k1 k2 k3 k4; P of rectified images."""
    said = yaml.safe_load(text)
    K = np.array(said["camera_matrix"]["data"], np.float64).reshape(3, 3)
    D = np.array(said["distortion_coefficients"]["data"], np.float64)
    assert all(isinstance(one, float) for one in said["distortion_coefficients"]["data"])
    assert said["distortion_coefficients"]["rows"] * said["distortion_coefficients"]["cols"] == len(D)
    P = np.array(said["projection_matrix"]["data"]).reshape(3, 4)
    assert (P[:, :3] == K).all() and (np.array(said["rectification_matrix"]["data"]).reshape(3, 3) == np.eye(3)).all()
    assert K[0, 1] == 0.0, "image_geometry takes four of the nine"
    models = {"plumb_bob": (plumb_bob, 5), "rational_polynomial": (plumb_bob, 8), "equidistant": (fisheye, 4)}
    model = models[said["distortion_model"]]
    assert len(D) == model[1] and (said["image_width"], said["image_height"]) == (camera.width, camera.height)
    return lambda points: model[0](points, K, D)


def ros_camera_info(calibrated: Calibrated) -> list[Projection]:
    """The lens alone; the mount is ours."""
    files = files_of("camera_info", calibrated)
    found = []
    for camera, name in _of_cameras(files, ".yaml", calibrated):
        lens, T = by_camera_info(files[name], camera), camera.T_camera_lidar.matrix
        found.append(lambda points, lens=lens, T=T: lens(move(T, points)))
    return found


def _of_cameras(files: dict[str, bytes], end: str, calibrated: Calibrated) -> list[tuple[CalibratedCamera, str]]:
    named = [
        (camera, next(name for name in files if file_name(camera.name) in name and name.endswith(end)))
        for camera in calibrated.cameras
    ]
    assert len({name for _, name in named}) == len(calibrated.cameras)
    return named


def _tree(edges: dict[tuple[str, str], np.ndarray], to: str, start: str = "velodyne") -> np.ndarray:
    """``T_to_start`` where an edge (parent, child) holds the child's pose: p_parent = T p_child."""
    both = edges | {(child, parent): np.linalg.inv(T) for (parent, child), T in edges.items()}
    found, waiting = {start: np.eye(4)}, [start]
    while waiting:
        here = waiting.pop()
        for (into, of), T in both.items():
            if of == here and into not in found:
                found[into] = T @ found[here]
                waiting.append(into)
    return found[to]


def published(said: str) -> tuple[tuple[str, str], np.ndarray]:
    """The arguments of tf2_ros static_transform_publisher: the child's pose in the frame, quaternions x y z w."""
    words = shlex.split(said)
    given = {word.removeprefix("--"): value for word, value in zip(words[::2], words[1::2], strict=True)}
    assert "e" not in given["x"] + given["qx"]
    R = Rotation.from_quat([float(given[name]) for name in ("qx", "qy", "qz", "qw")]).as_matrix()
    return (given["frame-id"], given["child-frame-id"]), rigid(R, [float(given[name]) for name in "xyz"])


def own_tree(calibrated: Calibrated) -> dict[tuple[str, str], np.ndarray]:
    """What robot_state_publisher publishes of the vehicle's own tree, the solved joints left out."""
    edges: dict[tuple[str, str], np.ndarray] = {}
    joints = [camera.joint for camera in calibrated.cameras if camera.joint]
    stated = [pose for joint in joints for pose in (joint.T_parent_lidar, joint.T_child_camera)]
    for pose in [*stated, *(one.T_vehicle_lidar for one in calibrated.cameras if one.T_vehicle_lidar)]:
        if pose.to_frame != pose.from_frame and pose.from_frame not in {child for _, child in edges}:
            edges[pose.to_frame, pose.from_frame] = pose.matrix
    return edges


def ros2(calibrated: Calibrated) -> list[Projection]:
    files = files_of("ros2", calibrated)
    edges = dict(published(line) for line in only(files, ".txt").decode().splitlines())
    launch = ElementTree.fromstring(only(files, ".launch.xml"))
    nodes = [node for node in launch.iter("node") if node.get("exec") == "static_transform_publisher"]
    launched = dict(published(node.attrib["args"]) for node in nodes)
    assert launched.keys() == edges.keys() and all((launched[edge] == edges[edge]).all() for edge in edges)
    own = own_tree(calibrated)
    children = [child for _, child in [*edges, *own]]
    assert len(edges) == len(calibrated.cameras) and len(set(children)) == len(children), "tf2 takes one parent"
    found = []
    for camera, name in _of_cameras(files, "camera_info.yaml", calibrated):
        lens, T = by_camera_info(files[name], camera), _tree(edges | own, camera.frame, camera.lidar_frame)
        found.append(lambda points, lens=lens, T=T: lens(move(T, points)))
    return found


def fixed_axes(rpy) -> np.ndarray:
    """URDF and Autoware: roll, then pitch, then yaw, about the parent's axes."""
    return Rotation.from_euler("xyz", rpy).as_matrix()


def joints(document: bytes) -> dict[tuple[str, str], np.ndarray]:
    robot = URDF.from_xml_string(document)
    assert robot.get_root()
    edges = {}
    for joint in robot.joints:
        assert joint.type == "fixed"
        origin = joint.origin
        edges[joint.parent, joint.child] = rigid(fixed_axes(origin.rpy), origin.xyz) if origin else np.eye(4)
    return edges


def urdf(calibrated: Calibrated) -> list[Projection]:
    """The mounts alone; the lens is ours by way of camera_info."""
    (document,) = files_of("urdf", calibrated).values()
    lenses = files_of("camera_info", calibrated)
    found = []
    for camera, name in _of_cameras(lenses, ".yaml", calibrated):
        lens, T = by_camera_info(lenses[name], camera), _tree(joints(document), camera.frame, camera.lidar_frame)
        found.append(lambda points, lens=lens, T=T: lens(move(T, points)))
    return found


def autoware(calibrated: Calibrated) -> list[Projection]:
    """sensor_kit.xacro sets camera_link by the file; monocular_camera.xacro adds the optical link, rpy -90 0 -90."""
    files = files_of("autoware", calibrated)
    edges = {}
    for name in ("sensors_calibration.yaml", "sensor_kit_calibration.yaml"):
        for parent, children in yaml.safe_load(
            only(files, f"/{file_name(calibrated.cameras[0].rig)}/{name}")
        ).items():
            for child, pose in children.items():
                R = fixed_axes([pose["roll"], pose["pitch"], pose["yaw"]])
                edges[parent, child] = rigid(R, [pose["x"], pose["y"], pose["z"]])
    assert ("base_link", "sensor_kit_base_link") in edges
    optical = rigid(fixed_axes([-np.pi / 2, 0.0, -np.pi / 2]), np.zeros(3))
    found = []
    for camera, name in _of_cameras(files, "camera_info.yaml", calibrated):
        (body,) = (
            child
            for _, child in edges
            if child in (camera.frame.replace("optical_", ""), f"{camera.name}/camera_link")
        )
        lens, T = by_camera_info(files[name], camera), _tree(edges, body, camera.lidar_frame)
        found.append(lambda points, lens=lens, T=T: lens(move(np.linalg.inv(optical) @ T, points)))
    return found


def kitti(calibrated: Calibrated) -> list[Projection]:
    """pykitti, for each of its four cameras. It has rectified images; D, of its file, leads to the raw ones."""
    files = files_of("kitti", calibrated)
    with TemporaryDirectory() as base:
        for name, content in files.items():
            (Path(base) / name).parent.mkdir(exist_ok=True)
            (Path(base) / name).write_bytes(content)
        folders = [file_name(camera.name) for camera in calibrated.cameras]
        for folder in folders:
            # What a recording has besides, with one moment.
            drive = Path(base) / folder / f"{folder}_drive_0001_sync" / "oxts"
            (drive / "data").mkdir(parents=True)
            (drive / "timestamps.txt").write_text("2011-09-26 13:02:25.964389445\n")
            (drive / "data" / "0000000000.txt").write_text(" ".join(["49.0"] * 25 + ["4"] * 5) + "\n")
        return [_by_pykitti(pykitti.raw(base, folder, "0001"), files, folder) for folder in folders]


def _by_pykitti(drive: pykitti.raw, files: dict[str, bytes], folder: str) -> Projection:
    lines = files[f"{folder}/calib_cam_to_cam.txt"].decode().splitlines()
    said = dict(line.split(": ", 1) for line in lines)
    assert strptime(said["calib_time"], "%d-%b-%Y %H:%M:%S") and list(said)[2] == "S_00"

    def pixels(points: np.ndarray) -> np.ndarray:
        found = []
        for place in range(4):
            K, T = (getattr(drive.calib, name.format(place)) for name in ("K_cam{}", "T_cam{}_velo"))
            u, v, w = K @ move(T, points).T
            P = getattr(drive.calib, f"P_rect_{place}0")
            by_P = P @ drive.calib.R_rect_00 @ np.c_[points @ T[:3, :3].T + T[:3, 3], np.ones(len(points))].T
            assert np.abs(by_P - [u, v, w]).max() < 1e-9
            rays = np.linalg.solve(K, np.stack([u / w, v / w, np.ones(len(u))])).T
            D = np.array(said[f"D_0{place}"].split(), np.float64)
            found.append(plumb_bob(rays, np.array(said[f"K_0{place}"].split(), np.float64).reshape(3, 3), D))
        assert np.abs(np.ptp(found, axis=0)).max() < 1e-9, "each of the four places is this camera"
        return found[0]

    return pixels


def kalibr(calibrated: Calibrated) -> list[Projection]:
    """Kalibr's wiki: pinhole [fu fv pu pv], radtan [k1 k2 r1 r2], equidistant; T_cn_cnm1 takes the one before here.

    A camchain has no LiDAR: where the first camera is, we say ourselves.
    """
    (document,) = files_of("kalibr", calibrated).values()
    chain = yaml.safe_load(document)
    assert list(chain) == [f"cam{number}" for number in range(len(calibrated.cameras))]
    T, found = calibrated.cameras[0].T_camera_lidar.matrix, []
    for (place, said), camera in zip(enumerate(chain.values()), calibrated.cameras, strict=True):
        assert said["camera_model"] == "pinhole" and said["resolution"] == [camera.width, camera.height]
        assert ("T_cn_cnm1" in said) == (place > 0) and said.get("rostopic") == camera.topic
        if place:
            T = np.array(said["T_cn_cnm1"], np.float64) @ T
        assert len(said["distortion_coeffs"]) == 4
        found.append(lambda points, T=T, said=said: _kalibr(move(T, points), said))
    return found


def _kalibr(points: np.ndarray, said: dict) -> np.ndarray:
    fu, fv, pu, pv = said["intrinsics"]
    project = {"radtan": plumb_bob, "equidistant": fisheye}[said["distortion_model"]]
    return project(points, np.array([[fu, 0.0, pu], [0.0, fv, pv], [0.0, 0.0, 1.0]]), said["distortion_coeffs"])


def opencv(calibrated: Calibrated) -> list[Projection]:
    files = files_of("opencv", calibrated)
    found = []
    for camera, name in _of_cameras(files, ".yaml", calibrated):
        K, D, project, storage = _by_storage(files[name])
        T = storage.getNode("T_camera_lidar").mat()
        assert storage.getNode("lidar_frame").string() == camera.lidar_frame
        found.append(lambda points, project=project, K=K, D=D, T=T: project(move(T, points), K, D))
    return found


def _by_storage(content: bytes) -> tuple[np.ndarray, np.ndarray, Callable[..., np.ndarray], cv2.FileStorage]:
    storage = cv2.FileStorage(content.decode(), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    K, D = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    return K, D, fisheye if storage.getNode("fisheye_model").real() else plumb_bob, storage


def distorted(files: dict[str, bytes], camera: CalibratedCamera) -> Projection:
    """Pixels of an undistorted image -> of the raw one, by the lens beside the export; a pinhole has none."""
    lens = f"undistort/{file_name(camera.name)}.yaml"
    if lens not in files:
        return lambda pixels: pixels
    K, D, project, _ = _by_storage(files[lens])
    # cv2.undistort and cv2.fisheye.undistortImage with Knew=K.
    return lambda pixels: project(np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(K).T, K, D)


def nuscenes(calibrated: Calibrated) -> list[Projection]:
    """The devkit: LiDAR to ego by the LiDAR's record, ego to camera by the inverse of its own; w x y z; K whole."""
    files = files_of("nuscenes", calibrated)
    channels = {one["token"]: one["channel"] for one in json.loads(files["sensor.json"])}
    records = {channels[one["sensor_token"]]: one for one in json.loads(files["calibrated_sensor.json"])}
    assert len({one["token"] for one in records.values()}) == len(calibrated.cameras) + 1
    assert records["LIDAR_TOP"]["camera_intrinsic"] == []

    def projection(channel: str, raw: Projection) -> Projection:
        lidar, camera = records["LIDAR_TOP"], records[channel]

        def pixels(points: np.ndarray) -> np.ndarray:
            ego = points @ Quaternion(lidar["rotation"]).rotation_matrix.T + np.array(lidar["translation"])
            inside = (ego - np.array(camera["translation"])) @ Quaternion(camera["rotation"]).rotation_matrix
            u, v, w = np.array(camera["camera_intrinsic"]) @ inside.T
            return raw(np.stack([u / w, v / w], axis=1))

        return pixels

    return [projection(f"CAM_{camera.name.upper()}", distorted(files, camera)) for camera in calibrated.cameras]


def kitti_object(calibrated: Calibrated) -> list[Projection]:
    """The benchmark's devkit (matrix.cpp, readme.txt): x = P2 R0_rect Tr_velo_to_cam y."""
    files = files_of("kitti_object", calibrated)

    def projection(text: bytes, raw: Projection) -> Projection:
        rows = dict(line.split(":") for line in text.decode().splitlines())
        matrices = {name: np.array(values.split(), np.float64).reshape(3, -1) for name, values in rows.items()}
        assert list(matrices) == ["P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo"]

        def pixels(points: np.ndarray) -> np.ndarray:
            rectified = np.c_[points, np.ones(len(points))] @ (matrices["R0_rect"] @ matrices["Tr_velo_to_cam"]).T
            u, v, w = matrices["P2"] @ np.c_[rectified, np.ones(len(points))].T
            return raw(np.stack([u / w, v / w], axis=1))

        return pixels

    return [
        projection(files[name], distorted(files, camera))
        for camera, name in _of_cameras(files, "calib.txt", calibrated)
    ]


def fast_livo2(calibrated: Calibrated) -> list[Projection]:
    """Its LIVMapper reads Rcl, Pcl by rows; vikit's camera_loader names what each camera model takes."""
    files = files_of("fast_livo2", calibrated)
    found = []
    for camera, name in _of_cameras(files, "camera.yaml", calibrated):
        lens = yaml.safe_load(files[name])
        mounted = yaml.safe_load(files[name.replace("camera.yaml", "extrinsics.yaml")])["extrin_calib"]
        T = rigid(np.array(mounted["Rcl"], np.float64).reshape(3, 3), mounted["Pcl"])
        K = np.array([[lens["cam_fx"], 0.0, lens["cam_cx"]], [0.0, lens["cam_fy"], lens["cam_cy"]], [0.0, 0.0, 1.0]])
        assert (lens["cam_width"], lens["cam_height"]) == (camera.width, camera.height)
        project, terms = {
            "Pinhole": (plumb_bob, ("cam_d0", "cam_d1", "cam_d2", "cam_d3")),
            "EquidistantCamera": (fisheye, ("k1", "k2", "k3", "k4")),
        }[lens["cam_model"]]
        D = [lens[term] for term in terms]
        found.append(lambda points, project=project, K=K, D=D, T=T: project(move(T, points), K, D))
    return found


def direct_visual(calibrated: Calibrated) -> list[Projection]:
    """Its documentation: p_lidar = T_lidar_camera p_camera, x y z qx qy qz qw; create_camera.hpp names the models."""
    files = files_of("direct_visual", calibrated)
    found = []
    for _, name in _of_cameras(files, "calib.json", calibrated):
        document = json.loads(files[name])
        lens, pose = document["camera"], document["results"]["T_lidar_camera"]
        T = np.linalg.inv(rigid(Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]))
        f_x, f_y, c_x, c_y = lens["intrinsics"]
        K, D = np.array([[f_x, 0.0, c_x], [0.0, f_y, c_y], [0.0, 0.0, 1.0]]), lens["distortion_coeffs"]
        project = {"plumb_bob": plumb_bob, "equidistant": fisheye}[lens["camera_model"]]
        found.append(lambda points, project=project, K=K, D=D, T=T: project(move(T, points), K, D))
    return found


def openlabel(calibrated: Calibrated) -> list[Projection]:
    """raillabel for pinhole lenses; it has no fisheye, and VCD reads that of the same file."""
    (document,) = files_of("openlabel", calibrated).values()
    if calibrated.cameras[0].lens == "kannala_brandt":
        return by_vcd(document, calibrated)
    with TemporaryDirectory() as folder:
        (Path(folder) / "scene.json").write_bytes(document)
        scene = raillabel.load(Path(folder) / "scene.json")
    T_base_lidar = _by_raillabel(scene.sensors[calibrated.cameras[0].lidar_frame])

    def projection(camera: raillabel.format.Camera) -> Projection:
        K = np.array(camera.intrinsics.camera_matrix).reshape(3, 4)[:, :3]
        T = np.linalg.inv(_by_raillabel(camera)) @ T_base_lidar

        def pixels(points: np.ndarray) -> np.ndarray:
            """x_img = camera_matrix X_ccs, the whole matrix, of rays that OpenCV's coefficients distort."""
            distorted = plumb_bob(move(T, points), np.eye(3), camera.intrinsics.distortion)
            return np.c_[distorted, np.ones(len(points))] @ K[:2].T

        return pixels

    return [projection(scene.sensors[camera.frame]) for camera in calibrated.cameras]


def _by_raillabel(sensor: raillabel.format.Camera | raillabel.format.Lidar) -> np.ndarray:
    pos, quat = sensor.extrinsics.pos, sensor.extrinsics.quat
    return rigid(Rotation.from_quat([quat.x, quat.y, quat.z, quat.w]).as_matrix(), [pos.x, pos.y, pos.z])


def vcd(calibrated: Calibrated) -> list[Projection]:
    (document,) = files_of("vcd", calibrated).values()
    return by_vcd(document, calibrated)


def by_vcd(document: bytes, calibrated: Calibrated) -> list[Projection]:
    """VCD: the file held against the standard's schema, its cameras' own projection, its own chain of transforms."""
    label = OpenLABEL()
    label.load_from_json(json.loads(document), validation=True)
    scene = Scene(label)

    def projection(camera: str) -> Projection:
        T, static = scene.get_transform(calibrated.cameras[0].lidar_frame, camera)
        assert static

        def pixels(points: np.ndarray) -> np.ndarray:
            inside = np.c_[move(T, points), np.ones(len(points))].T
            with warnings.catch_warnings():
                # Of its inverse for whole images, which is not asked here.
                warnings.filterwarnings("ignore", "WARNING: the inverse of the CameraFisheye distortion", Warning)
                lens = scene.get_camera(camera)
            found, valid = lens.project_points3d(inside)
            assert all(valid)
            return (found[:2] / found[2]).T

        return pixels

    return [projection(camera.frame) for camera in calibrated.cameras]


READERS = {
    "camera_info": ros_camera_info,
    "ros2": ros2,
    "urdf": urdf,
    "autoware": autoware,
    "kitti": kitti,
    "kitti_object": kitti_object,
    "kalibr": kalibr,
    "opencv": opencv,
    "fast_livo2": fast_livo2,
    "direct_visual": direct_visual,
    "nuscenes": nuscenes,
    "openlabel": openlabel,
    "vcd": vcd,
}
