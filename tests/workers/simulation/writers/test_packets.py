"""The packets as the sensor's manual and an independent decoder see them."""

import struct

import numpy as np
import pytest
import velodyne_decoder

from apexcal.documents.simulation import SimulationOptions
from workers.simulation.rig import SimulatedRig
from workers.simulation.writers.packets import Pcap, Vlp16Packets, ethernet


@pytest.fixture(scope="module")
def rig():
    return SimulatedRig(SimulationOptions(seconds=1.0, seed=8, format="pcap", sector_deg=180.0))


def test_a_packet_is_laid_out_as_the_manual_says(rig):
    packets = Vlp16Packets(rig.lidar).of(rig.sweep(3))
    assert len(packets) == 75  # 1800 columns of 0.2 degrees, 24 in a packet
    received = [at for at, _ in packets]
    assert received == sorted(received)
    for number, (at, payload) in enumerate(packets):
        assert len(payload) == 1206
        assert payload[:2] == b"\xff\xee"
        assert payload[-2:] == b"\x37\x22"
        (time_us,) = struct.unpack_from("<I", payload, 1200)
        assert 1_000_000 < at - (at // 3_600_000_000_000 * 3_600_000_000_000 + time_us * 1000) < 2_000_000
        azimuth = [struct.unpack_from("<H", payload, 100 * block + 2)[0] for block in range(12)]
        assert set((np.diff(azimuth) % 36_000).tolist()) == {40}
        first = 18_000 + 480 * number  # the first column looks straight back
        assert 0 <= (azimuth[0] - first) % 36_000 <= 21


def test_the_decoder_of_others_finds_the_same_points(rig, tmp_path):
    """velodyne-decoder, which knows nothing of ours: all sweeps in one cloud, since it cuts them elsewhere."""
    capture = Pcap(tmp_path / "one.pcap")
    packets = Vlp16Packets(rig.lidar)
    expected = [rig.sweep(index) for index in range(6)]
    for sweep in expected:
        for at_ns, payload in packets.of(sweep):
            capture.add(at_ns, ethernet(payload))
    capture.close()
    decoded = [cloud for _, cloud in velodyne_decoder.read_pcap(str(tmp_path / "one.pcap"), as_pcl_structs=True)]
    points = np.concatenate([np.column_stack([cloud[axis] for axis in "xyz"]) for cloud in decoded])
    ring = np.concatenate([cloud["ring"] for cloud in decoded])
    truth = np.concatenate([sweep.xyz for sweep in expected[1:5]])
    truth_ring = np.concatenate([sweep.ring for sweep in expected[1:5]])
    from scipy.spatial import cKDTree

    for number in range(0, 16, 3):
        wanted = truth[truth_ring == number]
        if len(wanted) == 0:
            continue
        near, _ = cKDTree(points[ring == number]).query(wanted)
        assert (near < 0.0015 + np.radians(0.0125) * np.linalg.norm(wanted, axis=1)).all()
