"""Small files that would take a reader's time, memory or disk; most would be read as a recording."""

import sqlite3
import struct
import zipfile

import numpy as np
from formats import pcd
from making_long import frame
from making_recordings import (
    COMPRESSED,
    IMAGE,
    PERIOD_NS,
    START_NS,
    clouds,
    compressed,
    images,
    interleaved,
    jpeg_claiming,
    raw_image,
    write_bag,
)
from making_ros2 import TYPES, as_cdr, rig, write_mcap, write_ros2
from making_videos import write_video
from mcap.writer import CompressionType
from pypcd4 import Encoding
from rosbags.rosbag1 import Writer as BagWriter

_CAMERA = "/front/image_raw/compressed"
_ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)"


def padded(size):
    """What begins like a JPEG of 1280 x 720, and is as long as wanted with zeros."""
    head = jpeg_claiming(1280, 720)
    return head[:-2] + bytes(size - len(head)) + head[-2:]


def _bag(path):
    (file,) = write_ros2(path.with_suffix(".folder"), rig(2)).glob("*.db3")
    file.rename(path)
    return path


def _edited(path, *statements):
    with sqlite3.connect(_bag(path), isolation_level=None) as db:
        for statement in statements:
            db.execute(statement)
        db.execute("VACUUM")
    db.close()
    return path


def endless_view(path):
    """The definitions of messages are a view that never ends."""
    return _edited(
        path,
        "DROP TABLE IF EXISTS message_definitions",
        f"CREATE VIEW message_definitions AS {_ENDLESS} SELECT count(*) AS topic_type, 'a' AS encoding, "
        "'b' AS encoded_message_definition FROM n",
    )


def endless_messages(path):
    """The messages are a view that never ends."""
    return _edited(
        path,
        "ALTER TABLE messages RENAME TO kept",
        f"CREATE VIEW messages AS {_ENDLESS} SELECT 1 AS id, 99 AS topic_id, x AS timestamp, x'' AS data FROM n",
    )


def _many(path, data, count, default=False):
    """``messages`` of which each but the real ones has only a number, and its data from the table's definition."""
    statements = (
        "CREATE TABLE kept AS SELECT * FROM messages",
        "DROP TABLE messages",
        f"CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, own BLOB{'' if default else data})",
    )
    file = _edited(path, *statements)
    with sqlite3.connect(file, isolation_level=None) as db:
        (topic,) = db.execute("SELECT id FROM topics WHERE name = ?", [_CAMERA]).fetchone()
        db.execute("BEGIN")
        columns = "id, topic_id, timestamp"
        db.execute(f"INSERT INTO messages ({columns}, own) SELECT {columns}, data FROM kept")
        rows = ((100 + i, topic, START_NS + i * PERIOD_NS) for i in range(count))
        db.executemany(f"INSERT INTO messages ({columns}) VALUES (?, ?, ?)", rows)
        db.execute("COMMIT")
        if default:
            db.execute("ALTER TABLE messages DROP COLUMN own")
            db.execute(f"ALTER TABLE messages ADD COLUMN {data}")
            own = "SELECT data FROM kept WHERE kept.id = messages.id"
            db.execute(f"UPDATE messages SET data = ({own}) WHERE id < 100")
        db.execute("DROP TABLE kept")
        db.execute("VACUUM")
    db.close()
    return file


def _image_cdr(data):
    return bytes(TYPES.serialize_cdr(compressed(START_NS, data, TYPES), COMPRESSED))


