"""Which of a recording's sensors are read; what is not clear is asked, with what there is to choose from."""

from dataclasses import dataclass, field

import pytest

from workers.readers.choose import choose_sensors
from workers.readers.recording import ReadError, Sensor


@dataclass
class Listed:
    """A recording of which only the list of sensors matters."""

    sensors: list = field(default_factory=list)
    other_topics: tuple = ("/imu (sensor_msgs/msg/Imu)",)
    static_transforms: tuple = ()
    format = "listed"
    warnings = ()


def lidar(name="/velodyne_points", fields="x y z intensity ring", count=5):
    return Sensor("lidar", name, "velodyne", count, {"fields": fields})


def camera(name, count=5, size=None, frame_id="camera"):
    notes = {} if size is None else {"width": str(size[0]), "height": str(size[1])}
    return Sensor("camera", name, frame_id, count, notes)


def cameras(*names):
    return [camera(name) for name in names]


def chosen(sensors, lidar_name=None, cameras=None, sizes=None):
    found = choose_sensors(Listed(sensors), lidar_name, cameras, *([] if sizes is None else [sizes]))
    return {name: sensor.name for name, sensor in found.items()}


CLOUD, LIDAR = "/velodyne_points", {"lidar": "/velodyne_points"}
RAW_AND_PACKED = cameras("/cam/image_raw", "/cam/image_raw/compressed")
THREE = cameras("/camera_rear/image", "/camera_front/image", "/camera_left/image")
PACKETS = Sensor("lidar", "/velodyne_packets", "velodyne", 5, {"fields": "x y z intensity ring time"})
ONE_IMAGE = [*(camera(f"/c/image_{kind}", 100) for kind in ("rect_color", "raw", "color")), camera("/still", 1)]


@pytest.mark.parametrize(
    ("sensors", "asked", "found"),
    [
        # One of each needs no names.
        ([lidar(), *cameras("/cam/image/compressed")], (None, ["front"]), {"front": "/cam/image/compressed"}),
        ([lidar(), *cameras("/cam/image/compressed")], (None, {"front": None}), {"front": "/cam/image/compressed"}),
        ([lidar(), *cameras("/cam/image/compressed")], (None, None), {"cam_image": "/cam/image/compressed"}),
        ([lidar(), *cameras("/cam/image/compressed")], (None, []), {}),
        # A cloud without rings is not the LiDAR where another has them; nor is what is computed from one.
        ([lidar("/sick", "x y z rgb"), lidar()], (None, []), {}),
        ([lidar(), lidar("/ground_filtered/points"), lidar("/points_map")], (None, []), {}),
        ([lidar(), PACKETS], (None, []), {"lidar": "/velodyne_packets"}),  # one sensor twice, once timed
        ([lidar("/a"), lidar("/b")], ("/b", []), {"lidar": "/b"}),
        # A raw camera gives way to its compressed twin, and rectified or single images to it.
        ([lidar(), *RAW_AND_PACKED], (None, ["front"]), {"front": "/cam/image_raw/compressed"}),
        ([lidar(), *RAW_AND_PACKED], (None, {"front": "/cam/image_raw"}), {"front": "/cam/image_raw"}),
        ([lidar(), *ONE_IMAGE], (None, ["x"]), {"x": "/c/image_raw"}),
        ([lidar(), *cameras("/depth")], (None, ["x"]), {"x": "/depth"}),
        # Cameras are told by their names in the topics.
        ([lidar(), *THREE], (None, ["front", "rear"]),
         {"front": "/camera_front/image", "rear": "/camera_rear/image"}),
        ([lidar(), *THREE], (None, {"rear": None, "x": "/camera_left/image"}),
         {"rear": "/camera_rear/image", "x": "/camera_left/image"}),
        # Equal names are counted.
        ([lidar(), *cameras("/cam/a", "/cam_a", "/lidar")], (None, None),
         {"a": "/cam/a", "a_2": "/cam_a", "lidar_2": "/lidar"}),
        # A camera is named after what tells it from others.
        ([lidar(), *cameras("/camera/front/image_raw/compressed", "/image_02")], (None, None),
         {"front": "/camera/front/image_raw/compressed", "image_02": "/image_02"}),
    ],
)  # fmt: skip
def test_what_is_clear_is_chosen(sensors, asked, found):
    names = chosen(sensors, *asked)
    assert names == LIDAR | found and next(iter(names)) == "lidar"


MANY = [lidar(), *(camera(f"/c{i}") for i in range(1999))]


