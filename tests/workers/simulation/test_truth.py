import numpy as np


def test_the_scanned_apex_is_where_the_sensor_looked_at_that_moment(short):
    sweeps = short.truth["sweeps"]
    apex = np.array(sweeps["scan_apex_xyz"])
    after_s = (np.array(sweeps["scan_ns"]) - np.array(sweeps["stamp_ns"])) * 1e-9
    looked_at = np.radians(short.rig.options.sector_deg) - 2 * np.pi * 10.0 * after_s
    np.testing.assert_allclose(np.arctan2(apex[:, 1], apex[:, 0]), looked_at, atol=1e-5)
    assert np.linalg.norm(apex - np.array(sweeps["apex_xyz"]), axis=1).max() < 0.1
