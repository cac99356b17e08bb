"""CameraInfo as drivers write it: R and P are kept, and images are raw or rectified as far as the file tells."""

import json
from dataclasses import replace

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from making_recordings import png
from making_ros2 import K, rig, write_ros2
from rosbags.typesys import Stores, get_typestore

from apexcal.documents.lenses import lens_of_images
from workers.readers.detect import open_recording
from workers.readers.inspection import inspect_recording
from workers.readers.ros.camera_info import camera_info, image_kind, info_document
from workers.readers.ros.ros_types import ros_decoder
from workers.readers.ros.topic_messages import BagTopic

R = [0.9998, -0.02, 0.0, 0.02, 0.9998, 0.0, 0.0, 0.0, 1.0]
P = [1080.5, 0.0, 955.0, -129.66, 0.0, 1080.5, 600.0, 0.0, 0.0, 0.0, 1.0, 0.0]
NONE = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
SAME = [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
D = [0.1, -0.2, 0.001, 0.002, 0.05]


def document(d=D, r=NONE, p=SAME, k=K):
    return info_document(camera_info(5, "camera", 1920, 1208, "plumb_bob", d, k, r, p))


@pytest.mark.parametrize("form", ["ros1", "cdr", "protobuf", "json"])
def test_r_and_p_are_kept(tmp_path, form):
    if form in ("ros1", "cdr"):
        types = get_typestore(Stores.ROS1_NOETIC if form == "ros1" else Stores.ROS2_HUMBLE)
        seq = [3] if form == "ros1" else []
        head = types.types["std_msgs/msg/Header"](*seq, types.types["builtin_interfaces/msg/Time"](1, 2), "camera")
        name = "sensor_msgs/msg/CameraInfo"
        roi = types.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        matrices = (np.array(one) for one in (D, K, R, P))
        message = types.types[name](head, 1208, 1920, "plumb_bob", *matrices, 0, 0, roi)
        raw = bytes((types.serialize_ros1 if form == "ros1" else types.serialize_cdr)(message, name))
        found = ros_decoder(BagTopic("/front/camera_info", name, form, "", "", 1))(raw)
    else:
        from workers.readers.ros.foxglove import foxglove_decoder

        text = {"width": 1920, "height": 1208, "distortion_model": "plumb_bob", "D": D, "K": K, "R": R, "P": P}
        raw = CameraCalibration(**text).SerializeToString()
        topic = BagTopic("/front/camera_info", "foxglove.CameraCalibration", form, "", "", 1)
        found = foxglove_decoder(topic)(raw if form == "protobuf" else json.dumps(text).encode())
    assert (list(found.k), list(found.d), list(found.r), list(found.p)) == (K, D, R, P)
    assert (info_document(found)["R"], info_document(found)["P"]) == (R, P)


def test_a_p_or_r_that_is_none_is_left_out():
    for p in ([], [0.0] * 12, [float("nan"), *P[1:]], P[:11], [-1.0, *P[1:]]):
        assert (document(p=p)["P"], document(r=R, p=p)["R"]) == (None, None)
    for r in ([], [0.0] * 9, NONE, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0], [1e308] * 9, [float("nan")] * 9):
        assert document(r=r)["R"] is None and document(r=r)["P"] == SAME


@pytest.mark.parametrize(
    ("topic", "kind"),
    [
        ("/stereo/left/image_raw", "raw"),
        ("/stereo/left/image_raw/compressed", "raw"),
        ("/zed/left_raw/image_raw_color", "raw"),
        ("/camera/image_color", "raw"),
        ("/camera/image_mono/compressed", "raw"),
        ("/stereo/left/image_rect", "rectified"),
        ("/stereo/left/image_rect_color/compressed", "rectified"),
        ("/camera/infra1/image_rect_raw", "rectified"),
        ("/front/rectified/image", "rectified"),
        ("/front/image/compressed", None),
        ("/camera/raw_front/image", None),
        ("/direct/image", None),
    ],
)
def test_a_topic_tells(topic, kind):
    assert image_kind(topic, None) == kind
    assert image_kind(topic, document()) == kind


def test_a_camera_info_tells_where_the_topic_does_not():
    topic, pinhole = "/front/image", [0.0] * 5
    assert image_kind(topic, document(d=pinhole)) == "rectified"
    assert image_kind(topic, document(d=[])) == "rectified"
    assert image_kind("/front/image_raw", document(d=pinhole)) == "raw"
    for other in (document(d=pinhole, r=R), document(d=pinhole, p=P), document(d=pinhole, p=[0.0] * 12), document()):
        assert image_kind(topic, other) is None


def test_the_lens_of_rectified_images_is_p_without_its_baseline():
    stated = document(r=R, p=P)
    assert lens_of_images(stated, "raw") == stated == lens_of_images(stated, None)
    lens = lens_of_images(stated, "rectified")
    assert lens["K"] == [1080.5, 0.0, 955.0, 0.0, 1080.5, 600.0, 0.0, 0.0, 1.0] and lens["D"] == [0.0] * 5
    assert (lens["model"], lens["width"], lens["height"]) == ("brown_conrady", 1920, 1208)
    assert lens_of_images(document(p=[]), "rectified") is None


def test_a_recording_says_what_its_images_are(tmp_path):
    def with_topic(old, new):
        return [(topic.replace(old, new), *rest) for topic, *rest in rig()]

    for at, (topic, kind) in enumerate({"image_raw": "raw", "image_rect": "rectified", "image": None}.items()):
        recording = open_recording(write_ros2(tmp_path / str(at), with_topic("image_raw", topic)))
        (camera,) = [one for one in recording.sensors if one.kind == "camera"]
        assert camera.image_kind == kind
        recording.close()


