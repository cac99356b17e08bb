import numpy as np
import pytest

from apexcal.documents.sensor_files import SWEEP_ENTRY, TAIL, sweep_index_at
from workers.readers.normalised.sensor_files import FrameFile, SweepFile
from workers.readers.normalised.sensor_writers import FrameWriter, SweepWriter, check_item
from workers.readers.recording import Frame, LidarFacts, MessageError, ReadError, Sensor, Sweep

FACTS = LidarFacts(16, 100_000_000, "end", "per_point", ())
LIDAR, CAMERA = Sensor("lidar", "/points", "velodyne", None), Sensor("camera", "/cam", "camera", None)


def sweep(number, stamp_ns, n=3000):
    """Positions and times are whole steps of what is stored, so that nothing is rounded."""
    rng = np.random.default_rng(number)
    return Sweep(
        stamp_ns,
        (rng.integers(-(10**6), 10**6, (n, 3)) * 1e-4).astype(np.float32),
        np.full(n, number, np.float32),
        np.sort(rng.integers(0, 16, n)).astype(np.uint16),
        1000 * rng.integers(0, 10**5, n),
        "per_point",
    )


def write(path, sweeps):
    writer = SweepWriter(path, LIDAR, FACTS)
    for item in sweeps:
        writer.add(item)
    stamps = np.array([item.stamp_ns for item in sweeps], np.int64)
    writer.finish(stamps, np.argsort(stamps, kind="stable"))
    return path


def test_sweeps_by_index_and_range_are_what_was_written(tmp_path):
    given = [sweep(i, 1000 + i * 100, 0 if i == 4 else 900) for i in range(30)]
    with SweepFile(write(tmp_path / "lidar.sweeps", given)) as file:
        assert (len(file), file.frame_id, file.topic, file.ring_count) == (30, "velodyne", "/points", 16)
        assert (file.time_source, file.stamp_convention, file.sweep_ns) == ("per_point", "end", 100_000_000)
        np.testing.assert_array_equal(file.stamps_ns, [s.stamp_ns for s in given])
        for index in (29, 0, 17, 16, 4):
            read = file.sweep(index)
            for name in ("xyz", "intensity", "ring", "offset_ns"):
                np.testing.assert_array_equal(getattr(read, name), getattr(given[index], name))
                assert getattr(read, name).dtype == getattr(given[index], name).dtype
            assert read.stamp_ns == given[index].stamp_ns and read.time_source == "per_point"
        assert [s.stamp_ns for s in file.sweeps(10, 13)] == [2000, 2100, 2200]
        assert len(list(file.sweeps())) == 30
        assert [file.nearest(t) for t in (0, 1000, 1050, 1051, 2340, 3900, 10**18)] == [0, 0, 0, 1, 13, 29, 29]
        for index in (30, -1):
            with pytest.raises(IndexError):
                file.sweep(index)
        with pytest.raises(ValueError, match="read-only"):
            file.stamps_ns[0] = 1


def test_no_sweeps_and_sweeps_out_of_order(tmp_path):
    given = [sweep(i, stamp) for i, stamp in enumerate([30, 10, 20, 10])]
    with SweepFile(write(tmp_path / "lidar.sweeps", given)) as file:
        assert file.stamps_ns.tolist() == [10, 10, 20, 30]
        assert [float(s.intensity[0]) for s in file.sweeps()] == [1, 3, 2, 0]
    with SweepFile(write(tmp_path / "none.sweeps", [])) as file:
        assert len(file) == 0 and list(file.sweeps()) == []
        with pytest.raises(IndexError):
            file.nearest(0)


def test_the_index_is_found_by_size_and_count_and_names_the_bytes(tmp_path):
    whole = write(tmp_path / "lidar.sweeps", [sweep(i, stamp) for i, stamp in enumerate([30, 10])]).read_bytes()
    at = sweep_index_at(len(whole), 2)
    entries = list(SWEEP_ENTRY.iter_unpack(whole[at : -TAIL.size]))
    assert [entry[0] for entry in entries] == [10, 30] and entries[1][1] == 0
    for _, offset, length, points in entries:
        assert whole[offset : offset + 2] == b"\x1f\x8b" and offset + length <= at and points == 3000


def test_frames_are_their_bytes_in_the_order_that_is_stated(tmp_path):
    writer = FrameWriter(tmp_path / "camera.images", CAMERA)
    for number, kind in enumerate(("jpeg", "png", "jpeg")):
        writer.add(Frame(number, f"image {number}".encode(), f"image/{kind}", 4, 3 + number))
    writer.finish(np.array([7, 5, 6]), np.array([1, 0]))
    with FrameFile(tmp_path / "camera.images") as file:
        assert [file.data(index) for index in range(len(file))] == [b"image 1", b"image 0"]
        whole = {"offset": 7, "length": 7, "width": 4, "height": 4, "media_type": "image/png"}
        assert next(iter(file.rows())) == {"index": 0, "stamp_ns": 5} | whole


def altered(whole: bytes, place: int, value: int) -> bytes:
    """A file whose last 32 bytes, or the index before them, say something else."""
    at = len(whole) - TAIL.size + place
    return whole[:at] + value.to_bytes(8, "little") + whole[at + 8 :]


def test_other_files_are_refused(tmp_path):
    camera = FrameWriter(tmp_path / "camera", CAMERA)
    camera.add(Frame(1, b"bytes", "image/png", 4, 3))
    camera.finish(np.array([1]), np.array([0]))
    whole = write(tmp_path / "lidar", [sweep(0, 5)]).read_bytes()
    files = {
        "text": b"no sweeps",
        "cut": whole[:-100],
        "facts": altered(whole, 0, 2**63),
        "index": altered(whole, 8, 3),
        "offset": altered(whole, 8 - SWEEP_ENTRY.size, len(whole)),
        "far": altered(whole, 8 - SWEEP_ENTRY.size, 2**63 - 1),
        "points": altered(whole, -4, 2**24 + 1 + (int.from_bytes(whole[-TAIL.size :][:4], "little") << 32)),
        "camera": (tmp_path / "camera").read_bytes(),
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ReadError) as caught:
            SweepFile(tmp_path / name)
        assert caught.value.code == "not_normalised" and caught.value.message.startswith(name)


def test_a_sweep_of_other_bytes_is_refused(tmp_path):
    path = write(tmp_path / "lidar", [sweep(0, 5), sweep(1, 6)])
    whole = bytearray(path.read_bytes())
    whole[2000:2100] = bytes(100)
    path.write_bytes(whole)
    with SweepFile(path) as file:
        with pytest.raises(ReadError) as caught:
            file.sweep(0)
        assert caught.value.code == "not_normalised" and "sweep 0" in caught.value.message
        assert len(file.sweep(1).xyz) == 3000


@pytest.mark.parametrize("stamp", [-1, 2**31 * 10**9])
def test_stamps_that_no_message_can_hold(stamp):
    with pytest.raises(MessageError) as caught:
        check_item(sweep(0, stamp), "/points")
    assert caught.value.code == "stamp_out_of_range"
