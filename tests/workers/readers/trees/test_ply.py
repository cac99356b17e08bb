"""PLY clouds as other tools write them."""

import numpy as np
import pytest
from making_recordings import scene

from workers.readers.detect import open_recording
from workers.readers.recording import ReadError
from workers.readers.trees.cloud_files import read_cloud

COLUMNS = {name: values[:200] for name, values in scene().items()}
FIELDS = (("x", "float", "f4"), ("y", "float32", "f4"), ("z", "double", "f8"), ("intensity", "uchar", "u1"),
          ("ring", "ushort", "u2"))  # fmt: skip


def header(form, count, fields=FIELDS, more=""):
    properties = "".join(f"property {kind} {name}\n" for name, kind, _ in fields)
    return f"ply\nformat {form} 1.0\ncomment made\nelement vertex {count}\n{properties}{more}end_header\n".encode()


def ply(form="binary_little_endian"):
    order = ">" if "big" in form else "<"
    points = np.zeros(200, [(name, order + kind) for name, _, kind in FIELDS])
    for name, _, _ in FIELDS:
        points[name] = COLUMNS[name]
    if form == "ascii":
        body = "\n".join(" ".join(repr(value) for value in row) for row in points.tolist()).encode() + b"\n"
    else:
        body = points.tobytes()
    return (
        header(form, 200, more="element face 1\nproperty list uchar int vertex_indices\n") + body + b"\3" + bytes(12)
    )


def refused(data):
    with pytest.raises(ReadError) as caught:
        read_cloud(data, "clouds/1.ply")
    assert "clouds/1.ply" in caught.value.message and caught.value.hint
    return caught.value


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_every_form_holds_the_same_points(form):
    data = ply(form) if form != "ascii" else ply(form).removesuffix(b"\3" + bytes(12)) + b"3 0 1 2\n"
    cloud = read_cloud(data, "clouds/1.PLY")
    assert list(cloud) == [name for name, _, _ in FIELDS]
    for name in cloud:
        np.testing.assert_allclose(
            cloud[name], COLUMNS[name].astype(np.uint8 if name == "intensity" else float), 1e-6
        )


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (ply()[:2000], "cut short"),
        (b"ply\nformat ascii 1.0\n", "no header"),
        (header("binary_little_endian", 10**11), "no number of vertices"),
        (header("middle_endian", 3) + bytes(99), "states no format"),
        (header("ascii", 2) + b"1 2 3\n4 5 6\n", "3 values for 5 properties"),
        (header("ascii", 3) + b"1 2 3 4 5\n", "1 of 3 points"),
        (header("ascii", 1) + b"a b c d e\n", "no PLY file of points"),
        (header("ascii", 1, (*FIELDS, ("x", "float", "f4"))) + b"1 2 3 4 5 6\n", "names a property twice"),
        (header("ascii", 1, FIELDS[1:]) + b"1 2 3 4\n", "no x, y and z"),
        (ply().replace(b"element vertex 200\n", b"element face 1\nelement vertex 200\n"), "first element"),
        (ply().replace(b"property uchar intensity", b"property list uchar int intensity"), "that is no number"),
    ],
)
def test_what_is_no_cloud_is_refused_with_its_reason(data, says):
    assert says in refused(data).message


def test_a_folder_of_ply_clouds_is_a_recording(tmp_path):
    for number in range(4):
        points = scene(columns=60)
        table = np.column_stack([points[name] for name, _, _ in FIELDS])
        body = "\n".join(" ".join(f"{value:.6g}" for value in row) for row in table)
        (tmp_path / f"{1_700_000_000_000 + 100 * number}.ply").write_bytes(
            header("ascii", len(table)) + body.encode()
        )
    recording = open_recording(tmp_path)
    (lidar,) = recording.sensors
    sweeps = list(recording.sweeps(lidar))
    assert len(sweeps) == 4
    np.testing.assert_allclose(sweeps[1].xyz[:, 0], points["x"], atol=1e-3)
    with pytest.raises(ReadError, match="a single point cloud"):
        open_recording(tmp_path / "1700000000000.ply")
