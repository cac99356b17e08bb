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


def chosen(sensors, lidar_name=None, cameras=None):
    return {name: s.name for name, s in choose_sensors(Listed(sensors), lidar_name, cameras).items()}


def refused(sensors, lidar_name=None, cameras=None):
    with pytest.raises(ReadError) as caught:
        chosen(sensors, lidar_name, cameras)
    assert caught.value.hint
    return caught.value


def test_one_of_each_needs_no_names():
    sensors = [camera("/cam/image/compressed"), lidar()]
    assert chosen(sensors, cameras=["front"]) == {"lidar": "/velodyne_points", "front": "/cam/image/compressed"}
    assert chosen(sensors, cameras={"front": None}) == chosen(sensors, cameras=["front"])
    assert chosen(sensors) == {"lidar": "/velodyne_points", "cam_image": "/cam/image/compressed"}
    assert chosen(sensors, cameras=[]) == {"lidar": "/velodyne_points"}


def test_a_cloud_without_rings_is_not_the_lidar_where_another_has_them():
    assert chosen([lidar("/depth", "x y z rgb"), lidar()], cameras=[])["lidar"] == "/velodyne_points"


def test_a_raw_camera_gives_way_to_its_compressed_twin():
    sensors = [lidar(), camera("/cam/image_raw"), camera("/cam/image_raw/compressed")]
    assert chosen(sensors, cameras=["front"])["front"] == "/cam/image_raw/compressed"
    assert chosen(sensors, cameras={"front": "/cam/image_raw"})["front"] == "/cam/image_raw"


def test_cameras_are_told_by_their_names_in_the_topics():
    sensors = [lidar(), camera("/camera_rear/image"), camera("/camera_front/image"), camera("/camera_left/image")]
    assert chosen(sensors, cameras=["front", "rear"]) == {
        "lidar": "/velodyne_points",
        "front": "/camera_front/image",
        "rear": "/camera_rear/image",
    }
    assert list(chosen(sensors, cameras={"rear": None, "x": "/camera_left/image"})) == ["lidar", "rear", "x"]


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
    recording = Listed([camera("/cam")], (topic, "/imu (sensor_msgs/Imu)"))
    with pytest.raises(ReadError) as caught:
        choose_sensors(recording, None, None)
    assert caught.value.code == "lidar_packets_not_read"
    assert maker in caught.value.message and topic in caught.value.message and "/imu" not in caught.value.message


def test_what_the_recording_holds_is_listed():
    error = refused([camera("/cam")])
    assert error.code == "no_lidar_topic" and "/cam (camera, 5 messages)" in error.message and "/imu" in error.message
    assert refused([camera("/cam"), lidar(count=0)]).code == "no_lidar_topic"
    error = refused([lidar()], cameras=["front"])
    assert error.code == "no_camera_topic" and "/velodyne_points" in error.message


def test_what_is_not_clear_is_asked():
    error = refused([lidar("/a"), lidar("/b")], cameras=[])
    assert error.code == "ambiguous_lidar" and "/a, /b" in error.message
    assert chosen([lidar("/a"), lidar("/b")], "/b", []) == {"lidar": "/b"}
    sensors = [lidar(), camera("/one"), camera("/two")]
    error = refused(sensors, cameras=["front"])
    assert error.code == "ambiguous_cameras" and "/one, /two" in error.message
    assert refused(sensors, cameras=["a", "b", "c"]).code == "ambiguous_cameras"
    both = [lidar(), camera("/front_rear/image"), camera("/x")]
    assert refused(both, cameras=["front", "rear"]).code == "ambiguous_cameras"


def test_a_topic_that_is_not_there_or_is_of_another_kind():
    error = refused([lidar(), camera("/cam")], "/cam", [])
    assert error.code == "topic_not_found" and "no LiDAR topic '/cam'" in error.message
    assert refused([lidar(), camera("/cam")], None, {"front": "/camm"}).code == "topic_not_found"


@pytest.mark.parametrize("name", ["", "../x", "a/b", "lidar", "a" * 65, "-x", "ä"])
def test_camera_names_become_file_names(name):
    assert refused([lidar(), camera("/cam")], None, [name]).code == "camera_name_invalid"


