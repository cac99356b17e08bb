"""How other programs read the exports, written from their formats' documentation and with their own readers.

Each reader answers, for every camera by its place, a function from LiDAR points (n, 3) to pixels (n, 2).
"""

from __future__ import annotations

import io
import json
import shlex
import zipfile
from collections.abc import Callable
from xml.etree import ElementTree

import cv2
import numpy as np
import yaml
from pyquaternion import Quaternion
from scipy.spatial.transform import Rotation
from urdf_parser_py.urdf import URDF

from service.exports.calibrated import Calibrated
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


def by_camera_info(text: bytes) -> Projection:
    """sensor_msgs/CameraInfo: K by rows; plumb_bob k1 k2 t1 t2 k3, equidistant k1 k2 k3 k4; P of rectified images."""
    said = yaml.safe_load(text)
    K = np.array(said["camera_matrix"]["data"], np.float64).reshape(3, 3)
    D = np.array(said["distortion_coefficients"]["data"], np.float64)
    assert all(isinstance(one, float) for one in said["distortion_coefficients"]["data"])
    assert said["distortion_coefficients"]["rows"] * said["distortion_coefficients"]["cols"] == len(D)
    P = np.array(said["projection_matrix"]["data"]).reshape(3, 4)
    assert (P[:, :3] == K).all() and (np.array(said["rectification_matrix"]["data"]).reshape(3, 3) == np.eye(3)).all()
    assert K[0, 1] == 0.0, "image_geometry takes four of the nine"
    model = {"plumb_bob": (plumb_bob, 5), "equidistant": (fisheye, 4)}[said["distortion_model"]]
    assert len(D) == model[1] and (said["image_width"], said["image_height"]) == (1920, 1200)
    return lambda points: model[0](points, K, D)


def ros_camera_info(calibrated: Calibrated) -> list[Projection]:
    """The lens alone; the mount is ours."""
    files = files_of("camera_info", calibrated)
    found = []
    for camera, text in zip(calibrated.cameras, (files[one] for one in _of_cameras(files, ".yaml")), strict=True):
        lens, T = by_camera_info(text), camera.T_camera_lidar.matrix
        found.append(lambda points, lens=lens, T=T: lens(move(T, points)))
    return found


def _of_cameras(files: dict[str, bytes], end: str) -> list[str]:
    named = [next(name for name in files if wanted in name and name.endswith(end)) for wanted in CAMERAS]
    assert len(set(named)) == 3
    return named


CAMERAS = ("front", "left_rear", "mast-1")


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
    for number, name in enumerate(_of_cameras(files, "camera_info.yaml")):
        lens, T = by_camera_info(files[name]), _tree(edges | own, f"camera{number}/camera_optical_link")
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
    for number, name in enumerate(_of_cameras(lenses, ".yaml")):
        lens, T = by_camera_info(lenses[name]), _tree(joints(document), f"camera{number}/camera_optical_link")
        found.append(lambda points, lens=lens, T=T: lens(move(T, points)))
    return found


def autoware(calibrated: Calibrated) -> list[Projection]:
    """sensor_kit.xacro sets camera_link by the file; monocular_camera.xacro adds the optical link, rpy -90 0 -90."""
    files = files_of("autoware", calibrated)
    edges = {}
    for name in ("sensors_calibration.yaml", "sensor_kit_calibration.yaml"):
        for parent, children in yaml.safe_load(only(files, "/roof/" + name)).items():
            for child, pose in children.items():
                R = fixed_axes([pose["roll"], pose["pitch"], pose["yaw"]])
                edges[parent, child] = rigid(R, [pose["x"], pose["y"], pose["z"]])
    assert ("base_link", "sensor_kit_base_link") in edges
    optical = rigid(fixed_axes([-np.pi / 2, 0.0, -np.pi / 2]), np.zeros(3))
    found = []
    for number, name in enumerate(_of_cameras(files, "camera_info.yaml")):
        lens, T = by_camera_info(files[name]), _tree(edges, f"camera{number}/camera_link")
        found.append(lambda points, lens=lens, T=T: lens(move(np.linalg.inv(optical) @ T, points)))
    return found


def kitti(calibrated: Calibrated) -> list[Projection]:
    """The raw devkit's readme. D is OpenCV's; P_rect_xx R_rect_00 (R|T)_velo_to_cam X holds where there is none."""
    files = files_of("kitti", calibrated)
    said = {}
    for name in ("calib_velo_to_cam.txt", "calib_cam_to_cam.txt"):
        for line in only(files, name).decode().splitlines():
            key, _, value = line.partition(": ")
            said[key] = value if key.startswith(("calib_time", "name")) else np.array(value.split(), np.float64)
    assert said["calib_time"] == "05-Mar-2026 07:08:09" and list(said)[6] == "S_00"
    velo_to_cam = rigid(said["R"].reshape(3, 3), said["T"])

    def projection(place: str) -> Projection:
        T = rigid(said[f"R_{place}"].reshape(3, 3), said[f"T_{place}"]) @ velo_to_cam
        K, D = said[f"K_{place}"].reshape(3, 3), said[f"D_{place}"]

        def pixels(points: np.ndarray) -> np.ndarray:
            found = plumb_bob(move(T, points), K, D)
            if not D.any():
                homogeneous = np.c_[points, np.ones(len(points))]
                rectified = rigid(said["R_rect_00"].reshape(3, 3), np.zeros(3)) @ velo_to_cam @ homogeneous.T
                u, v, w = said[f"P_rect_{place}"].reshape(3, 4) @ rectified
                assert np.abs(found - np.stack([u / w, v / w], axis=1)).max() < 1e-6
            return found

        return pixels

    return [projection(f"{place:02d}") for place in range(3)]


