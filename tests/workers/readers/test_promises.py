"""What is promised of every format: each test goes through the table of formats."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from formats import COUNT, FORMATS, FRAME_NS, frames_of, read, same, sweeps_of
from making_recordings import PERIOD_NS, START_NS, png, scene

from workers.readers.recording import ReadError

CUT = {
    *("recording_truncated", "recording_damaged", "recording_not_indexed", "recording_empty"),
    *("not_a_recording", "no_sweeps"),  # not even the names of its topics, or no message, is there
}


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """Where readers unpack."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def nothing_stays(path, scratch):
    """No file is open, nothing that was unpacked is left."""
    opened = {link.resolve() for link in Path("/proc/self/fd").iterdir()}
    return not list(scratch.iterdir()) and path.resolve() not in opened


@pytest.mark.parametrize("name", FORMATS)
def test_every_message_is_read_in_order(tmp_path, scratch, name):
    path = FORMATS[name].write(tmp_path / "walk")
    recording, items, warnings = read(path)
    sweeps, frames = sweeps_of(items), [one for one in frames_of(items) if not one.transcoding]
    stamps = [item.stamp_ns for item in items]
    assert stamps == sorted(stamps) and warnings == [] and (recording.share_read or 1.0) > 0.5
    assert [sweep.stamp_ns for sweep in sweeps] == [START_NS + i * PERIOD_NS for i in range(COUNT)]
    assert [frame.stamp_ns for frame in frames] == [sweep.stamp_ns + FRAME_NS for sweep in sweeps]
    assert [frame.data for frame in frames] == [png(8, 6, i) for i in range(COUNT)]
    assert {(frame.width, frame.height, frame.media_type) for frame in frames} == {(8, 6, "image/png")}
    assert {sensor.count for sensor in recording.sensors} == {COUNT}
    columns, has_times = scene(), not name.startswith(("folder", "tar", "zip"))
    for sweep in sweeps:
        np.testing.assert_allclose(sweep.xyz, np.stack([columns[a] for a in "xyz"], 1), 1e-6, FORMATS[name].points)
        np.testing.assert_array_equal(sweep.ring, columns["ring"])
        np.testing.assert_array_equal(sweep.intensity, columns["intensity"].astype(np.float32))
        np.testing.assert_allclose(sweep.offset_ns, columns["time"] * 1e9, atol=10 if has_times else 200)
        assert sweep.time_source == ("per_point" if has_times else "derived_from_azimuth")
    assert nothing_stays(path, scratch)


@pytest.mark.parametrize("name", [name for name in FORMATS if not name.startswith(("folder", "db3", "mcap bag"))])
def test_a_cut_file_gives_its_first_messages_or_is_refused(tmp_path, scratch, name):
    path = FORMATS[name].write(tmp_path / "walk")
    whole = path.read_bytes()
    _, everything, _ = read(path)
    shares = []
    for part in (0.999, 0.9, 0.7, 0.5, 0.2, 0.01):
        path.write_bytes(whole[: int(len(whole) * part)])
        try:
            recording, items, warnings = read(path)
        except ReadError as error:
            assert error.code in CUT and error.hint, (part, error.code)
            # Its traceback still holds what was opened.
            assert nothing_stays(path, scratch)
            shares.append(0.0)
        else:
            assert all(any(same(item, one) for one in everything) for item in items)
            assert sum(sensor.count for sensor in recording.sensors) == len(items)
            shares.append(len(items) / len(everything))
            assert shares[-1] == 1.0 or any("is cut short" in s or "ends without its index" in s for s in warnings)
        assert nothing_stays(path, scratch)
    assert np.mean(shares) >= FORMATS[name].cut and (FORMATS[name].cut > 0.0 or set(shares) <= {0.0, 1.0}), shares
