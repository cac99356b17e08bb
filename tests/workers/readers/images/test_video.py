import resource

import cv2
import numpy as np
import pytest
from making_videos import CREATED_NS, HEIGHT, TIMES_MS, WIDTH, number_of, write_video

from apexcal.documents.readings import ReadOptions
from workers.readers.images.headers import read_image_header
from workers.readers.images.video import VideoRecording
from workers.readers.recording import ReadError

COUNT = len(TIMES_MS)


def read(path, options=None, **how):
    recording = VideoRecording(path, options or ReadOptions(), **how)
    frames = list(recording.frames(recording.sensors[0]))
    return recording, frames


def numbers(frames):
    return [number_of(cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR_RGB)) for frame in frames]


def refused(*arguments, **how):
    with pytest.raises(ReadError) as caught:
        read(*arguments, **how)
    assert caught.value.hint
    return caught.value


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "mov"])
def test_varying_times_and_b_frames_come_in_the_order_in_which_they_are_shown(tmp_path, suffix):
    recording, frames = read(write_video(tmp_path / f"camera.{suffix}"))
    assert [frame.stamp_ns - CREATED_NS for frame in frames] == [ms * 1_000_000 for ms in TIMES_MS]
    assert numbers(frames) == list(range(COUNT))
    header = read_image_header(frames[3].data, "frame")
    assert (header.media_type, header.width, header.height) == ("image/jpeg", WIDTH, HEIGHT)
    assert {(f.width, f.height, bool(f.transcoding)) for f in frames} == {(WIDTH, HEIGHT, True)}
    assert "quality 95" in frames[0].transcoding
    (sensor,) = recording.sensors
    assert (sensor.kind, sensor.name, sensor.notes["width"]) == ("camera", f"camera.{suffix}", str(WIDTH))
    assert sensor.count == (None if suffix == "mkv" else COUNT)
    assert len(recording.warnings) == 1 and "creation time" in recording.warnings[0]


