import random

import pytest
from mcap.reader import NonSeekingReader, SeekingReader

from workers.readers.mcap_io.writer import CHUNK_BYTES, McapWriter

SCHEMA = ("std_msgs/msg/String", "string data\n")


def made(path, messages, level):
    file = McapWriter(path, "ros2", *(() if level is None else ("zstd", level)))
    channel = file.add_channel("/topic", file.add_schema(SCHEMA[0], "ros2msg", SCHEMA[1].encode()), "cdr")
    for stamp, parts in messages:
        file.add(channel, stamp, *parts)
    file.add_metadata("facts", {"a": "1"})
    file.finish()
    return path


@pytest.fixture(scope="module")
def messages():
    """Stamps in disorder, messages in one part and in several, an empty one, one larger than a chunk."""
    random.seed(0)
    sizes = [10, 0, 3, CHUNK_BYTES + 5, 400_000, 400_000, 400_000, 400_000, 7]
    return [
        (10_000 - 1000 * (i % 3) + i, (random.randbytes(size // 2), memoryview(bytes(size - size // 2))))
        for i, size in enumerate(sizes)
    ]


@pytest.mark.parametrize("level", [None, -1, 3])
def test_the_formats_own_library_reads_it_and_its_checksums(tmp_path, messages, level):
    path = made(tmp_path / "a.mcap", messages, level)
    given = [(stamp, b"".join(parts)) for stamp, parts in messages]
    with path.open("rb") as file:
        reader = SeekingReader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == len(given) and summary.statistics.chunk_count == 3
        assert summary.statistics.message_start_time == min(s for s, _ in given)
        assert summary.statistics.message_end_time == max(s for s, _ in given)
        assert {c.compression for c in summary.chunk_indexes} == {"" if level is None else "zstd"}
        assert [(r.name, r.metadata) for r in reader.iter_metadata()] == [("facts", {"a": "1"})]
        found = [(m.log_time, m.data) for _, _, m in reader.iter_messages()]
        assert sorted(found) == sorted(given)
        file.seek(0)
        in_order = [(m.log_time, m.data) for _, _, m in NonSeekingReader(file).iter_messages(log_time_order=False)]
        assert in_order == given
        schema, channel, _ = next(iter(reader.iter_messages()))
        assert (schema.name, schema.data.decode(), channel.topic) == (*SCHEMA, "/topic")


def test_without_a_message(tmp_path):
    with made(tmp_path / "a.mcap", [], -1).open("rb") as file:
        summary = SeekingReader(file, validate_crcs=True).get_summary()
        assert (summary.statistics.message_count, summary.chunk_indexes) == (0, [])
