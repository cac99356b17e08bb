"""The packets as the sensor's manual and an independent decoder see them."""

import struct

import numpy as np
import pytest
import velodyne_decoder

from apexcal.documents.simulation import SimulationOptions
from tests.support.packets import Pcap, Vlp16Packets, ethernet, packet_rig, write_capture
from workers.readers.detect import open_recording


@pytest.fixture(scope="module")
def rig():
    return packet_rig(SimulationOptions(seconds=1.0, seed=8, sector_deg=180.0))


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


def test_our_reader_finds_them_too_with_their_times(tmp_path):
    """Of a sector, as the sensor is set to one: packets hold azimuths in hundredths of a degree."""
    rig = packet_rig(SimulationOptions(seconds=1.0, seed=6, sector_deg=55.0))
    write_capture(rig, tmp_path / "lidar.pcap")
    recording = open_recording(tmp_path / "lidar.pcap")
    try:
        (lidar,) = recording.sensors
        sweeps, expected = list(recording.sweeps(lidar)), list(rig.sweeps())
        facts = recording.lidar_facts(lidar)
    finally:
        recording.close()
    assert len(sweeps) == len(expected) and {sweep.time_source for sweep in sweeps} == {"per_point"}
    assert (facts.ring_count, facts.stamp_convention) == (16, "start")
    for sweep, want in zip(sweeps, expected, strict=True):
        here, there = (np.lexsort((each.offset_ns, each.ring)) for each in (sweep, want))
        np.testing.assert_array_equal(sweep.ring[here], want.ring[there])
        off = np.linalg.norm(sweep.xyz[here].astype(float) - want.xyz[there], axis=1)
        assert (off < 0.0015 + np.radians(0.0125) * np.linalg.norm(want.xyz[there], axis=1)).all()
        at_ns = sweep.stamp_ns + sweep.offset_ns[here] - want.stamp_ns - want.offset_ns[there]
        # The host's clock gets them a little later.
        assert np.ptp(at_ns) < 15_000 and abs(np.median(at_ns)) < 300_000
        assert np.abs(sweep.intensity[here] - want.intensity[there]).max() <= 0.5
