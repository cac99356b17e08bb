from workers.readers import progress
from workers.readers.progress import IngestProgress, Pace


def test_time_left_follows_the_pace(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    pace = Pace(1000)
    assert pace.due and not pace.due
    clock[0] += 1.0
    assert pace.due
    assert pace.at(50, None) == IngestProgress(50, 1000, 0.05, None)  # too early to tell
    clock[0] += 9.0
    assert pace.at(250, 0.9).seconds_left == 30.0  # messages tell it better than bytes


def test_bytes_tell_it_where_the_format_counts_no_messages(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    pace = Pace(None)
    clock[0] = 60.0
    assert pace.at(5, 0.5) == IngestProgress(5, None, 0.5, 60.0)
    assert pace.at(5, None).share is None
