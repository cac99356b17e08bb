import numpy as np
import pytest

from workers.readers.normalised.lidar_file import LidarFile
from workers.readers.normalised.mcap_files import CameraWriter, LidarWriter, check_item
from workers.readers.recording import Frame, LidarFacts, MessageError, ReadError, Sweep

FACTS = LidarFacts(16, 100_000_000, "end", "per_point", ())


def sweep(number, stamp_ns, n=3000):
    rng = np.random.default_rng(number)
    return Sweep(
        stamp_ns,
        rng.normal(size=(n, 3)).astype(np.float32),
        np.full(n, number, np.float32),
        rng.integers(0, 16, n).astype(np.uint16),
        rng.integers(0, 10**8, n),
        "per_point",
    )


def write(path, sweeps):
    writer = LidarWriter(path, "/points", "velodyne")
    for item in sweeps:
        writer.add(item)
    writer.finish(FACTS)
    return path


def test_sweeps_by_index_and_range_are_what_was_written(tmp_path):
    given = [sweep(i, 1000 + i * 100, 0 if i == 4 else 9000) for i in range(30)]  # several chunks
    with LidarFile(write(tmp_path / "lidar.mcap", given)) as file:
        assert (len(file), file.frame_id, file.topic, file.ring_count) == (30, "velodyne", "/points", 16)
        assert (file.time_source, file.stamp_convention, file.sweep_ns) == ("per_point", "end", 100_000_000)
        np.testing.assert_array_equal(file.stamps_ns, [s.stamp_ns for s in given])
        for index in (29, 0, 17, 16, 4):
            read = file.sweep(index)
            for name in ("xyz", "intensity", "ring", "offset_ns"):
                np.testing.assert_array_equal(getattr(read, name), getattr(given[index], name))
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
    with LidarFile(write(tmp_path / "lidar.mcap", given)) as file:
        assert file.stamps_ns.tolist() == [10, 10, 20, 30]
        assert [float(s.intensity[0]) for s in file.sweeps()] == [1, 3, 2, 0]
    with LidarFile(write(tmp_path / "none.mcap", [])) as file:
        assert len(file) == 0 and list(file.sweeps()) == []
        with pytest.raises(IndexError):
            file.nearest(0)


def test_other_files_are_refused(tmp_path):
    camera = CameraWriter(tmp_path / "camera.mcap", "/cam", "camera")
    camera.add(Frame(1, b"bytes", "image/png", 4, 3))
    camera.finish()
    whole = write(tmp_path / "lidar.mcap", [sweep(0, 5)]).read_bytes()
    (tmp_path / "text.mcap").write_text("no MCAP")
    (tmp_path / "cut.mcap").write_bytes(whole[:-100])
    for name in ("camera", "text", "cut"):
        with pytest.raises(ReadError) as caught:
            LidarFile(tmp_path / f"{name}.mcap")
        assert caught.value.code == "not_normalised" and f"{name}.mcap" in caught.value.message


@pytest.mark.parametrize("stamp", [-1, 2**31 * 10**9])
def test_stamps_that_no_message_can_hold(stamp):
    with pytest.raises(MessageError) as caught:
        check_item(sweep(0, stamp), "/points")
    assert caught.value.code == "stamp_out_of_range"
