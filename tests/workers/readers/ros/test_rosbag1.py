from pathlib import Path

import numpy as np
import pytest
from making_bombs import repeated_index
from making_packets import packets
from making_recordings import (
    CLOUD,
    DATA,
    IMAGE,
    PERIOD_NS,
    PLAIN,
    START_NS,
    cloud,
    clouds,
    compressed,
    header,
    images,
    interleaved,
    jpeg_claiming,
    png,
    raw_image,
    scattered,
    scene,
    write_bag,
)
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from workers.readers.recording import Frame, ReadError, ReadOptions, Sweep
from workers.readers.ros.rosbag1 import Rosbag1Recording

BAG = DATA / "vlp16-diamond-board" / "recording.bag"


def read(path, options=None):
    bag = Rosbag1Recording(path, options or ReadOptions())
    try:
        return bag.sensors, list(bag.messages(bag.sensors)), bag.warnings
    finally:
        bag.close()


def failure(path):
    with pytest.raises(ReadError) as caught:
        read(path)
    assert caught.value.hint
    return caught.value


def sweeps_of(messages):
    return [item for _, item in messages if isinstance(item, Sweep)]


def assert_scene(sweep, stamp_ns):
    columns = scene()
    assert sweep.stamp_ns == stamp_ns
    np.testing.assert_array_equal(sweep.xyz, np.stack([columns[a] for a in "xyz"], 1).astype(np.float32))
    np.testing.assert_array_equal(sweep.ring, columns["ring"])
    np.testing.assert_allclose(sweep.offset_ns, columns["time"] * 1e9, atol=10)