def guessed(topics, sizes):
    listed = Listed([lidar(), *topics])
    return {name: s.name for name, s in choose_sensors(listed, None, list(sizes), sizes).items() if name != "lidar"}


def test_the_car_with_eleven_cameras():
    places = ["front", "front_left", "front_right", "left", "right", "rear", "rear_left", "rear_right"]
    topics = [camera(f"/camera_{place}/image_raw/compressed") for place in places]
    topics += [camera(f"/camera_{place}/depth/image") for place in places]
    narrow = [
        camera("/tele/image_color"),
        camera("/svs/FisheyeTop/image"),
        camera("/x/image", frame_id="camera_trunk_optical"),
    ]
    sizes = dict.fromkeys([*places, "tele", "fisheye_top", "trunk"])
    found = guessed([*topics, *narrow], sizes)
    assert found.pop("trunk") == "/x/image" and found.pop("tele") == "/tele/image_color"
    assert found.pop("fisheye_top") == "/svs/FisheyeTop/image"
    assert found == {place: f"/camera_{place}/image_raw/compressed" for place in places}


def test_images_of_another_size_are_another_camera():
    topics = [camera("/a", size=(1920, 1208)), camera("/b", size=(640, 480)), camera("/c", size=(320, 240))]
    assert guessed(topics, {"wide": (640, 480), "tele": (1920, 1208)}) == {"wide": "/b", "tele": "/a"}
    assert guessed(topics, {"wide": (640, 480)}) == {"wide": "/b"}
    assert guessed([camera("/a", size=(640, 480))], {"front": (1280, 720)}) == {
        "front": "/a"
    }  # the size gets reported later
    with pytest.raises(ReadError, match="not clear"):
        guessed(topics[:2], {"one": (100, 100), "two": (100, 100)})


def test_what_is_computed_from_a_sensor_is_not_the_sensor():
    clouds = [lidar("/velodyne_points"), lidar("/ground_filtered/points"), lidar("/points_map")]
    assert chosen(clouds, cameras=[])["lidar"] == "/velodyne_points"
    packets = Sensor("lidar", "/velodyne_packets", "velodyne", 5, {"fields": "x y z intensity ring time"})
    assert chosen([lidar(), packets], cameras=[])["lidar"] == "/velodyne_packets"  # one sensor twice, once timed
    topics = [camera("/c/image_rect_color"), camera("/c/image_raw"), camera("/c/image_color"), camera("/still", 1)]
    assert (
        chosen([lidar(), *(camera(t.name, 100) for t in topics[:3]), topics[3]], cameras=["x"])["x"] == "/c/image_raw"
    )
    assert chosen([lidar(), camera("/depth")], cameras=["x"])["x"] == "/depth"


def test_a_program_is_told_what_there_is_to_choose_from():
    error = refused([lidar(), camera("/one", size=(8, 6), frame_id="left"), camera("/two")], cameras=["front", "up"])
    assert error.fields["cameras"] == ["front", "up"]
    one, two = error.fields["candidates"]
    assert one == {"name": "/one", "kind": "camera", "count": 5, "frame_id": "left", "width": 8, "height": 6}
    assert two["name"] == "/two" and "width" not in two
    (cloud,) = refused([lidar()], "/nothing").fields["candidates"]
    assert cloud["fields"] == "x y z intensity ring"
    many = [camera(f"/{i}") for i in range(3000)]
    error = refused([lidar(), *many], cameras=["front"])
    assert len(error.fields["candidates"]) == 100 and len(error.message) < 5000


def test_equal_names_are_counted():
    names = chosen([lidar(), camera("/cam/a"), camera("/cam_a"), camera("/lidar")])
    assert names == {"lidar": "/velodyne_points", "cam_a": "/cam/a", "cam_a_2": "/cam_a", "lidar_2": "/lidar"}


def test_thousands_of_folders_are_refused():
    error = refused([lidar(), *(camera(f"/c{i}") for i in range(2000))], cameras=["front"])
    assert error.code == "too_many_sensors" and "2001" in error.message
    assert refused([lidar(), *(camera(f"/c{i}") for i in range(1999))], cameras=["front"]).code == "ambiguous_cameras"
