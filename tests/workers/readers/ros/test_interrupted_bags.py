"""Bags as recorders leave them: write-ahead logs, files packed one by one, files that no metadata names."""

import shutil
import sqlite3
import struct
import zipfile
from contextlib import closing

import pytest
import zstandard
from making_packets import captured, packets, write_pcap, write_pcapng
from making_recordings import CLOUD, COMPRESSED, clouds, images, interleaved, write_bag
from making_ros2 import as_cdr, rig, write_mcap, write_ros2

from apexcal.upload_sources import open_source
from workers.readers.detect import open_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.recording import ReadError


def counts(path, out):
    manifest = normalise(path, out)
    return [sensor.count for sensor in manifest.sensors], " ".join(manifest.warnings)


def in_log(db3, most=None, *, keeps_index=False):
    """Move the messages behind the first ``most`` into a write-ahead log, and leave the file as a killed recorder."""
    work = db3.with_name("recorder.db3")
    with sqlite3.connect(db3) as db:
        rows = db.execute("SELECT id, topic_id, timestamp, data FROM messages ORDER BY id").fetchall()
        db.execute("DELETE FROM messages WHERE id > ?", [rows[most][0] - 1 if most else 0])
    db.close()
    db3.rename(work)
    with sqlite3.connect(work, isolation_level=None) as vacuumed:
        vacuumed.execute("VACUUM")
    vacuumed.close()
    db = sqlite3.connect(work, isolation_level=None)
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("PRAGMA wal_autocheckpoint=0")
    for row in rows[most or 0 :]:
        db.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", row)
    for end in ("", "-wal", *(["-shm"] if keeps_index else [])):
        shutil.copy(f"{work}{end}", f"{db3}{end}")
    db.close()
    work.unlink()
    return db3


@pytest.fixture
def bag(tmp_path):
    folder = write_ros2(tmp_path / "walk", rig(6))
    return in_log(folder / "walk.db3", 9, keeps_index=True)


def packed(file):
    file.with_name(f"{file.name}.zstd").write_bytes(zstandard.ZstdCompressor().compress(file.read_bytes()))
    file.unlink()


def split(tmp_path, count=3, name="walk"):
    """The files of one recording of 2 sweeps each, without metadata."""
    folder = tmp_path / name
    folder.mkdir()
    messages = list(rig(2 * count))
    for part in range(count):
        whole = write_ros2(tmp_path / f"part{part}", messages[6 * part : 6 * part + 6])
        (whole / f"part{part}.db3").rename(folder / f"{name}_{part}.db3")
    return folder


def test_a_folder_with_a_log(bag, tmp_path):
    before = {file.name: file.read_bytes() for file in bag.parent.iterdir()}
    sensors, said = counts(bag.parent, tmp_path / "out")
    assert sensors == [6, 6] and "walk.db3-wal was read with walk.db3" in said
    assert {file.name: file.read_bytes() for file in bag.parent.iterdir()} == before  # nothing is written beside it


def test_a_bare_file_with_a_log(bag, tmp_path):
    assert counts(bag, tmp_path / "out")[0] == [6, 6]


def test_a_folder_with_a_log_and_without_metadata(bag, tmp_path):
    (bag.parent / "metadata.yaml").unlink()
    assert counts(bag.parent, tmp_path / "out")[0] == [6, 6]
    recording = open_recording(bag.parent)
    assert not any("wal" in topic or "shm" in topic for topic in recording.other_topics)
    recording.close()


def test_an_archive_with_a_log(bag, tmp_path):
    for metadata in (True, False):
        archive = tmp_path / f"{metadata}.zip"
        with zipfile.ZipFile(archive, "w") as file:
            for each in bag.parent.iterdir():
                if metadata or each.name != "metadata.yaml":
                    file.write(each, f"walk/{each.name}")
        assert counts(archive, tmp_path / f"out-{metadata}")[0] == [6, 6]


def test_an_upload_of_the_bare_file_takes_the_log(bag, tmp_path):
    source = open_source(bag)
    (tmp_path / source.name).write_bytes(source.read(0, source.size))
    assert counts(tmp_path / source.name, tmp_path / "out")[0] == [6, 6]


def test_a_file_with_all_messages_in_its_log(tmp_path):
    folder = write_ros2(tmp_path / "walk", rig(6))
    assert counts(in_log(folder / "walk.db3").parent, tmp_path / "out")[0] == [6, 6]


def test_a_log_that_ends_inside_a_message(bag, tmp_path):
    log = bag.with_name("walk.db3-wal")
    log.write_bytes(log.read_bytes()[:-1000])
    assert counts(bag.parent, tmp_path / "out")[0] in ([6, 5], [5, 6], [5, 5])


