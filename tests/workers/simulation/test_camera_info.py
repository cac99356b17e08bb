"""Bags with CameraInfo, ``/tf_static`` and a URDF, as rosbags and OpenCV see them."""

import json
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from apexcal.documents.simulation import SimulationOptions
from workers.simulation.simulate import simulate

FORMS = [("bag", "raw", "nominal"), ("db3", "rectified", "true"), ("mcap", "rectified", "nominal")]


@pytest.fixture(scope="module", params=FORMS, ids=lambda form: "-".join(form))
def made(request, tmp_path_factory):
    form, images, tree = request.param
    settings = SimulationOptions(
        seconds=1.0, seed=4, cameras="left:10,right:-10:kannala_brandt", camera_hz=3.0, format=form,
        camera_info=images, tree=tree, walk="slow",
    )  # fmt: skip
    written = simulate(settings, tmp_path_factory.mktemp("walk"))
    with AnyReader([written.recording]) as bag:
        connections = {one.topic: one for one in bag.connections}
        messages = [(one.topic, at, bag.deserialize(raw, one.msgtype)) for one, at, raw in bag.messages()]
    return settings, written, connections, messages, json.loads(written.truth.read_text())


def matrices(info):
    """D, K, R (3, 3), P (3, 4): ROS 1 writes their names in capitals."""
    D, K, R, P = (getattr(info, name, getattr(info, name.upper(), None)) for name in "dkrp")
    return D, K.reshape(3, 3), R.reshape(3, 3), P.reshape(3, 4)


def matrix(transform):
    q, t = transform.rotation, transform.translation
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), [t.x, t.y, t.z]
    return made


def chain(edges, link):
    parent, pose = edges[link]
    return pose if parent == "base_link" else chain(edges, parent) @ pose


def test_each_image_has_its_camera_info(made):
    settings, _, _, messages, truth = made
    word = {"raw": "image_raw", "rectified": "image_rect_color"}[settings.camera_info]
    for name in ("left", "right"):
        images = [one.header for topic, _, one in messages if topic == f"/camera/{name}/{word}/compressed"]
        infos = [one for topic, _, one in messages if topic == f"/camera/{name}/camera_info"]
        assert [one.stamp for one in images] == [one.header.stamp for one in infos] and len(images) == 3
        assert {one.header.frame_id for one in infos} == {f"camera_{name}_optical"}
        assert {(one.width, one.height) for one in infos} == {(960, 600)}
        info, camera = infos[0], truth["cameras"][name]
        D, K, R, P = matrices(info)
        assert np.degrees(Rotation.from_matrix(R).magnitude()) == pytest.approx(1.2, abs=1e-9)
        assert info.distortion_model == {"left": "plumb_bob", "right": "equidistant"}[name]
        # OpenCV draws the points of the truth where the truth says.
        frames = camera["frames"]
        points, uv = np.array(frames["apex_xyz"]), np.array(frames["apex_uv"], float)
        seen = np.array(frames["apex_in_image"])
        T = camera["transform"]
        in_images = points @ np.array(T["rotation"]["matrix"]).T + T["translation_m"]
        if settings.camera_info == "rectified":
            assert camera["intrinsics"]["model"] == "pinhole" and T["to_frame"].endswith("_optical_rectified")
            K, D = P[:, :3], np.zeros(5)
        project = (
            cv2.fisheye.projectPoints if name == "right" and settings.camera_info == "raw" else cv2.projectPoints
        )
        drawn = project(in_images[:, None], np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
        assert seen.any() and np.abs(drawn - uv)[seen].max() < 1e-3


def test_the_baseline_is_how_far_right_of_the_first_camera_it_stands(made):
    settings, _, _, messages, truth = made
    first, second = (
        {topic: one for topic, _, one in messages}[f"/camera/{name}/camera_info"] for name in ("left", "right")
    )
    (*_, P), (*_, P1) = matrices(first), matrices(second)
    assert P[0, 3] == 0.0 and P1[0, 3] != 0.0
    if settings.camera_info == "rectified":  # the truth has the rectified frames
        T = [truth["cameras"][name]["transform"] for name in ("left", "right")]
        (R, t), (R1, t1) = ((np.array(one["rotation"]["matrix"]), np.array(one["translation_m"])) for one in T)
        b = (R1 @ (-R.T @ t) + t1)[0]
        assert P1[0, 3] == pytest.approx(P1[0, 0] * b, abs=1e-6)


def test_the_tree_is_latched_and_the_same_in_the_urdf(made):
    settings, written, connections, messages, truth = made
    tf = [one for topic, _, one in messages if topic == "/tf_static"]
    assert len(tf) == 1 and messages[0][0] == "/tf_static"
    said = {one.child_frame_id: (one.header.frame_id, matrix(one.transform)) for one in tf[0].transforms}
    ext = connections["/tf_static"].ext
    if settings.format == "bag":
        assert ext.latching == 1
    else:
        assert ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
    robot = ElementTree.parse(written.recording.parent / "vehicle.urdf").getroot()
    links = {one.get("name") for one in robot.iter("link")}
    assert links == {"base_link", *said}
    for joint in robot.iter("joint"):
        parent, child = (joint.find(end).get("link") for end in ("parent", "child"))
        xyz, rpy = (np.array(joint.find("origin").get(name).split(), float) for name in ("xyz", "rpy"))
        made_here = np.eye(4)
        made_here[:3, :3], made_here[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
        assert (joint.get("type"), joint.get("name")) == ("fixed", f"{child}_joint")
        assert said[child][0] == parent and np.abs(said[child][1] - made_here).max() < 1e-9
    # The body looks along its x axis: its optical frame is turned, and not moved.
    assert np.abs(said["camera_left_optical"][1][:3, 2] - [1, 0, 0]).max() < 1e-12
    T = np.linalg.inv(chain(said, "camera_left_optical")) @ chain(said, "velodyne")
    infos = {topic: one for topic, _, one in messages}
    R = matrices(infos["/camera/left/camera_info"])[2] if settings.camera_info == "rectified" else np.eye(3)
    off = Rotation.from_matrix(R @ T[:3, :3] @ np.array(truth["transform"]["rotation"]["matrix"]).T).magnitude()
    low, high = {"true": (0.0, 1e-4), "nominal": (0.3, 6.0)}[settings.tree]
    assert low <= np.degrees(off) < high