def generated_column(path, size=400 * 1024**2):
    """5,000 short rows whose data a generated column makes: what is stored is far more than the file."""
    count = 5000
    body = _image_cdr(padded(size // count))
    kept = body[:2000]
    made = f"coalesce(own, CAST(x'{kept.hex()}' || zeroblob({len(body) - len(kept)}) AS BLOB))"
    return _many(path, f", data BLOB GENERATED ALWAYS AS ({made}) VIRTUAL", count)


def default_column(path, size=64 * 1024**2):
    """Short rows that lack a column, whose default is long."""
    body = _image_cdr(frame(1)[:60_000] + b"\xff\xd9")
    return _many(path, f"data BLOB DEFAULT x'{body.hex()}'", size // len(body), default=True)


def zstd_chunks(path, size=481 * 1024**2):
    """Images of zeros in compressed chunks."""
    count = size // 2_000_000
    body = padded(2_000_000)
    stamps = (START_NS + i * PERIOD_NS for i in range(count))
    frames = ((_CAMERA, COMPRESSED, stamp, compressed(stamp, body, TYPES)) for stamp in stamps)
    messages = [m for m in rig(1) if m[0] != _CAMERA]
    return write_mcap(path, as_cdr([*messages, *frames]), compression=CompressionType.ZSTD, chunk_size=100 * 1024**2)


def endless_tree(path, levels=5, page=4096):
    """A table whose inner pages name the same page again and again: 500 to the fifth rows in a few pages."""
    file = _bag(path)
    with sqlite3.connect(file) as db:
        (root,) = db.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
        (size,) = db.execute("PRAGMA page_size").fetchone()
    db.close()
    data = bytearray(file.read_bytes())
    assert size == page
    pages = len(data) // page
    # The leaves move to a page of their own, and the root becomes the top of the tree.
    leaf = bytes(data[(root - 1) * page : root * page])
    below = pages + 1
    data += leaf
    for level in range(levels):
        top = level == levels - 1
        node = _inner_page(below, page)
        if top:
            data[(root - 1) * page : root * page] = node
        else:
            data += node
            below += 1
    struct.pack_into(">I", data, 28, len(data) // page)
    file.write_bytes(data)
    return file


def _inner_page(child, page):
    cell = struct.pack(">I", child) + b"\x7f"
    count = (page - 12) // (len(cell) + 2)
    start = page - count * len(cell)
    places = struct.pack(f">{count}H", *(start + i * len(cell) for i in range(count)))
    head = struct.pack(">BHHHBI", 5, 0, count, start, 0, child)
    return (head + places).ljust(start, b"\0") + cell * count


def repeated_index(path, times=2000):
    """A ROS 1 bag whose index names the same messages again and again."""
    whole = write_bag(path, interleaved(clouds(2), images(2, data=frame(1)))).read_bytes()
    out, place = bytearray(), 0
    moved = {}
    while (found := whole.find(b"op=\x04", place)) >= 0:
        # An index record: header length, header (op, ver, conn, count), data length, entries of 12 bytes.
        head_at = whole.rfind(struct.pack("<I", 47), place, found)
        data_at = head_at + 4 + 47
        (length,) = struct.unpack_from("<I", whole, data_at)
        header = bytearray(whole[head_at + 4 : data_at])
        at = header.index(b"count=") + 6
        (count,) = struct.unpack_from("<I", header, at)
        struct.pack_into("<I", header, at, count * times)
        entries = whole[data_at + 4 : data_at + 4 + length]
        out += whole[place:head_at] + struct.pack("<I", 47) + header
        out += struct.pack("<I", length * times) + entries * times
        place = data_at + 4 + length
        moved[place] = len(out)
    shift = len(out) - place
    out += whole[place:]
    at = out.index(b"index_pos=") + 10
    struct.pack_into("<Q", out, at, struct.unpack_from("<Q", out, at)[0] + shift)
    path.write_bytes(out)
    return path


def flat_images(path, count=60, compression=BagWriter.CompressionFormat.LZ4):
    """Raw images of one grey, 8 megapixels each, in packed chunks."""
    pixels = np.full((2000, 4000), 7, np.uint8)
    stamps = [START_NS + i * PERIOD_NS for i in range(count)]
    return write_bag(
        path, [*clouds(2), *(("/a", IMAGE, s, raw_image(s, pixels, "mono8")) for s in stamps)], compression
    )


def many_frames(path, count=400):
    """A still video: a hundred bytes a frame, each of which becomes a JPEG."""
    folder = path.with_suffix(".parts")
    folder.mkdir()
    write_video(folder / "still.mp4", times_ms=[33 * i for i in range(count)], size=(1280, 720))
    write_bag(folder / "lidar.bag", clouds(2))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.iterdir()):
            archive.write(file, file.name)
    return path


def packed_zeros(path, size=60_000_000):
    """A zip with a bag that is mostly a hole."""
    bag = write_bag(path.with_suffix(".bag"), clouds(2))
    with bag.open("r+b") as file:
        file.truncate(size)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(bag, "a.bag")
    return path


def claiming_clouds(path):
    """Packed PCD files whose headers claim points that their bytes cannot hold."""
    with zipfile.ZipFile(path, "w") as archive:
        for i in range(2):
            archive.writestr(f"clouds/{START_NS + i * PERIOD_NS}.pcd", _claiming_pcd())
    return path


def _claiming_pcd(points=9_000_000):
    data = pcd(Encoding.BINARY_COMPRESSED)
    start = data.index(b"DATA binary_compressed\n") + len(b"DATA binary_compressed\n")
    old = int(data[data.index(b"POINTS ") + 7 :].split()[0])
    head = data[:start].replace(b"%d" % old, b"%d" % points)
    packed, unpacked = struct.unpack_from("<II", data, start)
    return head + struct.pack("<II", packed, unpacked // old * points) + data[start + 8 :]


# Short forms, for whoever damages them; each is past the limits as it is, or was before there were any.
BOMBS = {
    "endless_view": endless_view,
    "endless_messages": endless_messages,
    "generated_column": generated_column,
    "default_column": default_column,
    "zstd_chunks": zstd_chunks,
    "endless_tree": endless_tree,
    "repeated_index": lambda path: repeated_index(path, 200),
    "flat_images": lambda path: flat_images(path, 8),
    "many_frames": lambda path: many_frames(path, 60),
    "packed_zeros": packed_zeros,
    "claiming_clouds": claiming_clouds,
}
