"""Tables of points that name no column: their number and meaning follow from what they hold."""

import numpy as np
import pytest
from formats import folder_of, npy, read, sweeps_of
from making_recordings import PERIOD_NS, START_NS, png, scene

from workers.readers.recording import ReadError

COUNT = 4


def sweep(number, rings=16, columns=125):
    """A sweep whose intensities and ranges differ from the next one's: 2,000 points, which 3 to 8 columns divide."""
    cloud = scene(rings, columns)
    rng = np.random.default_rng(number)
    stretch = 1 + 0.3 * np.sin(5 * np.arctan2(cloud["y"], cloud["x"]) + number)
    for axis in "xyz":
        cloud[axis] = cloud[axis] * stretch
    cloud["intensity"] = rng.gamma(2.0, 12.0, len(stretch)).clip(0, 255).round()
    return cloud


def walk(path, suffix, write, **how):
    """A folder of clouds as ``write`` has them, and images; names are times."""
    files = {f"clouds/{START_NS + i * PERIOD_NS}.{suffix}": write(sweep(i, **how)) for i in range(COUNT)}
    files |= {f"images/{START_NS + i * PERIOD_NS}.png": png(8, 6, i) for i in range(COUNT)}
    return folder_of(path / "walk", files)


def table(cloud, names):
    cloud = cloud | {"zero": np.zeros(len(cloud["x"])), "lag": np.linspace(0, 0.1, len(cloud["x"]))}
    cloud |= {"unit": cloud["intensity"] / 255, "snr": 30 + 8 * np.sin(np.arange(len(cloud["x"])))}
    return np.column_stack([cloud[name] for name in names])


def by_ring(cloud):
    order = np.lexsort((cloud["time"], -cloud["ring"]))
    return {name: values[order] for name, values in cloud.items()}


def shuffled(cloud):
    order = np.random.default_rng(9).permutation(len(cloud["x"]))
    return {name: values[order] for name, values in cloud.items()}


LAYOUTS = {
    "x y z": ("x", "y", "z"),
    "KITTI": ("x", "y", "z", "unit"),
    "without intensities": ("x", "y", "z", "zero"),
    "nuScenes": ("x", "y", "z", "intensity", "ring"),
    "with a time": ("x", "y", "z", "intensity", "time"),
    "Boreas": ("x", "y", "z", "intensity", "ring", "time"),
    "time before the ring": ("x", "y", "z", "intensity", "time", "ring"),
    "with a noise ratio": ("x", "y", "z", "unit", "ring", "snr"),
    "seven": ("x", "y", "z", "intensity", "ring", "snr", "time"),
    "eight": ("x", "y", "z", "intensity", "ring", "time", "zero", "snr"),
}


@pytest.mark.parametrize("order", [dict, by_ring, shuffled])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_bin_of_any_columns(tmp_path, layout, order):
    names = LAYOUTS[layout]
    path = walk(tmp_path, "bin", lambda cloud: table(order(cloud), names).astype("<f4").tobytes())
    sweeps = sweeps_of(read(path)[1])
    assert len(sweeps) == COUNT
    for number, item in enumerate(sweeps):
        cloud = order(sweep(number))
        np.testing.assert_array_equal(item.xyz, np.column_stack([cloud[a] for a in "xyz"]).astype(np.float32))
        assert item.ring.tolist() == cloud["ring"].tolist()
        intensity = next((name for name in names if name in ("intensity", "unit", "zero")), "zero")
        assert item.intensity.tolist() == table(cloud, [intensity])[:, 0].astype(np.float32).tolist()
        if "time" in names and order is not shuffled:
            assert item.time_source == "per_point"
            assert np.abs(item.offset_ns - cloud["time"] * 1e9).max() < 10


@pytest.mark.parametrize("names", [LAYOUTS["Boreas"], LAYOUTS["with a time"], LAYOUTS["nuScenes"]])
@pytest.mark.parametrize("suffix", ["npy", "csv"])
def test_plain_arrays_and_tables_are_told_alike(tmp_path, suffix, names):
    def write(cloud):
        rows = table(cloud, names)
        return (
            npy(rows) if suffix == "npy" else "\n".join(" ,".join(map(repr, row)) for row in rows.tolist()).encode()
        )

    first = sweeps_of(read(walk(tmp_path, suffix, write))[1])[0]
    cloud = sweep(0)
    assert first.ring.tolist() == cloud["ring"].tolist() and first.intensity.tolist() == cloud["intensity"].tolist()
    assert ("time" in names) == (first.time_source == "per_point")


