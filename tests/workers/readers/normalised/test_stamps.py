import numpy as np

from workers.readers.normalised.stamps import (
    overlap_warning,
    partial_ends,
    report_stamps,
    shared_time,
    sweep_warnings,
)

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
    assert report.missing == 10 and "10 messages are missing" in report.warnings[0]


def test_a_message_with_another_s_stamp_is_not_missing():
    report = report_stamps(stamps(0, 1, 2, 2, 4, 5, 6, 8, 8, 9), "lidar")
    assert (report.twins, report.missing, report.gap_count) == (2, 0, 0)
    assert len(report.warnings) == 1 and "2 messages have the same stamp" in report.warnings[0]
    missed = report_stamps(stamps(0, 1, 2, 2, 5, 6, 7), "lidar")
    assert (missed.twins, missed.missing, missed.gap_count) == (1, 1, 1)


def test_a_recording_that_holds_everything_twice_has_its_rate_and_no_gaps():
    report = report_stamps(np.repeat(stamps(*range(20)), 2), "lidar")
    assert (report.rate_hz, report.twins, report.missing, report.gap_count) == (10.0, 20, 0, 0)


def test_stamps_out_of_order_are_ordered_and_said():
    report = report_stamps(stamps(0, 1, 3, 2, 4, 4), "lidar")
    assert report.order.tolist() == [0, 1, 3, 2, 4, 5]
    assert "run backwards 1 times" in report.warnings[0] and "same stamp" in report.warnings[1]
    assert (report.backwards, report.twins, list(report.jumps)) == (1, 1, [])


def test_a_jump_of_the_clock():
    report = report_stamps(stamps(0, 1, 2, 1e9, 1e9 + 1), "lidar")
    assert "clock jumps" in report.warnings[0] and len(report.warnings) == 1
    assert [(j.after_ns, j.duration_ns) for j in report.jumps] == [(2 * S // 10, 10**8 * S - 2 * S // 10)]
    assert report.missing == 0


def test_a_clock_that_was_set_back():
    report = report_stamps(stamps(*range(100), *range(40, 140)), "lidar")
    assert [(j.after_ns, j.duration_ns) for j in report.jumps] == [(99 * S // 10, -59 * S // 10)]
    assert any("set back by 5.9 s after 9.900 s" in said for said in report.warnings)


def test_a_clock_that_was_set_back_by_half_a_second():
    report = report_stamps(stamps(*range(100), *range(95, 195)), "lidar")
    assert [(j.after_ns, j.duration_ns) for j in report.jumps] == [(99 * S // 10, -4 * S // 10)]
    assert any("set back by 0.4 s after 9.900 s" in said for said in report.warnings)


def test_a_message_that_came_late_is_no_clock_that_was_set_back():
    assert list(report_stamps(stamps(0, 1, 2, 6, 3, 4, 7, 8, 9, 10), "lidar").jumps) == []


def test_one_message_has_no_rate():
    report = report_stamps(stamps(7), "lidar")
    assert report.rate_hz is None and report.first_ns == report.last_ns


def test_partial_sweeps_at_the_ends():
    assert sweep_warnings(np.array([900, 1000, 1000, 1000, 990]), "lidar") == []
    points = np.array([300, 1000, 0, 1000, 990, 1000, 700])
    assert partial_ends(points) == ["first", "last"]
    said = sweep_warnings(points, "lidar")
    assert len(said) == 3 and "first sweep is partial (300" in said[0] and "1 sweeps hold no point" in said[2]


def test_sensors_that_share_no_time():
    assert overlap_warning("front", (0, 10 * S), (3 * S, 20 * S)) == []
    (said,) = overlap_warning("front", (10 * S, 20 * S), (30 * S, 40 * S))
    assert "begins 10.0 s after the last" in said
    (said,) = overlap_warning("rear", (10 * S, 20 * S), (0, 5 * S))
    assert "ends 5.0 s before the first" in said
    (said,) = overlap_warning("front", (0, 10 * S), (9 * S, 20 * S))
    assert "share 1.0 s, 10 %" in said


def test_how_long_two_sensors_ran_together():
    assert shared_time((0, 10 * S), (5 * S, 30 * S)) == (5.0, 0.5)
    assert shared_time((0, 10 * S), (11 * S, 30 * S)) == (0.0, 0.0)
    assert shared_time((4 * S, 4 * S), (0, 9 * S)) == (0.0, 1.0)