@pytest.mark.parametrize("compression", [None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_both_sensors_in_one_pass_in_recorded_order(tmp_path, compression):
    path = write_bag(tmp_path / "a.bag", interleaved(clouds(), images()), compression)
    sensors, messages, warnings = read(path)
    assert {(s.kind, s.name, s.frame_id, s.count) for s in sensors} == {
        ("lidar", "/points", "velodyne", 5),
        ("camera", "/camera/compressed", "camera", 5),
    }
    assert [sensor.kind for sensor, _ in messages] == ["lidar", "camera"] * 5
    for i, sweep in enumerate(sweeps_of(messages)):
        assert_scene(sweep, START_NS + i * PERIOD_NS)
    frames = [item for _, item in messages if isinstance(item, Frame)]
    assert [f.data for f in frames] == [png(8, 6, i) for i in range(5)]
    assert not any(f.transcoded for f in frames) and warnings == []


@pytest.mark.parametrize(
    "how",
    [
        {"fields": {"ring": "u1", "time": "f8", "z": "f8", "y": "f4", "x": "f8", "intensity": "u1"}},
        {"big_endian": True},
        {"gap": 4, "padding": 6, "height": 16},
    ],
)
def test_any_cloud_layout(tmp_path, how):
    _, messages, _ = read(write_bag(tmp_path / "a.bag", clouds(2, **how)))
    assert_scene(sweeps_of(messages)[1], START_NS + PERIOD_NS)


def test_raw_images_become_png(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
    path = write_bag(tmp_path / "a.bag", [("/image", IMAGE, START_NS, raw_image(START_NS, pixels, "rgb8", step=32))])
    _, [(_, frame)], _ = read(path)
    assert (frame.media_type, frame.width, frame.height, frame.transcoded) == ("image/png", 8, 6, True)


def test_a_stamp_of_zero_is_replaced_and_said(tmp_path):
    path = write_bag(tmp_path / "a.bag", [("/points", CLOUD, START_NS, cloud(0, scene()))])
    _, [(_, sweep)], warnings = read(path)
    assert sweep.stamp_ns == START_NS and "no stamp of their own" in warnings[0]


def test_a_cloud_without_rings(tmp_path):
    fields = {name: form for name, form in PLAIN.items() if name != "ring"}
    _, [(_, sweep), *_], _ = read(write_bag(tmp_path / "a.bag", clouds(fields=fields)))
    np.testing.assert_array_equal(sweep.ring, scene()["ring"])
    error = failure(write_bag(tmp_path / "b.bag", clouds(columns=scattered(), fields=dict.fromkeys("xyz", "f4"))))
    assert error.code == "rings_not_separable" and "/points" in error.message


def test_an_image_that_claims_60000_by_60000(tmp_path):
    error = failure(write_bag(tmp_path / "a.bag", images(1, data=jpeg_claiming(60000, 60000))))
    assert error.code == "image_too_large" and "/camera/compressed" in error.message


def test_an_image_that_is_none(tmp_path):
    path = write_bag(
        tmp_path / "a.bag",
        [("/c", "sensor_msgs/msg/CompressedImage", START_NS, compressed(START_NS, b"no image at all"))],
    )
    assert failure(path).code == "image_unsupported"


@pytest.mark.parametrize("part", [0.999, 0.5, 0.01])
def test_a_truncated_bag_says_where_it_ends(tmp_path, part):
    path = write_bag(tmp_path / "a.bag", clouds(20))
    size = int(path.stat().st_size * part)
    path.write_bytes(path.read_bytes()[:size])
    error = failure(path)
    assert error.code == "recording_truncated"
    assert part == 0.999 or f"{size}" in error.message


def test_a_bag_that_was_never_closed(tmp_path):
    path = write_bag(tmp_path / "a.bag", clouds(3))
    data = bytearray(path.read_bytes())
    place = data.find(b"index_pos=") + 10
    data[place : place + 8] = bytes(8)
    path.write_bytes(data)
    error = failure(path)
    assert error.code == "recording_not_indexed" and "reindex" in error.hint


def test_damage_anywhere_is_a_clear_answer(tmp_path):
    whole = write_bag(
        tmp_path / "a.bag", interleaved(clouds(3), images(3)), Writer.CompressionFormat.LZ4
    ).read_bytes()
    rng = np.random.default_rng(0)
    codes = set()
    for _ in range(150):
        data = bytearray(whole)
        start = int(rng.integers(13, len(data) - 16))
        data[start : start + 16] = rng.integers(0, 255, 16, np.uint8).tobytes()
        path = tmp_path / "b.bag"
        path.write_bytes(data)
        try:
            read(path)
        except ReadError as error:
            codes.add(error.code)
    assert "recording_damaged" in codes


def test_the_real_bag():
    if not BAG.exists():
        pytest.skip("real data is not here: ../shared/data/vlp16-diamond-board")
    _, messages, _ = read(BAG)
    sweeps = sweeps_of(messages)
    frames = [item for _, item in messages if isinstance(item, Frame)]
    assert (len(sweeps), len(frames)) == (20, 20)
    assert {(f.width, f.height, f.media_type) for f in frames} == {(1920, 1208, "image/jpeg")}
    for sweep in sweeps:
        elevation = np.degrees(np.arctan2(sweep.xyz[:, 2], np.hypot(sweep.xyz[:, 0], sweep.xyz[:, 1])))
        medians = [np.median(elevation[sweep.ring == ring]) for ring in range(16)]
        np.testing.assert_allclose(medians, np.arange(-15, 16, 2), atol=0.3)
        assert sweep.time_source == "derived_from_azimuth"
        # A little more than a turn, measured in file order.
        assert sweep.offset_ns.min() >= -100_000 and 100_000_000 <= sweep.offset_ns.max() < 101_500_000
        assert np.mean(np.diff(sweep.offset_ns) >= -100_000) > 0.99


def test_the_real_bag_as_static_poses():
    if not BAG.exists():
        pytest.skip("real data is not here: ../shared/data/vlp16-diamond-board")
    _, messages, _ = read(BAG, ReadOptions(point_times="stamp_only"))
    assert not any(sweep.offset_ns.any() for sweep in sweeps_of(messages))


def test_packets_and_intrinsics(tmp_path):
    scan, info = "velodyne_msgs/msg/VelodyneScan", "sensor_msgs/msg/CameraInfo"
    text = (
        "Header header\nVelodynePacket[] packets\n" + "=" * 80 + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\n"
        "string frame_id\n" + "=" * 80 + "\nMSG: velodyne_msgs/VelodynePacket\ntime stamp\nuint8[1206] data\n"
    )
    types = get_typestore(Stores.ROS1_NOETIC)
    types.register({k: v for k, v in get_types_from_msg(text, scan).items() if k not in types.fielddefs})
    stream = list(packets())
    roi = types.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    eye, none = np.eye(3).reshape(-1), np.zeros(12)
    with Writer(tmp_path / "a.bag") as bag:
        topics = {
            name: bag.add_connection(name, kind, typestore=types)
            for name, kind in (("/packets", scan), ("/cam/camera_info", info), ("/cam/image_raw", IMAGE))
        }
        for start in range(0, len(stream), 76):
            part = stream[start : start + 76]
            at = part[-1][0] + 1_327_104
            made = [
                types.types["velodyne_msgs/msg/VelodynePacket"](
                    types.types["builtin_interfaces/msg/Time"](*divmod(moment + 1_327_104, 1_000_000_000)),
                    np.frombuffer(data, np.uint8),
                )
                for moment, data in part
            ]
            bag.write(
                topics["/packets"], at, types.serialize_ros1(types.types[scan](header(at, "lidar"), made), scan)
            )
            lens = types.types[info](
                *(header(at, "camera"), 6, 8, "equidistant", np.ones(4), eye, eye, none, 0, 0, roi)
            )
            bag.write(topics["/cam/camera_info"], at, types.serialize_ros1(lens, info))
            image = raw_image(at, np.zeros((6, 8), np.uint8), "mono8")
            bag.write(topics["/cam/image_raw"], at, types.serialize_ros1(image, IMAGE))
    sensors, messages, warnings = read(tmp_path / "a.bag")
    assert [len(s.xyz) for s in sweeps_of(messages)].count(0) == 0 and len(sweeps_of(messages)) == 4
    assert sum(len(s.xyz) for s in sweeps_of(messages)) == len(stream) * 24 * 16 and warnings == []
    (camera,) = (s for s in sensors if s.kind == "camera")
    assert camera.camera_info["model"] == "kannala_brandt" and camera.camera_info["D"] == [1.0] * 4


def test_a_bag_that_is_refused_is_closed(tmp_path):
    bag = repeated_index(tmp_path / "again.bag", 2)
    with pytest.raises(ReadError, match="the same message more than once") as refused:
        Rosbag1Recording(bag, ReadOptions())
    assert refused.value  # its traceback still holds what was opened
    assert bag.resolve() not in {link.resolve() for link in Path("/proc/self/fd").iterdir()}