def kalibr(calibrated: Calibrated) -> list[Projection]:
    """Kalibr's wiki: pinhole [fu fv pu pv], radtan [k1 k2 r1 r2], equidistant; T_cn_cnm1 takes the one before here.

    A camchain has no LiDAR: where the first camera is, we say ourselves.
    """
    (document,) = files_of("kalibr", calibrated).values()
    chain = yaml.safe_load(document)
    assert list(chain) == ["cam0", "cam1", "cam2"]
    T, found = calibrated.cameras[0].T_camera_lidar.matrix, []
    for place, said in enumerate(chain.values()):
        assert said["camera_model"] == "pinhole" and said["resolution"] == [1920, 1200]
        assert ("T_cn_cnm1" in said) == (place > 0) and said["rostopic"] == f"/camera{place}/image"
        if place:
            T = np.array(said["T_cn_cnm1"], np.float64) @ T
        distort = {"radtan": _radtan, "equidistant": _equidistant}[said["distortion_model"]]
        assert len(said["distortion_coeffs"]) == 4
        found.append(lambda points, T=T, said=said, distort=distort: _kalibr(move(T, points), said, distort))
    return found


def _kalibr(points: np.ndarray, said: dict, distort) -> np.ndarray:
    fu, fv, pu, pv = said["intrinsics"]
    x, y = distort(points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], said["distortion_coeffs"])
    return np.stack([fu * x + pu, fv * y + pv], axis=1)


def _radtan(x, y, coefficients):
    k1, k2, r1, r2 = coefficients
    square = x * x + y * y
    radial = 1 + k1 * square + k2 * square**2
    return x * radial + 2 * r1 * x * y + r2 * (square + 2 * x * x), y * radial + 2 * r2 * x * y + r1 * (
        square + 2 * y * y
    )


def _equidistant(x, y, coefficients):
    r = np.hypot(x, y)
    theta = np.arctan(r)
    scale = theta * (1 + sum(k * theta ** (2 * n) for n, k in enumerate(coefficients, 1))) / r
    return x * scale, y * scale


def opencv(calibrated: Calibrated) -> list[Projection]:
    files = files_of("opencv", calibrated)
    found = []
    for name in _of_cameras(files, ".yaml"):
        storage = cv2.FileStorage(files[name].decode(), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        K, D = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
        T = storage.getNode("T_camera_lidar").mat()
        assert storage.getNode("lidar_frame").string() == "velodyne"
        project = fisheye if storage.getNode("fisheye_model").real() else plumb_bob
        found.append(lambda points, project=project, K=K, D=D, T=T: project(move(T, points), K, D))
    return found


def nuscenes(calibrated: Calibrated) -> list[Projection]:
    """The devkit: LiDAR to ego by the LiDAR's record, ego to camera by the inverse of its own; w x y z; K whole."""
    files = files_of("nuscenes", calibrated)
    channels = {one["token"]: one["channel"] for one in json.loads(files["sensor.json"])}
    records = {channels[one["sensor_token"]]: one for one in json.loads(files["calibrated_sensor.json"])}
    assert len({one["token"] for one in records.values()}) == 4 and records["LIDAR_TOP"]["camera_intrinsic"] == []

    def projection(channel: str) -> Projection:
        lidar, camera = records["LIDAR_TOP"], records[channel]

        def pixels(points: np.ndarray) -> np.ndarray:
            ego = points @ Quaternion(lidar["rotation"]).rotation_matrix.T + np.array(lidar["translation"])
            inside = (ego - np.array(camera["translation"])) @ Quaternion(camera["rotation"]).rotation_matrix
            u, v, w = np.array(camera["camera_intrinsic"]) @ inside.T
            return np.stack([u / w, v / w], axis=1)

        return pixels

    return [projection(channel) for channel in ("CAM_FRONT", "CAM_LEFT.REAR", "CAM_MAST-1")]


def openlabel(calibrated: Calibrated) -> list[Projection]:
    """ASAM OpenLABEL 1.0: pose_wrt_parent maps into the parent; distortion is OpenCV's; then the whole 3x4 matrix."""
    (document,) = files_of("openlabel", calibrated).values()
    said = json.loads(document)["openlabel"]
    systems = said["coordinate_systems"]
    assert [name for name, one in systems.items() if one["type"] == "local_cs"] == ["base_link"]
    edges = {}
    for name, one in systems.items():
        for child in one["children"]:
            assert systems[child]["parent"] == name
            edges[name, child] = np.array(systems[child]["pose_wrt_parent"]["matrix4x4"]).reshape(4, 4)
    streams = {name: one for name, one in said["streams"].items() if one["type"] == "camera"}

    def projection(name: str) -> Projection:
        lens = streams[name]["stream_properties"]["intrinsics_pinhole"]
        matrix, T = np.array(lens["camera_matrix_3x4"]).reshape(3, 4), _tree(edges, name)

        def pixels(points: np.ndarray) -> np.ndarray:
            distorted = plumb_bob(move(T, points), np.eye(3), lens["distortion_coeffs_1xN"])
            u, v, w = matrix @ np.c_[distorted, np.ones((len(points), 2))].T
            return np.stack([u / w, v / w], axis=1)

        return pixels

    return [projection(name) for name in streams]


READERS = {
    "camera_info": ros_camera_info,
    "ros2": ros2,
    "urdf": urdf,
    "autoware": autoware,
    "kitti": kitti,
    "kalibr": kalibr,
    "opencv": opencv,
    "nuscenes": nuscenes,
    "openlabel": openlabel,
}
