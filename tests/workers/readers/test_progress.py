from workers.readers import progress
from workers.readers.progress import IngestProgress, Pace


def test_time_left_follows_the_pace_of_messages_or_else_of_bytes(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    pace, bytes_alone = Pace(1000), Pace(None)
    assert pace.due and not pace.due
    clock[0] += 1.0
    assert pace.due
    assert pace.at(50, None) == IngestProgress(50, 1000, 0.05, None)  # too early to tell
    clock[0] += 9.0
    assert pace.at(250, 0.9).seconds_left == 30.0
    assert bytes_alone.at(5, 0.5) == IngestProgress(5, None, 0.5, 10.0)
    assert bytes_alone.at(5, None).share is None
