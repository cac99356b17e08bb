"""Times in files' names as programs write them; the whole folder tells how, or its owner is asked."""

from datetime import UTC, datetime

import pytest
from formats import CLOUDS, folder_of, frames_of, read, sweeps_of
from making_recordings import png

from workers.readers.recording import ReadError
from workers.readers.trees.file_times import stamp_series
from workers.readers.trees.series import find_series

T0 = 1_700_000_000
# Of twelve sweeps of 10 Hz and their frames 23 ms later; some parts of a second begin with zeros.
SWEEPS_NS = [T0 * 10**9 + 903_000_000 + i * 100_000_000 for i in range(12)]
FRAMES_NS = [stamp + 23_000_000 for stamp in SWEEPS_NS]


def moment(ns):
    return datetime.fromtimestamp(ns // 10**9, UTC)


def seconds_and_count(unit, separator="."):
    return lambda ns: f"{ns // 10**9}{separator}{ns % 10**9 // unit}"


def decimals(digits, separator="."):
    return lambda ns: f"{ns // 10**9}{separator}{ns % 10**9 // 10 ** (9 - digits):0{digits}d}"


NAMES = {
    "nanoseconds that were not filled up": seconds_and_count(1),
    "microseconds that were not filled up": seconds_and_count(1000),
    "milliseconds that were not filled up": seconds_and_count(10**6),
    "nanoseconds behind a line": seconds_and_count(1, "_"),
    "microseconds behind a dash": seconds_and_count(1000, "-"),
    "decimals of one length": decimals(6),
    "nine decimals": decimals(9),
    "milliseconds behind a line": decimals(3, "_"),
    "decimals that were shortened": lambda ns: repr(ns // 10**6 / 1000),
    "a date with milliseconds": lambda ns: f"{moment(ns):%Y-%m-%d_%H-%M-%S}-{ns % 10**9 // 10**6:03d}",
    "a date of ISO": lambda ns: f"{moment(ns):%Y-%m-%dT%H-%M-%S}.{ns % 10**9 // 1000:06d}Z",
    "digits of a date": lambda ns: f"{moment(ns):%Y%m%d%H%M%S}{ns % 10**9 // 10**6:03d}",
    "digits of date and time": lambda ns: f"{moment(ns):%Y%m%d_%H%M%S}_{ns % 10**9 // 10**6:03d}",
    "a date with microseconds that were not filled up": lambda ns: f"{moment(ns):%Y%m%d-%H%M%S}.{ns % 10**9 // 1000}",
    "a word before": lambda ns: f"cloud_{decimals(9)(ns)}",
    "a word before a date": lambda ns: f"frame_{moment(ns):%Y_%m_%d-%H_%M_%S}_{ns % 10**9 // 10**6:03d}",
    "nanoseconds since 1970": str,
    "microseconds since 1970": lambda ns: str(ns // 1000),
}


def walk(path, name, frame_name=None):
    files = {f"clouds/{name(ns)}.pcd": CLOUDS["binary.pcd"] for ns in SWEEPS_NS}
    files |= {f"images/{(frame_name or name)(ns)}.png": png(8, 6, 1) for ns in FRAMES_NS}
    assert len(files) == 24
    return folder_of(path / "walk", files)


@pytest.mark.parametrize("name", NAMES)
def test_names_give_the_moments(tmp_path, name):
    recording, items, _ = read(walk(tmp_path, NAMES[name]))
    assert [sensor.name for sensor in recording.sensors] == ["images", "clouds"]
    assert [item.stamp_ns for item in sweeps_of(items)] == SWEEPS_NS
    assert [item.stamp_ns for item in frames_of(items)] == FRAMES_NS


def test_one_sensor_s_names_tell_what_another_s_leave_open(tmp_path):
    """Frames at 0.1 s have parts without a zero at either end; those of the clouds end in zeros."""
    path = walk(tmp_path, seconds_and_count(1))
    for number, file in enumerate(sorted((path / "images").iterdir())):
        file.rename(file.with_name(f"{T0 + number}.{(7, 300000001)[number % 2]}.png"))
    stamps = [item.stamp_ns for item in frames_of(read(path)[1])]
    assert stamps == [(T0 + i) * 10**9 + (7, 300000001)[i % 2] for i in range(12)]


@pytest.mark.parametrize(
    "name",
    [
        lambda ns: f"{ns // 10**9}.{(ns // 10**8) % 97 * 7 + 1}1",  # neither reading is even
        lambda ns: f"{ns // 10**9}.0{ns % 10**9 // 10**7}" + "0" * (ns // 10**8 % 2),  # zeros at both ends
        lambda ns: f"{ns // 10**9}_{(ns - SWEEPS_NS[0]) // 10**8:06d}",  # a count of the files
    ],
)
def test_names_that_may_be_one_thing_or_another_are_asked_about(tmp_path, name):
    with pytest.raises(ReadError) as caught:
        read(walk(tmp_path, name))
    assert caught.value.code == "files_without_times" and "timestamps.csv" in caught.value.hint


SESSION = "2024-05-01-10-00-00"


@pytest.mark.parametrize(
    "name",
    [
        *("{:06d}", "{}", "pose{}", "2023_{:03d}"),
        *(f"{SESSION}_{{:04d}}", f"{SESSION}_{{:02d}}", f"{SESSION}_{{}}", "walk_20240501_100000-{:06d}"),
    ],
)
def test_numbers_stay_numbers(tmp_path, name):
    names = {ns: name.format(i) for stamps in (SWEEPS_NS, FRAMES_NS) for i, ns in enumerate(stamps)}
    items = read(walk(tmp_path, names.__getitem__))[1]
    assert [item.stamp_ns for item in sweeps_of(items)] == [10**9 + i * 10**8 for i in range(12)]


@pytest.mark.parametrize("date", ["{}", "cam_{}", "{}_102030", "walk-{}T10-20-30"])
@pytest.mark.parametrize("number", ["_{:06d}", "-{}", "_{:04d}"])
def test_numbers_behind_the_dates_of_several_sessions_go_on(date, number):
    """Of more than 60 files some numbers are no seconds."""
    days = [f"{date.format(day)}{number.format(i)}" for day in (20240501, 20240503) for i in range(70)]
    series = find_series([*(f"clouds/{name}.pcd" for name in days), *(f"images/{name}.png" for name in days)])
    assert [each.name for each in series] == ["images", "clouds"]
    stamp_series(series, {}, {})
    stamps = [[each.stamps_ns[path] for path in each.paths] for each in series]
    assert stamps[0] == stamps[1] == sorted(set(stamps[0])) and len(stamps[0]) == 140
    assert {each.times_from for each in series} == {"index"}


def test_seconds_of_a_day_are_times(tmp_path):
    names = [f"{moment((T0 + i) * 10**9):%Y%m%d_%H%M%S}" for i in range(8)]
    path = folder_of(tmp_path / "walk", {f"{name}.png": png(8, 6, 1) for name in names})
    assert [item.stamp_ns for item in frames_of(read(path)[1])] == [(T0 + i) * 10**9 for i in range(8)]


def test_a_lost_file_makes_no_times_of_numbers(tmp_path):
    names = {ns: f"{SESSION}_{i:04d}" for stamps in (SWEEPS_NS, FRAMES_NS) for i, ns in enumerate(stamps)}
    path = walk(tmp_path, names.__getitem__)
    (path / "clouds" / f"{SESSION}_0005.pcd").unlink()
    stamps = [item.stamp_ns for item in sweeps_of(read(path)[1])]
    assert stamps == [10**9 + i * 10**8 for i in range(12) if i != 5]