def sensor_info(
    size, roi=(0, 0, 0, 0), binning=(0, 0), k=(600.0, 0.0, 640.0, 0.0, 610.0, 360.0, 0.0, 0.0, 1.0), p=()
):
    """Of a sensor of 1280 x 720 pixels."""
    return replace(camera_info(5, "c", *size, "plumb_bob", D, k, NONE, p), roi=roi, binning=binning)


def of_images(x, y, offset=(0, 0), binning=(1, 1)):
    """Pixel of the image that shows the sensor's pixel (x, y): the mean of the sensor's pixels that make one."""
    return tuple(
        float(np.interp(along - start, np.arange(1280), (np.arange(1280) + 0.5) / count - 0.5))
        for along, start, count in zip((x, y), offset, binning, strict=True)
    )


WHOLE = (1280, 720)


@pytest.mark.parametrize(
    ("info", "images", "size", "focal", "centre"),
    [
        (sensor_info(WHOLE), WHOLE, WHOLE, (600, 610), (640, 360)),
        (sensor_info(WHOLE, binning=(2, 2)), (640, 360), (640, 360), (300, 305), of_images(640, 360, binning=(2, 2))),
        (sensor_info(WHOLE, binning=(4, 2)), (320, 360), (320, 360), (150, 305), of_images(640, 360, binning=(4, 2))),
        (sensor_info(WHOLE, roi=(100, 60, 800, 600)), (800, 600), (800, 600), (600, 610), (540, 300)),
        (
            *(sensor_info(WHOLE, roi=(100, 60, 800, 600), binning=(2, 2)), (400, 300), (400, 300), (300, 305)),
            of_images(640, 360, (100, 60), (2, 2)),
        ),
        # Binning is stated, and the images have the stated size: K is theirs.
        (sensor_info(WHOLE, binning=(2, 2)), WHOLE, WHOLE, (600, 610), (640, 360)),
        # No size is stated: that of the images.
        (sensor_info((0, 0)), WHOLE, WHOLE, (600, 610), (640, 360)),
        (sensor_info((0, 0), binning=(1, 1)), (640, 480), (640, 480), (600, 610), (640, 360)),
        # Of video no size is known before it is read: the message counts.
        (sensor_info(WHOLE, binning=(2, 2)), None, (640, 360), (300, 305), of_images(640, 360, binning=(2, 2))),
        (sensor_info(WHOLE, roi=(0, 0, 1280, 720)), None, WHOLE, (600, 610), (640, 360)),
    ],
)
def test_part_of_a_sensor_and_pixels_put_together(info, images, size, focal, centre):
    document = info_document(info, images)
    assert (document["width"], document["height"]) == size
    K = document["K"]
    assert (K[0], K[4]) == pytest.approx(focal) and (K[2], K[5]) == pytest.approx(centre)
    assert document["D"] == D


def test_p_is_of_the_images_as_k_is():
    p = [500.0, 0.0, 640.0, -60.0, 0.0, 500.0, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    document = info_document(sensor_info(WHOLE, (100, 60, 800, 600), (2, 2), p=p), (400, 300))
    centre = of_images(640, 360, (100, 60), (2, 2))
    assert document["P"] == pytest.approx([250, 0, centre[0], -30, 0, 250, centre[1], 0, 0, 0, 1, 0])


@pytest.mark.parametrize(
    ("name", "d", "model"),
    [
        ("plumb_bob", [0.4, -2.0, 0.001, 0.0, 1.0, 0.3, -2.0, 1.0], "rational_polynomial"),
        ("", [0.4, -2.0, 0.001, 0.0, 1.0, 0.3, -2.0, 1.0], "rational_polynomial"),
        ("plumb_bob", [0.4, -2.0, 0.001, 0.0, 1.0, 0.3, -2.0, 1.0, *[0.0] * 6], "rational_polynomial"),
        ("Plumb_Bob", [0.4, -2.0, 0.001, 0.0, 1.0, 0.0, 0.0, 0.0], "brown_conrady"),
        ("plumb_bob", [0.4, -2.0, 0.001, 0.0], "brown_conrady"),
        ("rational_polynomial", [0.4, -2.0, 0.001, 0.0, 1.0], "brown_conrady"),
        ("plumb_bob", [*[0.1] * 8, 0.01, 0.0, 0.0, 0.0], None),  # a thin prism
        ("equidistant", [0.1] * 8, None),
        ("ds", [0.6, -0.2], None),
    ],
)
def test_coefficients_at_work_tell_the_model(name, d, model):
    document = info_document(camera_info(5, "c", 1280, 720, name, d, K, NONE, ()), (1280, 720))
    assert document["model"] == model
    if model is not None:
        size = {"rational_polynomial": 8, "brown_conrady": 5}[model]
        assert document["D"] == [*d, *[0.0] * 8][:size]


def test_inspect_says_that_a_lens_is_not_used(tmp_path):
    messages = list(rig(8, d=[*[0.1] * 8, 0.01, 0.0, 0.0, 0.0]))
    for topic, _, _, message in messages:
        if topic.endswith("compressed"):
            message.data = np.frombuffer(png(640, 360), np.uint8)
        elif topic.endswith("camera_info"):
            message.width, message.height = 640, 360
    faults = {fault.code: fault for fault in inspect_recording(write_ros2(tmp_path / "walk", messages)).faults}
    assert "'plumb_bob' with 12 coefficients" in faults["lens_not_used"].sentence
