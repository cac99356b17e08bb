"""Columns under the names that drivers, converters and formats write, in every format; what is not known is named."""

import time

import numpy as np
import pytest
from formats import folder_of, npy, read, sweeps_of
from making_recordings import CLOUD, PERIOD_NS, START_NS, clouds, images, interleaved, png, scene, write_bag
from pypcd4 import Encoding, PointCloud

from apexcal.documents.readings import ReadOptions
from workers.readers.clouds.fields import CloudFields
from workers.readers.clouds.model import learn_clouds
from workers.readers.recording import ReadError

SCENE = scene()
NS = np.rint(SCENE["time"] * 1e9).astype(np.int64)
STAMP = START_NS


def columns(**named):
    """The scene's points with these columns beside x, y and z; later names may replace these."""
    return {"x": SCENE["x"], "y": SCENE["y"], "z": SCENE["z"]} | named


def learned(cloud, options=None):
    return learn_clouds([(STAMP, cloud)] * 3, PERIOD_NS, options or ReadOptions(), "/points")


# A case is a driver's, a converter's or a program's choice of names: intensity, ring, time with what it counts.
WRITTEN = {
    "SICK multiScan": columns(
        i=SCENE["intensity"], layer=SCENE["ring"].astype("i4"), lidar_sec=((STAMP + NS) // 10**9).astype("u4"),
        lidar_nsec=((STAMP + NS) % 10**9).astype("u4"),
    ),
    "PDAL": columns(Intensity=SCENE["intensity"], GpsTime=4.1e5 + SCENE["time"], Ring=SCENE["ring"].astype("f8")),
    "CloudCompare PLY": columns(
        scalar_Intensity=SCENE["intensity"], scalar_ring=SCENE["ring"].astype("f4"), scalar_GpsTime=SCENE["time"]
    ),
    "Aeva": columns(
        reflectivity=SCENE["intensity"], line_index=SCENE["ring"].astype("u1"), time_offset_ns=NS.astype("i4")
    ),
    "Autoware": columns(
        intensity=SCENE["intensity"], channel=SCENE["ring"].astype("u2"), time_stamp=NS.astype("u4")
    ),
    "VeloView CSV": columns(
        intensity=SCENE["intensity"], laser_id=SCENE["ring"], adjustedtime=3.1e9 + SCENE["time"] * 1e6
    ),
    "a logger's camel case": columns(
        Reflectance=SCENE["intensity"], laserNumber=SCENE["ring"], pointTimeOffset=SCENE["time"] * 1e3
    ),
    "seconds and microseconds": columns(
        Amplitude=SCENE["intensity"], Beam=SCENE["ring"], ts_sec=(STAMP + NS) // 10**9,
        ts_usec=(STAMP + NS) % 10**9 / 1e3,
    ),
    "remission": columns(remission=SCENE["intensity"], scan_line=SCENE["ring"], t_us=NS / 1e3),
    "units in brackets": {
        **{f"{axis.upper()} [m]": SCENE[axis] for axis in "xyz"},
        "Intensity": SCENE["intensity"], "Laser ID": SCENE["ring"], "Time (ms)": NS / 1e6,
    },
    # The first ring and the first intensity by name are filled in with zeros: others hold them.
    "fields that are not filled": columns(
        ring=np.zeros(1440), channel=SCENE["ring"], intensity=np.zeros(1440), reflectivity=SCENE["intensity"],
        t=np.zeros(1440), timestamp=(STAMP + NS) / 1e9,
    ),
    # The channel is that of two returns, as in LAS: each holds all elevations.
    "a channel that is no ring": columns(
        channel=np.arange(1440) % 2, scanline=SCENE["ring"], intensity=SCENE["intensity"], t=NS
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITTEN)
def test_ring_time_and_intensity_are_taken(name):
    model = learned(WRITTEN[name])
    sweep = model.sweep(STAMP, WRITTEN[name])
    assert sweep.ring.tolist() == SCENE["ring"].tolist() and model.facts.ring_count == 16
    assert sweep.intensity.tolist() == SCENE["intensity"].tolist()
    assert sweep.time_source == "per_point"
    # A double of seconds since 1970 resolves 0.24 microseconds.
    np.testing.assert_allclose(sweep.offset_ns - sweep.offset_ns[0], NS, atol=500)
    assert not any("not used" in note for note in model.notes)


def test_a_channel_of_returns_is_no_ring_where_nothing_else_is():
    cloud = columns(channel=np.arange(1440) % 2, intensity=SCENE["intensity"], t=NS)
    model = learned(cloud)
    assert model.ring is None and model.sweep(STAMP, cloud).ring.tolist() == SCENE["ring"].tolist()


@pytest.mark.parametrize("name", ["zeile", "Spot Nr", "laserZ", "elevation_index_q"])
def test_fields_whose_names_are_not_known_are_named(name):
    cloud = columns(intensity=SCENE["intensity"], t=NS) | {name: SCENE["ring"]}
    (note,) = [note for note in learned(cloud).notes if "not used" in note]
    assert f"These fields were not used: {name}. If one of them is the ring," in note
    flat = cloud | {"z": np.random.default_rng(0).normal(size=1440)}  # no elevations to tell rings by
    with pytest.raises(ReadError, match=name) as caught:
        learned(flat)
    assert caught.value.code == "rings_not_separable" and "point" in caught.value.hint


def test_a_cloud_without_coordinates_lists_what_it_holds():
    with pytest.raises(ReadError) as caught:
        learned({"px_mm": np.zeros(1), "y": np.zeros(1), "depth": np.zeros((1, 3))})
    assert caught.value.code == "cloud_without_xyz" and "point" in caught.value.hint
    assert caught.value.message == "/points has no x and no z; its fields are: px_mm, y, depth."


def test_a_name_that_states_its_unit_is_believed_also_of_a_flash():
    """All points of a flash lie within 20 microseconds, which would be 20 ms if the unit were told by a turn."""
    cloud = columns(ring=SCENE["ring"], intensity=SCENE["intensity"], time_offset_ns=NS // 5000)
    assert learned(cloud).sweep(STAMP, cloud).offset_ns.tolist() == (NS // 5000).tolist()


FORMS = ("x", "y", "z", "Reflectance", "GpsTime", "LaserID")


def in_files(suffix):
    named = columns(Reflectance=SCENE["intensity"], GpsTime=SCENE["time"], LaserID=SCENE["ring"])
    table = np.column_stack([named[name] for name in FORMS])
    if suffix == "csv":
        return "\n".join([";".join(FORMS), *(";".join(map(repr, row)) for row in table.tolist())]).encode()
    if suffix == "ply":
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
        head += [*(f"property double {name}" for name in FORMS), "end_header", ""]
        return "\n".join(head).encode() + table.astype("<f8").tobytes()
    if suffix == "npy":
        points = np.zeros(len(table), [(name, "f8") for name in FORMS])
        for name in FORMS:
            points[name] = named[name]
        return npy(points)
    import io

    file = io.BytesIO()
    PointCloud.from_points([named[name] for name in FORMS], FORMS, (np.float64,) * 6).save(file, Encoding.BINARY)
    return file.getvalue()


@pytest.mark.parametrize("suffix", ["csv", "ply", "npy", "pcd"])
def test_every_format_of_files_takes_the_same_names(tmp_path, suffix):
    files = {f"clouds/{START_NS + i * PERIOD_NS}.{suffix}": in_files(suffix) for i in range(4)}
    files |= {f"images/{START_NS + i * PERIOD_NS}.png": png(8, 6, i) for i in range(4)}
    sweep = sweeps_of(read(folder_of(tmp_path / "walk", files))[1])[1]
    assert sweep.ring.tolist() == SCENE["ring"].tolist() and sweep.intensity.tolist() == SCENE["intensity"].tolist()
    assert sweep.time_source == "per_point" and np.abs(sweep.offset_ns - sweep.offset_ns[0] - NS).max() < 2


def test_a_bag_takes_them_too(tmp_path):
    fields = {"x": "f4", "y": "f4", "z": "f4", "Reflectance": "f4", "LaserID": "u1", "time_offset_ns": "u4"}
    named = columns(Reflectance=SCENE["intensity"], LaserID=SCENE["ring"], time_offset_ns=NS)
    path = write_bag(tmp_path / "walk.bag", interleaved(clouds(columns=named, fields=fields), images()))
    sweep = sweeps_of(read(path)[1])[0]
    assert sweep.ring.tolist() == SCENE["ring"].tolist() and np.abs(sweep.offset_ns - NS).max() < 2
    assert next(iter(clouds()))[1] == CLOUD


@pytest.mark.parametrize("away", [(0.0, 0.0, 1.8), (1.2, -0.4, 1.9), (-0.1, 0.0, 0.0)])
def test_points_without_a_return_that_a_transform_has_moved_are_none(away):
    """Ids from the top; three in ten points found nothing, and lie where the sensor's origin is in the new frame."""
    dense = scene(columns=720)
    lost = np.random.default_rng(0).random(len(dense["x"])) < 0.3
    moved = [(np.where(lost, 0.0, dense[axis]) + shift).astype("f4") for axis, shift in zip("xyz", away, strict=True)]
    cloud = dict(zip("xyz", moved, strict=True)) | {"ring": 15 - dense["ring"]}
    model = learned(cloud)
    sweep = model.sweep(STAMP, cloud)
    assert len(sweep.xyz) == np.count_nonzero(~lost) and model.facts.ring_count == 16
    assert sweep.ring.tolist() == dense["ring"][~lost].tolist()


def test_thousands_of_fields_take_no_time():
    """The names are a stranger's: those of one meaning that are tried are few."""
    names = {f"{'_' * i}ring": SCENE["ring"] for i in range(2000)} | {f"a{i}_sec": NS for i in range(2000)}
    began = time.process_time()
    fields = CloudFields.of(columns(**names, **{f"{'_' * i}t": NS for i in range(2000)}), "/points")
    assert time.process_time() - began < 2.0
    assert len(fields.rings) == 8 and len(fields.times) == 8 and len(fields.unused) < 5000
