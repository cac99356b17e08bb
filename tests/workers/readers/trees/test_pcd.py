import numpy as np
import pytest
from making_recordings import scene
from pypcd4 import Encoding, PointCloud

from workers.readers.recording import ReadError
from workers.readers.trees.pcd import read_pcd

FIELDS = ("x", "y", "z", "intensity", "ring")
TYPES = (np.float32, np.float32, np.float32, np.float32, np.uint16)


def columns():
    return [scene()[name].astype(form) for name, form in zip(FIELDS, TYPES, strict=True)]


def saved(path, encoding):
    PointCloud.from_points(columns(), FIELDS, TYPES).save(path, encoding)
    return path.read_bytes()


@pytest.mark.parametrize("encoding", list(Encoding)[:3])
def test_every_encoding(tmp_path, encoding):
    read = read_pcd(saved(tmp_path / "a.pcd", encoding), "a.pcd")
    assert list(read) == list(FIELDS)
    for values, given in zip(read.values(), columns(), strict=True):
        np.testing.assert_allclose(values, given, rtol=1e-6, atol=1e-6)


def test_ascii_with_blanks_before_the_line_ends_and_windows_line_ends(tmp_path):
    data = saved(tmp_path / "a.pcd", Encoding.ASCII).replace(b"\n", b" \r\n")
    assert len(read_pcd(data, "a.pcd")["x"]) == len(columns()[0])


def test_padding_fields_are_left_out_and_one_point_is_an_array():
    head = b"VERSION 0.7\nFIELDS x y z _ ring\nSIZE 4 4 4 1 2\nTYPE F F F U U\nCOUNT 1 1 1 2 1\nWIDTH 1\nHEIGHT 1\n"
    body = np.array([1, 2, 3], "<f4").tobytes() + b"\0\0" + np.array([7], "<u2").tobytes()
    read = read_pcd(head + b"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA binary\n" + body, "a.pcd")
    assert list(read) == ["x", "y", "z", "ring"] and read["ring"].tolist() == [7]


@pytest.mark.parametrize("encoding", list(Encoding)[:3])
def test_cut_short(tmp_path, encoding):
    data = saved(tmp_path / "a.pcd", encoding)
    with pytest.raises(ReadError) as caught:
        read_pcd(data[: len(data) * 2 // 3], "a.pcd")
    assert caught.value.code in ("cloud_truncated", "cloud_malformed") and "a.pcd" in caught.value.message


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"POINTS 1440", b"POINTS 999999999"),
        (b"DATA binary_compressed", b"NOTHING"),
        (b"SIZE 4 4 4 4 2", b"SIZE 4 4 4 4 3"),
        (b"COUNT 1 1 1 1 1", b"COUNT 1 1 1 1 9999999"),
        (b"POINTS 1440", b"POINTS 1000"),
        (b"TYPE F F F F U", b"TYPE F F F F X"),
    ],
)
def test_headers_that_contradict_the_file(tmp_path, old, new):
    data = saved(tmp_path / "a.pcd", Encoding.BINARY_COMPRESSED)
    assert old in data
    with pytest.raises(ReadError) as caught:
        read_pcd(data.replace(old, new), "a.pcd")
    assert caught.value.code == "cloud_malformed"
