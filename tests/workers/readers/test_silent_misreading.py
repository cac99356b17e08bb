"""Damage that a reader does not notice changes no more points than the bytes that it touched can.

Whole recordings are damaged, read in this process, and compared with what the whole file gives: point by point. If no
byte was moved, a point may differ only where its own bytes, its packet's or its line's were touched. If bytes were
moved, only those of the message or packets in which that happened may; of a file that is cut off, one at most.
"""

import random
from typing import NamedTuple

import numpy as np
import pytest
from formats import tar_of, zip_of
from fuzz_mutations import (
    cut_out,
    fill,
    flip_bits,
    overwrite,
    point_elsewhere,
    repeat,
    repeat_at_end,
    set_length,
    splice,
    truncate,
)
from fuzz_seeds import array_members, kitti_members, make_whole, members, ply_members, table_members

from workers.readers.choose import choose_sensors
from workers.readers.detect import open_recording
from workers.readers.recording import ReadError

# Damaged numbers are infinite and the like; what comes of them is looked at here.
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")
LONG = [pytest.mark.slow, pytest.mark.timeout(7200)]
SHORT_AND_LONG = [range(100), pytest.param(range(100, 10_100), marks=LONG)]
IN_PLACE = (flip_bits, fill, overwrite, point_elsewhere, set_length)
MOVING = (truncate, cut_out, repeat, repeat_at_end, splice)


class Kind(NamedTuple):
    """A whole file; how many points one touched byte may change; and how many a place where bytes were moved."""

    data: bytes
    touched: int
    moved: int


def kinds(folder):
    """The whole files by name. What is packed is checked by sums, so that no damage changes a point of it."""
    whole = make_whole(folder)
    sweep, packet = 16 * 20, 384
    packets = Kind(b"", packet, 2 * packet)
    plain = {path: data for path, data in members().items() if not path.endswith(("2.pcd", ".csv"))}
    plain["timestamps.csv"] = b"\n".join(
        line for line in members()["timestamps.csv"].split(b"\n") if b"2.pcd" not in line
    )
    found = {
        "rosbag1": Kind(whole["rosbag1"][0], 1, sweep),
        "mcap": Kind(whole["mcap"][0], 1, sweep),
        "db3": Kind(whole["db3"][0], 1, sweep),
        "protobuf": Kind(whole["mcap"][3], 1, sweep),
        "JSON": Kind(whole["mcap"][4], 1, sweep),
        "clouds": Kind(tar_of(plain), 1, sweep),
        # A compressed column repeats what came before, and has no sum.
        "packed clouds": Kind(tar_of(members()), sweep, sweep),
        "KITTI": Kind(tar_of(kitti_members()), 1, 3 * sweep),
        "arrays": Kind(tar_of(array_members()), 1, sweep),
        "tables": Kind(tar_of(table_members()), 1, sweep),
        "PLY": Kind(tar_of(ply_members()), 1, sweep),
        "pcapng": packets._replace(data=whole["pcapng"][0]),
        "packets in db3": packets._replace(data=whole["db3"][1]),
        "zip": Kind(zip_of(members()), 0, 0),
        **{f"tar.{name}": Kind(tar_of(members(), f"w:{name}"), 0, 0) for name in ("gz", "bz2", "xz")},
        "mcap zstd": Kind(whole["mcap"][1], 0, 0),
        "mcap lz4": Kind(whole["mcap"][2], 0, 0),
        "rosbag1 bz2": Kind(whole["rosbag1 packed"][1], 0, 0),
    }
    return found | {f"pcap {number}": packets._replace(data=data) for number, data in enumerate(whole["pcap"])}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return kinds(tmp_path_factory.mktemp("whole"))


def points(path):
    """Points as bytes, of all sweeps; None where the recording is refused."""
    try:
        recording = open_recording(path)
        try:
            lidar = choose_sensors(recording, None, None)["lidar"]
            sweeps = [np.ascontiguousarray(sweep.xyz) for sweep in recording.sweeps(lidar)]
        finally:
            recording.close()
    except ReadError:
        return None
    return [row.tobytes() for xyz in sweeps for row in xyz]


def damaged(whole, number):
    """Case ``number``: its kind, the bytes, and how many points may differ."""
    rng = random.Random(number)
    name = [*whole][number % len(whole)]
    before, per_byte, per_place = whole[name]
    how = rng.choice(IN_PLACE + MOVING)
    after = bytes(how(rng, before, [before]))
    if how in MOVING:
        return name, after, min(1, per_place) if how is truncate else per_place
    after = after[: len(before)].ljust(len(before), b"\0")
    return name, after, per_byte * sum(a != b for a, b in zip(after, before, strict=True))


def check(whole, folder, numbers):
    upload = folder / "upload"
    there = {}
    for name, kind in whole.items():
        upload.write_bytes(kind.data)
        there[name] = set(points(upload))
    read, complaints = 0, []
    for number in numbers:
        name, data, allowed = damaged(whole, number)
        upload.write_bytes(data)
        found = points(upload)
        if found is None:
            continue
        read += 1
        strange = sum(point not in there[name] for point in found)
        if strange > allowed:
            complaints.append(f"case {number} ({name}): {strange} of {len(found)} points differ, {allowed} may")
    assert not complaints, "\n".join(complaints)
    assert read > 0.3 * len(numbers)  # or nothing was looked at


@pytest.mark.parametrize("numbers", SHORT_AND_LONG)
def test_no_point_is_misread_in_silence(whole, tmp_path, numbers):
    check(whole, tmp_path, numbers)