def test_a_strangers_log_is_not_believed(bag, tmp_path):
    log = bag.with_name("walk.db3-wal")
    log.write_bytes(b"\0" * log.stat().st_size)
    assert counts(bag.parent, tmp_path / "out")[0] == [3, 3]


def test_a_log_that_brings_a_view_is_refused(bag):
    db = sqlite3.connect(bag, isolation_level=None)
    db.execute("PRAGMA wal_autocheckpoint=0")
    db.execute("CREATE VIEW more AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n")
    with pytest.raises(ReadError) as error:
        open_recording(bag)
    db.close()
    assert error.value.code == "sqlite_not_plain"


def test_a_log_counts_as_bytes_that_are_written(bag, monkeypatch):
    from workers.readers import output

    monkeypatch.setattr(output._WRITTEN, "most", 1000)
    monkeypatch.setattr(output._WRITTEN, "count", 0)
    with pytest.raises(ReadError) as error:
        open_recording(bag)
    assert error.value.code == "archive_expands"


def test_parts_that_are_packed_one_by_one(tmp_path):
    folder = split(tmp_path)
    for file in list(folder.iterdir()):
        packed(file)
    assert counts(folder, tmp_path / "out")[0] == [6, 6]


def test_the_last_part_was_not_packed_yet(tmp_path):
    folder = split(tmp_path, 12)
    for file in list(folder.iterdir()):
        if not file.name.endswith("_11.db3"):
            packed(file)
    in_log(folder / "walk_11.db3", 1)
    assert counts(folder, tmp_path / "out")[0] == [24, 24]
    with closing(open_recording(folder)) as recording:
        stamps = [item.stamp_ns for _, item in recording.messages(recording.sensors)]
    assert stamps == sorted(stamps)  # part 10 comes behind part 9


def test_a_part_that_is_there_packed_and_unpacked(tmp_path):
    folder = split(tmp_path)
    plain = folder / "walk_1.db3"
    content = plain.read_bytes()
    packed(plain)
    plain.write_bytes(content)  # as `ros2 bag play` leaves it
    assert counts(folder, tmp_path / "out")[0] == [6, 6]


def test_files_that_the_metadata_do_not_name(tmp_path):
    folder = split(tmp_path)
    whole = write_ros2(tmp_path / "metadata", rig(2))
    text = (whole / "metadata.yaml").read_text().replace("metadata.db3", "walk_0.db3")
    (folder / "metadata.yaml").write_text(text)
    sensors, said = counts(folder, tmp_path / "out")
    assert sensors == [6, 6] and "2 of the bag's files are not in metadata.yaml and were read" in said


def test_a_topic_that_begins_in_a_later_part(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    messages = list(as_cdr(rig(6)))
    points = [each for each in messages[:9] if each[1] == CLOUD]
    write_mcap(folder / "walk_0.mcap", points)
    write_mcap(folder / "walk_1.mcap", [each for each in messages[9:] if each[1] in (CLOUD, COMPRESSED)])
    assert counts(folder, tmp_path / "out")[0] == [6, 3]


def test_parts_whose_names_hold_their_own_dates(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    messages = list(interleaved(clouds(6), images(6)))
    write_bag(folder / "2026-05-01-10-00-00_0.bag", messages[:6])
    write_bag(folder / "2026-05-01-10-00-30_1.bag", messages[6:])
    assert counts(folder, tmp_path / "out")[0] == [6, 6]


@pytest.mark.parametrize(("write", "record"), [(write_pcap, 16), (write_pcapng, 28)])
def test_a_capture_cut_by_its_snap_length(tmp_path, write, record):
    frames = list(captured(packets(turns=1.1)))
    path = write(tmp_path / "whole.pcap", frames)
    content, cut = path.read_bytes(), bytearray()
    size = len(frames[0][1])
    assert size == 1248
    # Every frame keeps 96 bytes, as with `tcpdump -s 96`; the record goes on stating its whole length.
    place = content.index(frames[0][1]) - record
    cut += content[:place]
    for _ in frames:
        head, body = bytearray(content[place : place + record]), content[place + record : place + record + 96]
        if write is write_pcap:
            struct.pack_into("<I", head, 8, 96)
            cut += head + body
            place += record + size
        else:
            struct.pack_into("<I", head, 4, 32 + 96)
            struct.pack_into("<I", head, 20, 96)
            cut += head + body + struct.pack("<I", 32 + 96)
            place += 32 + size
    path.write_bytes(bytes(cut))
    with pytest.raises(ReadError) as error:
        open_recording(path)
    assert error.value.code == "capture_cut" and "tcpdump -s 0" in error.value.message
    assert f"{len(frames)} packets were captured in part only, at most 96 bytes" in error.value.message
