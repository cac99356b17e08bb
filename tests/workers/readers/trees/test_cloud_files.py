import io

import numpy as np
import pytest
from making_recordings import scene

from workers.readers.recording import ReadError
from workers.readers.trees.cloud_files import is_cloud_table, read_cloud

COLUMNS = {name: values[:100] for name, values in scene().items()}
TABLE = np.column_stack([COLUMNS[name] for name in ("x", "y", "z", "intensity", "ring", "time")])


def npy(array, **how):
    file = io.BytesIO()
    np.save(file, array, **how)
    return file.getvalue()


def refused(data, path):
    with pytest.raises(ReadError) as caught:
        read_cloud(data, path)
    assert path in caught.value.message and caught.value.hint
    return caught.value


def assert_holds(cloud, *names, **how):
    assert list(cloud)[: len(names)] == list(names)
    for name in names:
        np.testing.assert_allclose(cloud[name], COLUMNS[name], rtol=1e-6, **how)


def test_kittis_bin():
    cloud = read_cloud(TABLE[:, :4].astype("<f4").tobytes(), "velodyne_points/data/0000000000.bin")
    assert_holds(cloud, "x", "y", "z", "intensity")
    assert "ring" not in cloud


def test_a_bin_with_rings():
    assert_holds(read_cloud(TABLE[:, :5].astype("<f4").tobytes(), "1.pcd.bin"), "x", "y", "z", "intensity", "ring")


@pytest.mark.parametrize("count", [3, 4, 5, 6])
@pytest.mark.parametrize("form", ["<f4", ">f8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_a_plain_array(count, form, order):
    names = ("x", "y", "z", "intensity", "ring", "time")[:count]
    assert_holds(read_cloud(npy(np.asarray(TABLE[:, :count].astype(form), order=order)), "1.npy"), *names, atol=1e-6)


def test_a_structured_array_with_fields_that_are_no_numbers():
    dtype = np.dtype([("z", "<f4"), ("x", "<f8"), ("y", "<f4"), ("ring", "u1"), ("name", "S3"), ("normal", "<f4", 3)])
    points = np.zeros((10, 10), dtype)
    for name in ("x", "y", "z", "ring"):
        points[name] = COLUMNS[name].reshape(10, 10)
    cloud = read_cloud(npy(points), "1.npy")
    assert set(cloud) == {"x", "y", "z", "ring"}
    assert_holds(cloud, "z", "x", "y", "ring", atol=1e-6)


class Evil:
    def __reduce__(self):
        return (open, ("/tmp/apexcal-must-not-exist", "w"))


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (npy(TABLE)[:-8], "cloud_truncated"),
        (npy(np.array([Evil()], object), allow_pickle=True), "cloud_malformed"),
        (npy(TABLE[:, :2]), "cloud_malformed"),
        (npy(TABLE[0]), "cloud_malformed"),
        (npy(np.float64(3)), "cloud_malformed"),
        (npy(TABLE[:, [0, 1, 2, 3, 5]]), "cloud_malformed"),  # times where the rings should be
        (npy(TABLE).replace(b"(100, 6)", b"(10**9, 6)"[:8]), "cloud_malformed"),
        (npy(TABLE).replace(b"(100, 6), }", b"(-10, 6), }"), "cloud_malformed"),
        (npy(TABLE).replace(b"(100, 6), }          ", b"(9999999999999, 6), }"), "cloud_malformed"),
        (npy(TABLE).replace(b"'<f8'", b"'<Q9'"), "cloud_malformed"),
        (b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 3000, "cloud_malformed"),
        (b"", "cloud_malformed"),
    ],
)
def test_arrays_that_are_no_clouds(data, code):
    assert refused(data, "a/1.npy").code == code


def test_a_bin_of_something_else():
    noise = np.random.default_rng(0).bytes(4096)
    assert "past 2000 m" in refused(noise, "a/1.bin").message
    assert "16 bytes" in refused(noise[:30], "a/1.bin").message


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_table_of_points(delimiter):
    lines = [delimiter.join(("X", "y", " z ", '"ring"', "Reflectance"))]
    rows = zip(*(COLUMNS[name].tolist() for name in ("x", "y", "z", "ring", "intensity")), strict=True)
    lines += [delimiter.join(map(str, row)) for row in rows]
    data = ("\ufeff" + "\r\n".join(lines) + "\r\n").encode()
    assert is_cloud_table(data[:1024])
    assert_holds(read_cloud(data, "1.csv"), "x", "y", "z", "ring", "intensity")


def test_the_columns_of_veloview():
    head = b'"Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2","intensity","laser_id","timestamp"\n'
    assert is_cloud_table(head)
    cloud = read_cloud(head + b"1,2,3,4,5,6\n", "1.csv")
    assert {name: values.tolist() for name, values in cloud.items()} == {
        "x": [1.0],
        "y": [2.0],
        "z": [3.0],
        "intensity": [4.0],
        "laser_id": [5.0],
        "timestamp": [6.0],
    }


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"x,y,z\n1,2\n", "2 values for 3 names"),
        (b"x,y,z\n1,2,oops\n", "oops"),
        (b"x,y,z\n1,2,3\n1,2\n", "columns"),
        (b"x,y,z,x\n1,2,3,4\n", "twice"),
        (b"x,y,z\n\xff\xfe\n", "utf-8"),
    ],
)
def test_tables_that_are_no_clouds(data, said):
    error = refused(data, "a/1.csv")
    assert error.code == "cloud_malformed" and said in error.message


@pytest.mark.parametrize("head", [b"file,stamp_ns\n1.png,3\n", b"", b"x y z\n", b"\xff\xfe\0\0", b"frame,stamp_ns\n"])
def test_other_tables_are_no_clouds(head):
    assert not is_cloud_table(head)


def test_no_points_at_all():
    assert len(read_cloud(b"x,y,z\n", "1.csv")["x"]) == 0
    assert len(read_cloud(b"", "1.bin")["x"]) == 0
    assert len(read_cloud(npy(TABLE[:0]), "1.npy")["x"]) == 0
