from tests.workers.vertices.sweeps import IN_FRONT, row, sweep
from workers.vertices.region import preview


def test_frames_points_and_rings_are_counted():
    sweeps = [sweep(row(0, 4) + row(5, 2)), sweep(row(0, 3, x=-5.0) + row(7, 1)), sweep(row(2, 2, x=-5.0)), sweep([])]
    assert preview(sweeps, IN_FRONT).model_dump() == {
        "frames": 4,
        "frames_kept": 2,
        "points": 12,
        "points_kept": 7,
        "points_per_frame_median": 0.5,
        "per_ring": [
            {"ring": 0, "points": 7, "points_kept": 4},
            {"ring": 2, "points": 2, "points_kept": 0},
            {"ring": 5, "points": 2, "points_kept": 2},
            {"ring": 7, "points": 1, "points_kept": 1},
        ],
    }


def test_an_empty_recording():
    found = preview([], IN_FRONT)
    assert (found.frames, found.per_ring, found.points_per_frame_median) == (0, [], 0.0)
