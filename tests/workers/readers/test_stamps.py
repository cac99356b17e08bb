import numpy as np

from workers.readers.stamps import overlap, partial_sweeps, report_stamps

S = 1_000_000_000


def stamps(*tenths):
    return np.array([int(t * S // 10) for t in tenths], np.int64)


def test_a_steady_sensor_has_nothing_to_say():
    report = report_stamps(stamps(*range(50)), "lidar")
    assert (report.rate_hz, report.gap_count, report.warnings) == (10.0, 0, [])
    assert (report.first_ns, report.last_ns) == (0, 4_900_000_000)


def test_a_missing_message_is_a_gap():
    report = report_stamps(stamps(0, 1, 2, 4, 5, 6, 16, 17, 18), "lidar")
    assert [(g.after_ns, g.duration_ns) for g in report.gaps] == [(2 * S // 10, 2 * S // 10), (6 * S // 10, S)]
    assert "2 gaps" in report.warnings[0] and "1.00 s after 0.600 s" in report.warnings[0]


def test_stamps_out_of_order_are_ordered_and_said():
    report = report_stamps(stamps(0, 1, 3, 2, 4, 4), "lidar")
    assert report.order.tolist() == [0, 1, 3, 2, 4, 5]
    assert "run backwards 1 times" in report.warnings[0] and "same stamp" in report.warnings[1]


def test_a_jump_of_the_clock():
    report = report_stamps(stamps(0, 1, 2, 1e9, 1e9 + 1), "lidar")
    assert "clock jumps" in report.warnings[0]


def test_one_message_has_no_rate():
    report = report_stamps(stamps(7), "lidar")
    assert report.rate_hz is None and report.first_ns == report.last_ns


def test_partial_sweeps_at_the_ends():
    assert partial_sweeps(np.array([900, 1000, 1000, 1000, 990]), "lidar") == []
    said = partial_sweeps(np.array([300, 1000, 0, 1000, 990, 1000, 700]), "lidar")
    assert len(said) == 3 and "first sweep is partial (300" in said[0] and "1 sweeps hold no point" in said[2]


def test_sensors_that_share_no_time():
    assert overlap([("lidar", 0, 10 * S), ("front", 9 * S, 20 * S)]) == []
    said = overlap([("lidar", 10 * S, 20 * S), ("front", 30 * S, 40 * S), ("rear", 0, 5 * S)])
    assert "begins 10.0 s after the last" in said[0] and "ends 5.0 s before the first" in said[1]