def test_an_avi_counts_from_its_first_frame_and_says_so(tmp_path):
    recording, frames = read(write_video(tmp_path / "camera.avi", codec="mpeg4"))
    assert numbers(frames) == list(range(COUNT))
    assert [f.stamp_ns for f in frames] == [1_000_000_000 + i * 1_000_000_000 // 30 for i in range(COUNT)]
    assert "camera_start_ns" in recording.warnings[0]


def test_a_start_that_the_owner_knows_and_times_that_count_from_1970_already(tmp_path):
    path = write_video(tmp_path / "camera.mp4", start_ms=5000)
    recording, frames = read(path, ReadOptions(camera_start_ns=17))
    assert [f.stamp_ns for f in frames[:2]] == [17, 67_000_017] and not recording.warnings
    _, frames = read(path, ReadOptions(camera_start_ns=17), start_ns=20)
    assert frames[0].stamp_ns == 20
    recording, frames = read(write_video(tmp_path / "camera.mkv", start_ms=1_700_000_000_000, created=None))
    assert frames[1].stamp_ns == 1_700_000_000_067_000_000 and not recording.warnings


def test_a_table_of_every_frame(tmp_path):
    stamps = [1_700_000_000_000_000_000 + 7 * i for i in range(COUNT)]
    table = ("stamp_ns\n" + "\n".join(map(str, stamps))).encode()
    recording, frames = read(write_video(tmp_path / "camera.mp4"), times=table)
    assert [f.stamp_ns for f in frames] == stamps and not recording.warnings
    short = ("stamp_ns\n" + "\n".join(map(str, stamps[:-1]))).encode()
    for suffix in ("mp4", "mkv"):  # the number of frames is known beforehand, or at the end
        error = refused(write_video(tmp_path / f"camera.{suffix}"), times=short)
        assert error.code == "timestamps_incomplete" and "10 frames" in error.message and "9 lines" in error.message


def test_a_table_of_some_frames_and_tables_that_are_none(tmp_path):
    path = write_video(tmp_path / "camera.mp4")
    recording, frames = read(path, times=b"frame,stamp_ns\n7,700\n2,200\n")
    assert [f.stamp_ns for f in frames] == [200, 700] and numbers(frames) == [2, 7]
    assert "8 frames" in recording.warnings[0]
    for table in (b"frame,stamp_ns\n1,2\n1,3\n", b"frame,stamp_ns\nx,2\n", b"time\n1\n", b"stamp_ns\n"):
        assert refused(path, times=table).code == "timestamps_malformed"


def test_a_video_cut_short(tmp_path):
    times = tuple(range(0, 6000, 33))
    whole = write_video(tmp_path / "whole.mkv", times_ms=times)
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    _, frames = read(cut)
    assert 60 < len(frames) < len(times) and numbers(frames[:3]) == [0, 1, 2]
    table = ("stamp_ns\n" + "\n".join(str(i + 1) for i in range(len(times)))).encode()
    assert refused(cut, times=table).code == "timestamps_incomplete"  # which frames are missing is not known
    unclosed = write_video(tmp_path / "unclosed.mp4", times_ms=times)
    unclosed.write_bytes(unclosed.read_bytes()[: unclosed.stat().st_size * 2 // 3])
    error = refused(unclosed)
    assert error.code == "video_damaged" and "never closed" in error.message


def test_an_mp4_whose_directory_says_more_than_is_there(tmp_path):
    path = write_video(tmp_path / "a.mp4", times_ms=tuple(range(0, 6000, 33)), options={"movflags": "faststart"})
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    recording, frames = read(path)
    assert 30 < len(frames) < recording.sensors[0].count
    assert any("cut short" in said or "damaged" in said for said in recording.warnings)


def test_damaged_frames_are_told(tmp_path):
    path = write_video(tmp_path / "a.mp4", times_ms=tuple(range(0, 9000, 33)))
    data = bytearray(path.read_bytes())
    place = data.index(b"mdat")
    for at in range(place + 2000, place + 4000, 97):
        data[at] ^= 255
    path.write_bytes(data)
    recording, frames = read(path)
    assert frames and any("damaged" in said for said in recording.warnings)


def test_what_is_no_video(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"\0\0\0\x20ftypisom" + bytes(400))
    assert refused(tmp_path / "a.mp4").code == "video_damaged"
    (tmp_path / "b.mp4").write_bytes(b"#EXTM3U\n/etc/passwd\n" + bytes(400))
    assert refused(tmp_path / "b.mp4").code == "video_unsupported"


def test_absurd_sizes_are_refused_before_a_frame_is_decoded(tmp_path):
    """Every JPEG of a motion JPEG claims 1.5 gigapixels."""
    path = write_video(tmp_path / "a.avi", codec="mjpeg")
    data = path.read_bytes()
    header = b"\xff\xc0\x00\x11\x08"
    size = HEIGHT.to_bytes(2, "big") + WIDTH.to_bytes(2, "big")
    assert data.count(header + size) == COUNT
    data = data.replace(header + size, header + (39_000).to_bytes(2, "big") * 2)
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    error = refused(path)
    assert error.code in ("image_too_large", "video_damaged")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kilobytes


def test_players_turn_it_and_it_is_said(tmp_path):
    path = write_video(tmp_path / "a.mp4")
    data = bytearray(path.read_bytes())
    matrix = data.index(b"tkhd") + 4 + 40
    data[matrix : matrix + 36] = b"".join(
        v.to_bytes(4, "big", signed=True) for v in (0, 65536, 0, -65536, 0, 0, HEIGHT << 16, 0, 1 << 30)
    )
    path.write_bytes(data)
    recording, frames = read(path)
    assert any("unturned" in said for said in recording.warnings)
    assert numbers(frames) == list(range(COUNT))  # columns stay columns


def test_names_in_another_alphabet_than_unicode(tmp_path):
    path = write_video(tmp_path / "a.mp4", created="Kamera-Strasse")
    data = path.read_bytes()
    handler = b"VideoHandler"
    assert handler in data
    path.write_bytes(data.replace(handler, "Straßenkamer".encode("latin1")))
    _, frames = read(path)
    assert len(frames) == COUNT
