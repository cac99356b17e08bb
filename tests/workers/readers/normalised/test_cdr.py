import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from workers.readers.normalised.cdr import decode_points, encode_image, encode_points
from workers.readers.recording import ReadError, Sweep

ROS2 = get_typestore(Stores.ROS2_HUMBLE)


def sweep(n, seed=0):
    rng = np.random.default_rng(seed)
    return Sweep(
        stamp_ns=1_700_000_000_123_456_789,
        xyz=rng.normal(size=(n, 3)).astype(np.float32),
        intensity=rng.uniform(0, 255, n).astype(np.float32),
        ring=rng.integers(0, 128, n).astype(np.uint16),
        offset_ns=rng.integers(-(10**8), 10**8, n),
        time_source="per_point",
    )


# Frame names of every length modulo 4, because strings are what shifts the alignment behind them.
@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd", "velodyne", "laser_é"])
@pytest.mark.parametrize("n", [0, 1, 77])
def test_points_read_back_by_rosbags_and_by_us(frame_id, n):
    given = sweep(n)
    message = encode_points(given, frame_id)
    told = ROS2.deserialize_cdr(message, "sensor_msgs/msg/PointCloud2")
    assert told.header.frame_id == frame_id
    assert told.header.stamp.sec * 10**9 + told.header.stamp.nanosec == given.stamp_ns
    assert (told.height, told.width, told.row_step) == (1, n, n * told.point_step)
    assert told.is_dense and not told.is_bigendian
    names, offsets = [f.name for f in told.fields], [f.offset for f in told.fields]
    formats = [{4: "<u2", 5: "<i4", 7: "<f4"}[f.datatype] for f in told.fields]
    layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": told.point_step}
    points = told.data.view(np.dtype(layout))
    np.testing.assert_array_equal(np.stack([points[a] for a in "xyz"], 1), given.xyz)
    for name in ("intensity", "ring", "offset_ns"):
        np.testing.assert_array_equal(points[name], getattr(given, name))

    back = decode_points(message, "per_point")
    assert back.stamp_ns == given.stamp_ns
    for name in ("xyz", "intensity", "ring", "offset_ns"):
        column = getattr(back, name)
        assert column.dtype == getattr(given, name).dtype and column.flags.c_contiguous and column.flags.writeable
        np.testing.assert_array_equal(column, getattr(given, name))


def test_the_image_is_the_tail_of_its_message():
    for frame_id in ("", "a", "ab", "abc", "camera"):
        data = b"\xff\xd8 image"
        message = bytes(encode_image(1_700_000_000_000_000_001, frame_id, "image/jpeg", data))
        told = ROS2.deserialize_cdr(message, "sensor_msgs/msg/CompressedImage")
        assert (told.header.frame_id, told.format, told.data.tobytes()) == (frame_id, "jpeg", b"\xff\xd8 image")
        assert told.header.stamp.nanosec == 1
        assert message.endswith(b"\xff\xd8 image")


def test_a_cloud_of_another_layout_is_refused():
    message = bytes(encode_points(sweep(3), "velodyne"))
    with pytest.raises(ReadError) as refused:
        decode_points(message.replace(b"intensity", b"intensitz"), "per_point")
    assert refused.value.code == "not_normalised"


def test_times_that_do_not_fit_are_refused():
    far = sweep(1)
    far.offset_ns[0] = 2**31
    with pytest.raises(OverflowError):
        encode_points(far, "velodyne")
