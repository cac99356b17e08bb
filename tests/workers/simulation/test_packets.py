"""The packets as an independent decoder sees them."""

import numpy as np
import pytest
import velodyne_decoder

from apexcal.documents.simulation import SimulationOptions
from tests.support.packets import packet_rig, write_capture


@pytest.fixture(scope="module")
def rig():
    return packet_rig(SimulationOptions(seconds=1.0, seed=8, sector_deg=180.0))


def test_the_decoder_of_others_finds_the_same_points(rig, tmp_path):
    """velodyne-decoder, which knows nothing of ours: all sweeps in one cloud, since it cuts them elsewhere."""
    write_capture(rig, tmp_path / "one.pcap", 6)
    expected = [rig.sweep(index) for index in range(6)]
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
