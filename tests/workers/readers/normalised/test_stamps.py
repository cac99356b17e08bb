import numpy as np
import pytest

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


TENTHS = {
    "steady": (range(50), {"rate_hz": 10.0, "gap_count": 0, "first_ns": 0, "last_ns": 4_900_000_000}, []),
    "gaps": ((0, 1, 2, 4, 5, 6, 16, 17, 18), {"gap_count": 2, "missing": 10, "gaps": [(2, 2), (6, 10)]},
             ["2 gaps, the longest of 1.00 s after 0.600 s (usual step 0.100 s); about 10 messages are missing"]),
    "another's stamp": ((0, 1, 2, 2, 4, 5, 6, 8, 8, 9), {"duplicates": 2, "missing": 0, "gap_count": 0},
                        ["2 messages have the same stamp"]),
    "another's stamp and a gap": ((0, 1, 2, 2, 5, 6, 7), {"duplicates": 1, "missing": 1, "gap_count": 1},
                                  ["1 messages have the same stamp", "1 gaps"]),
    "everything twice": ([i // 2 for i in range(40)],
                         {"rate_hz": 10.0, "duplicates": 20, "missing": 0, "gap_count": 0}, ["20 messages have"]),
    "out of order": ((0, 1, 3, 2, 4, 4), {"backwards": 1, "duplicates": 1, "jumps": []},
                     ["run backwards 1 times", "same stamp"]),
    "a jump": ((0, 1, 2, 1e9, 1e9 + 1), {"jumps": [(2, 1e9 - 2)], "missing": 0}, ["clock jumps"]),
    "set back": ((*range(100), *range(40, 140)), {"jumps": [(99, -59)]},
                 ["run backwards", "set back by 5.9 s after 9.900 s", "same stamp"]),
    "set back a little": ((*range(100), *range(95, 195)), {"jumps": [(99, -4)]},
                          ["run backwards", "set back by 0.4 s after 9.900 s", "same stamp"]),
    "late": ((0, 1, 2, 6, 3, 4, 7, 8, 9, 10), {"jumps": []}, ["run backwards", "1 gaps"]),
    "one message": ((7,), {"rate_hz": None, "first_ns": 700_000_000, "last_ns": 700_000_000}, []),
}  # fmt: skip


@pytest.mark.parametrize("name", TENTHS)
def test_what_stamps_tell(name):
    tenths, facts, sentences = TENTHS[name]
    report = report_stamps(stamps(*tenths), "lidar")
    assert report.order.tolist() == np.argsort(stamps(*tenths), kind="stable").tolist()
    for fact, value in facts.items():
        found = getattr(report.facts, fact)
        if fact in ("gaps", "jumps"):
            found, value = [(g.after_ns, g.duration_ns) for g in found], [tuple(stamps(*pair)) for pair in value]
        assert found == value, fact
    assert len(report.warnings) == len(sentences)
    assert all(any(sentence in line for line in report.warnings) for sentence in sentences), report.warnings


def test_partial_sweeps_at_the_ends():
    assert sweep_warnings(np.array([900, 1000, 1000, 1000, 990]), "lidar") == []
    points = np.array([300, 1000, 990, 1000, 990, 1000, 700])
    assert partial_ends(points) == ["first", "last"]
    said = sweep_warnings(points, "lidar")
    assert len(said) == 2 and "first sweep is partial (300" in said[0]


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