@pytest.mark.parametrize(
    "names",
    [("time", "x", "y", "z", "intensity"), ("x", "y", "z", "ring"), ("x", "y", "z", "ring", "intensity", "time")],
)
def test_a_table_without_a_header_in_another_order(tmp_path, names):
    rows = lambda cloud: "\n".join(";".join(map(repr, row)) for row in table(cloud, names).tolist()).encode()  # noqa: E731
    first = sweeps_of(read(walk(tmp_path, "csv", rows))[1])[0]
    cloud = sweep(0)
    np.testing.assert_allclose(first.xyz[:, 0], cloud["x"], rtol=1e-6)
    assert first.ring.tolist() == cloud["ring"].tolist()
    assert ("time" in names) == (first.time_source == "per_point")


@pytest.mark.parametrize(
    "rows",
    [
        np.random.default_rng(0).normal(size=(500, 7)),  # poses
        np.column_stack([np.arange(500), np.arange(500) % 7, np.arange(500) % 3, np.ones(500)]),
        np.random.default_rng(0).normal(size=(500, 3)) * 1e6,  # of a map
    ],
)
def test_a_table_that_may_be_anything_is_asked_for_a_header(tmp_path, rows):
    text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    with pytest.raises(ReadError, match="no header line") as caught:
        read(walk(tmp_path, "csv", lambda cloud: text.encode()))
    assert "x,y,z,intensity,ring" in caught.value.hint


def test_a_table_of_numbers_beside_clouds_is_none(tmp_path):
    path = walk(tmp_path, "bin", lambda cloud: table(cloud, LAYOUTS["KITTI"]).astype("<f4").tobytes())
    (path / "poses.csv").write_text("1.5,2.5,3.5\n" * 20)
    recording, items, _ = read(path)
    assert len(sweeps_of(items)) == COUNT and "poses.csv (not read)" in recording.other_topics


@pytest.mark.parametrize("names", [LAYOUTS["x y z"], LAYOUTS["KITTI"]])
@pytest.mark.parametrize(
    ("far", "near"),
    [([5, 3, 1.8], [-4, -3.5, -1.2]), ([20, 12, 6], [-15, -9, -1.5]), ([60, 12, 25], [-60, -8, -1.8])],
)
def test_two_lasers_in_turn_are_two_points(tmp_path, names, far, near):
    """A VLP-16 fires -15, 1, -13, 3 ... degrees: every other point lies below the sensor."""
    elevation = np.radians(np.tile([-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15], 600))
    azimuth = np.repeat(np.arange(600) * 2 * np.pi / 600, 16)
    ray = np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    walls = np.where(ray > 0, far, near) / np.where(ray, ray, 1e-9)
    xyz = ray * walls.min(axis=1)[:, None]
    cloud = dict(zip("xyz", xyz.T, strict=True)) | {"unit": np.arange(len(xyz)) * 7 % 101 / 101}
    rows = np.column_stack([cloud[name] for name in names]).astype("<f4")
    first = sweeps_of(read(walk(tmp_path, "bin", lambda _: rows.tobytes()))[1])[0]
    np.testing.assert_array_equal(first.xyz, rows[:, :3])


@pytest.mark.parametrize("missing", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("suffix", ["bin", "csv"])
def test_a_missing_return_may_be_infinite(tmp_path, suffix, missing):
    def write(cloud):
        rows = table(cloud, LAYOUTS["nuScenes"])
        rows[1::3, :3] = missing
        return (
            rows.astype("<f4").tobytes()
            if suffix == "bin"
            else "\n".join(",".join(map(repr, row)) for row in rows.tolist()).encode()
        )

    first = sweeps_of(read(walk(tmp_path, suffix, write))[1])[0]
    is_return = np.arange(len(sweep(0)["x"])) % 3 != 1
    np.testing.assert_allclose(first.xyz[:, 0], sweep(0)["x"][is_return], rtol=1e-6)
    assert first.ring.tolist() == sweep(0)["ring"][is_return].tolist()


def test_normals_are_no_points(tmp_path):
    def write(cloud):
        xyz = np.column_stack([cloud[axis] for axis in "xyz"])
        return np.column_stack([xyz, -np.sign(xyz) * (np.abs(xyz) == np.abs(xyz).max(axis=1)[:, None])]).astype("<f4")

    first = sweeps_of(read(walk(tmp_path, "bin", lambda cloud: write(cloud).tobytes()))[1])[0]
    np.testing.assert_array_equal(first.xyz, write(sweep(0))[:, :3])


def test_doubles_are_said_to_be_that(tmp_path):
    with pytest.raises(ReadError, match="its values are float64"):
        read(walk(tmp_path, "bin", lambda cloud: table(cloud, LAYOUTS["KITTI"]).astype("<f8").tobytes()))


def test_a_column_that_is_none_of_these_is_named(tmp_path):
    path = walk(tmp_path, "bin", lambda cloud: table(cloud, LAYOUTS["with a noise ratio"]).astype("<f4").tobytes())
    recording = read(path)[0]
    (lidar,) = [each for each in recording.sensors if each.kind == "lidar"]
    assert "column_6" in lidar.notes["fields"].split()
    assert any("not used: column_6" in note for note in recording.lidar_facts(lidar).notes)
