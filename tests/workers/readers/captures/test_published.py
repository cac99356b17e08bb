"""VLP-32C and Alpha Prime packets against the decodings that a driver's publisher made of them.

The published points differ from ours in two ways, which are allowed for return by return. Its beams all leave the
origin, while they leave a VLP-32C's axis 42 mm and an Alpha Prime's 59 mm before the optical centre (manuals). And
its azimuths within a firing cycle are not by the manuals' firing times. For a VLP-32C it goes on for each laser,
although two fire together. For an Alpha Prime it goes by the step to the next block, which is of the same cycle for
three blocks of four. The last block of a packet has no next one.
"""

import sqlite3
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial import cKDTree

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.velodyne.models import PACKET
from workers.readers.choose import choose_sensors
from workers.readers.detect import open_recording
from workers.readers.ros.ros_types import PACKETS, ros_decoder
from workers.readers.ros.topic_messages import BagTopic

DATA = Path(__file__).parents[5] / "shared" / "data" / "packets" / "velodyne"
pytestmark = pytest.mark.skipif(not DATA.exists(), reason="../shared/data is absent")

# Folder, published sweep, table, optical centre (m), lasers that fire together, and the slots of a cycle.
SENSORS = {
    "vlp32": ("vlp32", "1713492677464078412.pcd", "VLP-32C.yml", 0.0424, 2, 24),
    "vls128": ("vls128", "1585897255376374245.pcd", "Alpha Prime.yml", 0.0586, 8, 20),
}


def _table(name):
    """Elevation and azimuth to the right of each laser by the maker's table, radians."""
    text = (resources.files("velodyne_decoder") / "calibrations" / name).read_text()
    lasers = yaml.safe_load(text)["lasers"]
    return tuple(np.array([laser[key] for laser in lasers]) for key in ("vert_correction", "rot_correction"))


def _published(path):
    data = path.read_bytes()
    start = data.index(b"DATA binary\n") + 12
    return np.frombuffer(data[start:], np.float32).reshape(-1, 3).astype(float)


def _packets(folder):
    """(N, 12, 100) the blocks of every packet of a bag."""
    (path,) = folder.glob("*/*.db3")
    decode = ros_decoder(BagTopic("packets", PACKETS, "cdr", "", "", 1))
    with sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True) as file:
        messages = [decode(data) for (data,) in file.execute("SELECT data FROM messages ORDER BY id")]
    packets = [np.frombuffer(data, np.uint8)[:1200] for message in messages for _, data in message.packets]
    assert all(len(packet) == PACKET.size - 6 for packet in packets)
    return np.array(packets).reshape(-1, 12, 100).astype(int)


