"""Damage that a reader does not notice changes no more points than the bytes that it touched can.

Whole recordings are damaged without moving bytes, read in this process, and compared with what the whole file gives:
point by point. A point may differ only where its own bytes, its packet's or its line's were touched.
"""

import os
import random

import numpy as np
import pytest
from fuzz_mutations import fill, flip_bits, overwrite, point_elsewhere, set_length
from fuzz_seeds import array_members, kitti_members, make_whole, members, table_members, tar_of

from workers.readers.choose import choose_sensors
from workers.readers.detect import open_recording
from workers.readers.recording import ReadError

# Damaged numbers are infinite and the like; what comes of them is looked at here.
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")
SHORT = 200
LONG = 10_000
IN_PLACE = (flip_bits, fill, overwrite, point_elsewhere, set_length)


def kinds(folder):
    """Name -> whole file, and how many points one touched byte may change."""
    whole = make_whole(folder)
    return {
        "rosbag1": (whole["rosbag1"][0], 1),
        "pcap": (whole["pcap"][0], 384),
        "pcapng": (whole["pcapng"][0], 384),
        "mcap": (whole["mcap"][0], 1),
        "db3": (whole["db3"][0], 1),
        "clouds": (tar_of(members()), 1),
        "KITTI": (tar_of(kitti_members()), 1),
        "arrays": (tar_of(array_members()), 1),
        "tables": (tar_of(table_members()), 1),
    }


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
    """Case ``number``: its kind, the bytes, and how many of them are others than before."""
    rng = random.Random(number)
    name = [*whole][number % len(whole)]
    before, _ = whole[name]
    after = bytes(rng.choice(IN_PLACE)(rng, before, [before]))[: len(before)].ljust(len(before), b"\0")
    return name, after, sum(a != b for a, b in zip(after, before, strict=True))


def check(whole, folder, numbers):
    upload = folder / "upload"
    there = {}
    for name, (data, _) in whole.items():
        upload.write_bytes(data)
        there[name] = set(points(upload))
    read, complaints = 0, []
    for number in numbers:
        name, data, touched = damaged(whole, number)
        upload.write_bytes(data)
        found = points(upload)
        if found is None:
            continue
        read += 1
        strange = sum(point not in there[name] for point in found)
        if strange > touched * whole[name][1]:
            complaints.append(
                f"case {number} ({name}): {touched} bytes touched, {strange} of {len(found)} points differ"
            )
    assert not complaints, "\n".join(complaints)
    assert read > 0.3 * len(numbers)  # or nothing was looked at


def test_no_point_is_misread_in_silence(whole, tmp_path):
    check(whole, tmp_path, range(SHORT))


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_ten_thousand_damaged_files_have_no_point_misread(whole, tmp_path):
    first = int(os.environ.get("FIRST", str(SHORT)))
    check(whole, tmp_path, range(first, first + int(os.environ.get("CASES", str(LONG)))))
