import numpy as np
import pytest

from workers.readers.captures.packet_clock import PacketClock

PACKET_NS = 1_327_104
START_NS = 1_700_000_000_000_000_000


def run(truth_ns, device_us, late_ns, device=True):
    """Moments that the clock tells; the host stamps packets when they are whole, and late."""
    clock = PacketClock(PACKET_NS, device)
    host = truth_ns + PACKET_NS + late_ns
    told = [clock.moment(int(h), int(d)) for h, d in zip(host, device_us, strict=True)]
    return clock, np.asarray(told) - truth_ns


def stream(seconds, step_ns=PACKET_NS):
    return START_NS + np.arange(int(seconds * 1e9 / step_ns), dtype=np.int64) * step_ns


def delays(count, seed=0):
    rng = np.random.default_rng(seed)
    late = rng.exponential(100_000, count) + (rng.random(count) < 0.02) * rng.uniform(0, 5e6, count)
    return late.astype(np.int64)


@pytest.mark.parametrize("ppm", [-60, 60])
def test_clocks_that_drift_apart_stay_tied(ppm):
    truth = stream(1200, 10 * PACKET_NS)
    device_us = ((truth - START_NS) * (1 + ppm * 1e-6) / 1000).astype(np.int64) % 3_600_000_000
    _, error = run(truth, device_us, delays(len(truth)))
    assert np.abs(error[100:]).max() < 300_000  # unheeded, 60 ppm of 20 minutes would be 72 ms


def test_a_clock_that_is_set_while_it_runs():
    truth = stream(4)
    device_us = (truth - START_NS) // 1000
    device_us[len(truth) // 2 :] += 1_234_000  # the sensor finds its satellites
    clock, error = run(truth, device_us, delays(len(truth)))
    assert clock.jumps == 1 and np.abs(error[len(truth) // 2 + 400 :]).max() < 300_000