class Returns:
    """Every return of a bag: range, laser and azimuth of its block and cycle."""

    def __init__(self, name):
        folder, _, table, self.centre_m, together, slots = SENSORS[name]
        blocks = _packets(DATA / folder)
        self.elevation, self.aside = _table(table)
        self.azimuth = blocks[:, :, 2] + 256 * blocks[:, :, 3]
        bank = np.select([blocks[:, :, 1] == flag for flag in (0xEE, 0xDD, 0xCC, 0xBB)], [0, 32, 64, 96])
        self.laser = bank[:, :, None] + np.arange(32)
        self.range_m = (blocks[:, :, 4::3] + 256 * blocks[:, :, 5::3]) * 0.004
        group = self.laser // together
        # The Alpha Prime pauses for a slot after its eighth group.
        self.slot = (group + (group // 8 if name == "vls128" else 0)) / slots

    def points(self, azimuth, centre_m):
        """(K, 3) of all returns; ``azimuth`` (N, 12, 32) in hundredths of a degree, clockwise."""
        up = self.elevation[self.laser]
        angle = np.radians(azimuth / 100.0) - self.aside[self.laser]
        flat = self.range_m * np.cos(up)
        points = (flat * np.cos(angle), -flat * np.sin(angle), self.range_m * np.sin(up) - centre_m * np.tan(up))
        return np.stack(points, axis=-1)[self.range_m > 0.0]

    def rings(self):
        """(K,) by elevation, the lowest 0."""
        rank = np.argsort(np.argsort(self.elevation, kind="stable"), kind="stable")
        return rank[self.laser][self.range_m > 0.0]


def _sweeps(name):
    folder = DATA / SENSORS[name][0]
    (bag,) = (path for path in folder.iterdir() if path.is_dir())
    recording = open_recording(bag, ReadOptions())
    try:
        sweeps = list(recording.sweeps(choose_sensors(recording, None, None)["lidar"]))
        return sweeps, recording.warnings
    finally:
        recording.close()


@pytest.mark.parametrize("name", SENSORS)
def test_every_point_is_a_return_by_the_manual(name):
    """0.01 degrees is the unit of the azimuth; the turn's rate is known to it within a block."""
    returns = Returns(name)
    points = np.concatenate([sweep.xyz for sweep in _sweeps(name)[0]]).astype(float)
    ring = np.concatenate([sweep.ring for sweep in _sweeps(name)[0]])
    step = 20.0  # hundredths of a degree for a cycle, at 10 Hz
    there = returns.points(returns.azimuth[:, :, None] + step * returns.slot, returns.centre_m)
    off, nearest = cKDTree(there).query(points)
    allowed = 0.002 + np.linalg.norm(points, axis=1) * np.radians(0.01)
    assert np.mean(off < allowed) > 0.998
    assert np.mean(returns.rings()[nearest] == ring) > 0.999
    assert 0.99 * len(there) < len(points) <= len(there)


def test_the_first_packet_of_a_recording_turns_as_fast_as_the_next_one():
    """No packet before it tells the rate; its azimuths were off by up to 0.16 degrees."""
    returns = Returns("vls128")
    xyz = _sweeps("vls128")[0][0].xyz.astype(float)
    there = returns.points(returns.azimuth[:, :, None] + 20.0 * returns.slot, returns.centre_m)
    in_first = np.nonzero(returns.range_m > 0.0)[0] == 0
    off, _ = cKDTree(xyz).query(there[in_first])
    assert in_first.sum() > 100
    assert np.mean(off < 0.002 + np.linalg.norm(there[in_first], axis=1) * np.radians(0.01)) > 0.99


@pytest.mark.parametrize("name", SENSORS)
def test_the_published_points_are_the_same_returns(name):
    """The publisher rounds azimuths to 0.01 degrees, and the table's to 0.001."""
    returns = Returns(name)
    published = _published(DATA / SENSORS[name][0] / SENSORS[name][1])
    to_next = np.diff(returns.azimuth, axis=1, append=returns.azimuth[:, -1:]) % 36_000
    slot = returns.laser / 24.0 if name == "vlp32" else returns.slot
    azimuth = np.round(returns.azimuth[:, :, None] + to_next[:, :, None] * slot)
    off, _ = cKDTree(returns.points(azimuth, 0.0)).query(published)
    assert np.mean(off < 0.002 + np.linalg.norm(published, axis=1) * np.radians(0.006)) > 0.999


def test_a_sensor_that_is_set_to_a_sector_loses_nothing_and_turns_evenly():
    sweeps, warnings = _sweeps("vlp32")
    starts = np.array([sweep.stamp_ns for sweep in sweeps])
    np.testing.assert_allclose(np.diff(starts), 1e8, rtol=0.01)
    assert len(warnings) == 1
    assert "5 packets span the end of the field of view" in warnings[0]
    for sweep in sweeps:
        azimuth = np.degrees(np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0]))
        assert -97.0 < azimuth.min() < azimuth.max() < 97.0  # lasers point aside by 4.2 degrees
        assert 45_000_000 < sweep.offset_ns.max() - sweep.offset_ns.min() < 55_000_000