@pytest.mark.parametrize(
    ("sensors", "asked", "code", "words"),
    [
        (cameras("/cam"), (), "no_lidar_topic", ["/cam (camera, 5 messages)", "/imu"]),
        ([*cameras("/cam"), lidar(count=0)], (), "no_lidar_topic", []),
        ([lidar()], (None, ["front"]), "no_camera_topic", [CLOUD]),
        ([lidar("/a"), lidar("/b")], (None, []), "ambiguous_lidar", ["/a, /b"]),
        ([lidar(), *cameras("/one", "/two")], (None, ["front"]), "ambiguous_cameras", ["/one, /two"]),
        ([lidar(), *cameras("/one", "/two")], (None, ["a", "b", "c"]), "ambiguous_cameras", []),
        ([lidar(), *cameras("/front_rear/image", "/x")], (None, ["front", "rear"]), "ambiguous_cameras", []),
        ([lidar(), *cameras("/cam")], ("/cam", []), "topic_not_found", ["no LiDAR topic '/cam'"]),
        ([lidar(), *cameras("/cam")], (None, {"front": "/camm"}), "topic_not_found", []),
        ([lidar(), *cameras("/front/a", "/front/b")], (None, ["front"]), "ambiguous_cameras", ["/front/a, /front/b"]),
        (MANY, (None, ["front"]), "ambiguous_cameras", []),
        ([*MANY, camera("/more")], (None, ["front"]), "too_many_sensors", ["2001"]),
        *(([lidar(), *cameras("/cam")], (None, [name]), "camera_name_invalid", [])
          for name in ("", "../x", "a/b", "lidar", "a" * 65, "-x", "ä")),
    ],
)  # fmt: skip
def test_what_is_not_clear_is_asked(sensors, asked, code, words):
    with pytest.raises(ReadError) as caught:
        chosen(sensors, *asked)
    error = caught.value
    assert error.code == code and error.hint and all(word in error.message for word in words), error.message
    assert len(error.message) < 5000 and len(error.fields.get("candidates", [])) <= 100


@pytest.mark.parametrize(
    ("topic", "maker"),
    [
        ("/pandar_packets (pandar_msgs/msg/PandarScan)", "Hesai"),
        ("/lidar_packets (hesai_ros_driver/msg/UdpFrame)", "Hesai"),
        ("/os_node/lidar_packets (ouster_ros/PacketMsg)", "Ouster"),
        ("/ouster/lidar_packets (ouster_sensor_msgs/msg/PacketMsg)", "Ouster"),
        ("/livox/lidar (livox_ros_driver2/msg/CustomMsg)", "Livox"),
        ("/rslidar_packets (rslidar_msg/msg/RslidarPacket)", "RoboSense"),
    ],
)
def test_raw_packets_of_another_maker_are_said_to_be_that(topic, maker):
    with pytest.raises(ReadError) as caught:
        choose_sensors(Listed(cameras("/cam"), (topic, "/imu (sensor_msgs/Imu)")), None, None)
    assert caught.value.code == "lidar_packets_not_read"
    assert maker in caught.value.message and topic in caught.value.message and "/imu" not in caught.value.message


def test_the_car_with_eleven_cameras():
    sides = ["front", "front_left", "front_right", "left", "right", "rear", "rear_left", "rear_right"]
    topics = {side: f"/camera_{side}/image_raw/compressed" for side in sides}
    topics |= {"tele": "/tele/image_color", "fisheye_top": "/svs/FisheyeTop/image"}
    listed = [*cameras(*topics.values(), *(f"/camera_{side}/depth/image" for side in sides))]
    listed += [camera("/x/image", frame_id="camera_trunk_optical")]
    names = [*topics, "trunk"]
    assert chosen([lidar(), *listed], None, names, dict.fromkeys(names)) == LIDAR | topics | {"trunk": "/x/image"}


def test_images_of_another_size_are_another_camera():
    wide, narrow, small = (
        camera("/a", size=(1920, 1208)),
        camera("/b", size=(640, 480)),
        camera("/c", size=(320, 240)),
    )

    def guessed(listed, sizes):
        return chosen([lidar(), *listed], None, list(sizes), sizes)

    both = {"wide": (640, 480), "tele": (1920, 1208)}
    assert guessed([wide, narrow, small], both) == LIDAR | {"wide": "/b", "tele": "/a"}
    assert guessed([wide, narrow, small], {"wide": (640, 480)}) == LIDAR | {"wide": "/b"}
    assert guessed([narrow], {"front": (1280, 720)}) == LIDAR | {"front": "/b"}  # the size gets reported later
    with pytest.raises(ReadError, match="not clear"):
        guessed([wide, narrow], {"one": (100, 100), "two": (100, 100)})


def test_a_program_is_told_what_there_is_to_choose_from():
    with pytest.raises(ReadError) as caught:
        chosen([lidar(), camera("/one", size=(8, 6), frame_id="left"), camera("/two")], None, ["front", "up"])
    assert caught.value.fields["cameras"] == ["front", "up"]
    first, second = caught.value.fields["candidates"]
    assert first == {"name": "/one", "kind": "camera", "count": 5, "frame_id": "left", "width": 8, "height": 6}
    assert second["name"] == "/two" and "width" not in second
    with pytest.raises(ReadError) as caught:
        chosen([lidar()], "/nothing")
    assert [cloud["fields"] for cloud in caught.value.fields["candidates"]] == ["x y z intensity ring"]
