"""Clocks that are apart or step, as the times of recording tell it. Truth is in the simulated clocks alone."""

from time import process_time

import numpy as np
import pytest
from making_packets import packets
from making_recordings import CLOUD, COMPRESSED, cloud, compressed, png, scene
from making_ros2 import SCAN, TYPES, as_cdr, scan, write_mcap, write_ros2

from workers.readers.normalised.clocks import Times, offset_reports, offset_sentence, report_clocks
from workers.readers.normalised.normalise import normalise
from workers.readers.normalised.sensor_files import FrameFile, SweepFile

T0 = 1_700_000_000 * 10**9
S = 10**9


def recorded(clocks, *, seconds=30.0, rates=None, recorder=lambda t: T0 + t, delay=None, seed=1, lost=()):
    """Times of sensors whose clocks are functions of true ns since the beginning, as a recorder takes them down.

    Args:
        clocks: by sensor, true time to stamp.
        recorder: true time to time of recording.
        delay: by sensor, (least, spread) of the delays in ms.
        lost: (sensor, first, last) seconds in which messages are lost.
    """
    random = np.random.default_rng(seed)
    rows = []
    for k, (name, clock) in enumerate(clocks.items()):
        rate = (rates or {}).get(name, 10.0)
        true = np.round((np.arange(int(seconds * rate)) / rate + 0.011 * k) * S).astype(np.int64)
        gone = np.zeros(len(true), bool)
        for who, first, last in lost:
            gone |= (who == name) & (true >= first * S) & (true < last * S)
        true = true[~gone]
        least, spread = (delay or {}).get(name, (5.0, 2.0))
        late = true + np.round((least + random.exponential(spread, len(true))) * 1e6).astype(np.int64)
        rows += [(int(b), name, int(clock(int(a))), int(recorder(int(b)))) for a, b in zip(true, late, strict=True)]
    rows.sort()
    times = {}
    for name in clocks:
        own = [(number, stamp, log) for number, (_, of, stamp, log) in enumerate(rows) if of == name]
        times[name] = Times(*(np.array(column, np.int64) for column in zip(*own, strict=True)))
    return times


def step(at_s, size_s, base=T0):
    return lambda t: base + t + (int(size_s * S) if t >= at_s * S else 0)


def unix(t):
    return T0 + t


def corrected(times, reports):
    return {name: each.stamp + reports[name].added_ns for name, each in times.items()}


@pytest.mark.parametrize(
    ("lidar", "camera", "offset_s"),
    [
        (lambda t: 4281 * S + t, unix, 1_700_000_000 - 4281),  # since the LiDAR's boot
        (lambda t: T0 + 37 * S + t, unix, -37),  # PTP without a UTC offset: TAI
        (lambda t: T0 + 18 * S + t, unix, -18),  # GPS time
        (unix, lambda t: 12 * S + t, 12 - 1_700_000_000),  # a camera's own counter
        (unix, lambda t: T0 - 7200 * S + t, -7200),  # local time in the place of UTC
        (lambda t: t % (3600 * S), unix, 1_700_000_000),  # time since the hour
    ],
)
def test_clocks_that_are_apart(lidar, camera, offset_s):
    times = recorded({"lidar": lidar, "front": camera}, delay={"lidar": (5, 2), "front": (12, 8)})
    reports = report_clocks(times)
    offset = reports["front"].offset
    assert abs(offset.offset_ns - offset_s * S) < 0.02 * S and 0 < offset.spread_ns < 0.02 * S
    assert not reports["front"].steps and not reports["lidar"].steps
    sentence = offset_sentence("front", offset)
    assert ("ahead of" if offset_s > 0 else "behind") in sentence and ("TAI" in sentence) == (abs(offset_s) == 37)
    if abs(offset_s) in (18, 37):  # of time scales: exact
        assert offset.offset_ns == offset_s * S


@pytest.mark.parametrize("apart_ms", [0, 40, -80, 300, 800])
def test_delays_are_no_other_clock(apart_ms):
    times = recorded({"lidar": unix, "front": lambda t: T0 + t + apart_ms * 10**6}, delay={"lidar": (105, 5)})
    report = report_clocks(times)["front"]
    assert report.offset is None and not report.step_sentences and not report.added_ns.any()


@pytest.mark.parametrize("seed", range(3))
def test_simulated_time_slower_than_the_clock_on_the_wall(seed):
    """A tick of 0.05 s takes 1.4 s; in each the camera is written before the LiDAR, with the same stamp."""
    random = np.random.default_rng(seed)
    tick = np.arange(200)
    stamp, log = tick * S // 20, T0 + np.cumsum(random.normal(1.4, 0.05, 200) * S).astype(np.int64)
    times = {"lidar": Times(2 * tick + 1, stamp, log + 50_000_000), "front": Times(2 * tick, stamp, log)}
    for sensors in (
        times,
        {"lidar": Times(2 * tick, stamp, log), "front": Times(2 * tick + 1, stamp, log + S // 20)},
    ):
        assert report_clocks(sensors)["front"].offset is None
        assert offset_reports(sensors)["front"].offset is None


def test_an_offset_within_its_spread_is_chance():
    random = np.random.default_rng(2)
    number, stamp = np.arange(200), T0 + np.arange(200) * S // 10
    late = (random.exponential(3.0, 200) * S).astype(np.int64)
    times = {"lidar": Times(2 * number, stamp, stamp), "front": Times(2 * number + 1, stamp, stamp + late)}
    assert offset_reports(times)["front"].offset is None


def test_clouds_whose_clock_goes_to_and_fro_take_no_time():
    count = 1_000_000
    number, stamp = np.arange(count), T0 + np.arange(count) * S // 10
    log = stamp - np.where(number % 2, 7200 * S, 0)
    camera = Times(number[:50] * 2, stamp[:50], log[:50])
    begin = process_time()
    report_clocks({"lidar": Times(2 * number + 1, stamp, log), "front": camera})
    assert process_time() - begin < 20  # a half; it was over 40


# (LiDAR, camera, recorder, who steps, at, by)
STEPS = {
    "host, camera stamped by it": (unix, step(6.5, 37), step(6.5, 37), "front", 6.5, 37.0),
    "host set back": (unix, step(6.5, -37), step(6.5, -37), "front", 6.5, -37.0),
    "timesyncd, 0.5 s": (unix, step(12, 0.5), step(12, 0.5), "front", 12, 0.5),
    "ntpd, 0.2 s back": (unix, step(12, -0.2), step(12, -0.2), "front", 12, -0.2),
    "camera alone": (unix, step(20, 3.25), unix, "front", 20, 3.25),
    "LiDAR gets PTP": (step(9, 1_700_000_000 - 100, 100 * S), unix, unix, "lidar", 9, 1_699_999_900.0),
    "LiDAR gets GPS time": (step(9, -18, T0 + 18 * S), unix, unix, "lidar", 9, -18.0),
    "LiDAR's packets stamped by the host": (step(15, -2), unix, unix, "lidar", 15, -2.0),
}


@pytest.mark.parametrize("name", STEPS)
def test_a_clock_that_steps(name):
    lidar, camera, recorder, who, at_s, size_s = STEPS[name]
    times = recorded({"lidar": lidar, "front": camera}, recorder=recorder)
    reports = report_clocks(times)
    (gap,) = reports[who].steps
    assert abs(gap.duration_ns - size_s * S) < 0.03 * S
    (other,) = {"lidar", "front"} - {who}
    assert not reports[other].steps and reports["front"].offset is None
    moment = {"lidar": lidar, "front": camera}[who](int(at_s * S) - 1)
    assert 0 <= moment - gap.after_ns < 0.11 * S
    stamps = corrected(times, reports)
    for sensor, true in stamps.items():
        expected = T0 + np.arange(300) * S // 10 + (11_000_000 if sensor == "front" else 0)
        assert np.max(np.abs(true - expected)) < 0.03 * S
    assert any("steps by" in sentence for sentence in reports[who].step_sentences)


def test_lost_messages_beside_a_step():
    times = recorded(
        {"lidar": unix, "front": step(6.5, 37)},
        recorder=step(6.5, 37),
        lost=[("front", 6.2, 7.1), ("lidar", 6.45, 6.85)],
    )
    reports = report_clocks(times)
    assert abs(reports["front"].steps[0].duration_ns - 37 * S) < 0.03 * S and not reports["lidar"].steps


@pytest.mark.parametrize(
    "lost", [[("front", 5, 12)], [("lidar", 5, 12)], [("lidar", 5, 12), ("front", 5, 12)], [("front", 5, 5.3)]]
)
def test_pauses_are_no_steps(lost):
    reports = report_clocks(recorded({"lidar": unix, "front": unix}, lost=lost))
    assert not any(report.steps or report.step_sentences or report.added_ns.any() for report in reports.values())


def test_a_recorder_that_was_busy():
    """It hands on late what it has: for 0.8 s nothing, then all of it."""

    def stall(t):
        return T0 + (max(t, 10_800_000_000) if 10 * S <= t < 10.8 * S else t)

    reports = report_clocks(recorded({"lidar": unix, "front": unix}, recorder=stall, lost=[("front", 10.2, 10.6)]))
    assert not any(report.steps or report.step_sentences or report.added_ns.any() for report in reports.values())


def test_a_computer_that_learns_the_date():
    """All go by one clock, which begins in 1970: everything behind the step is right, and pairs stay pairs."""
    clock = step(8, 1_700_000_000 - 20, 20 * S)
    times = recorded({"lidar": clock, "front": clock}, recorder=clock)
    reports = report_clocks(times)
    for name, stamps in corrected(times, reports).items():
        expected = T0 + np.arange(300) * S // 10 + (11_000_000 if name == "front" else 0)
        assert np.max(np.abs(stamps - expected)) < 0.03 * S


def test_a_host_that_is_set_back_and_stamps_all():
    times = recorded({"lidar": step(8, -5), "front": step(8, -5)}, recorder=step(8, -5))
    stamps = corrected(times, report_clocks(times))
    apart = stamps["front"] - stamps["lidar"]
    assert np.max(np.abs(apart - 11_000_000)) < 0.03 * S and np.all(np.diff(stamps["lidar"]) > 0)


def test_two_steps_and_two_cameras():
    def twice(t):
        return T0 + t + (37 * S if 8 * S <= t < 20 * S else 0)

    times = recorded({"lidar": unix, "front": twice, "left": unix}, rates={"left": 25.0})
    reports = report_clocks(times)
    assert [round(gap.duration_ns / S) for gap in reports["front"].steps] == [37, -37]
    assert not reports["left"].added_ns.any() and not reports["lidar"].added_ns.any()
    assert np.ptp(corrected(times, reports)["front"] - times["lidar"].stamp) < 0.03 * S


def test_a_clock_that_drifts_has_a_spread():
    times = recorded({"lidar": lambda t: 50 * S + round(t * 1.0005), "front": unix}, seconds=120)
    offset = report_clocks(times)["front"].offset
    assert 0.01 * S < offset.spread_ns < 0.06 * S


def test_a_file_that_holds_one_sensor_after_the_other():
    times = recorded({"lidar": unix, "front": unix})
    count = len(times["lidar"].stamp)
    sorted_by_topic = {
        name: each._replace(number=np.arange(count) + k * count) for k, (name, each) in enumerate(times.items())
    }
    reports = report_clocks(sorted_by_topic)
    assert not any(report.steps or report.offset or report.added_ns.any() for report in reports.values())


def written(folder, lidar, camera, recorder=lambda t: T0 + t, *, mcap=False, seconds=6.0, empty=()):
    """A bag of two sensors whose stamps are by clocks of their own."""

    def messages():
        for k in range(int(seconds * 10)):
            t = k * S // 10
            yield "/points", CLOUD, recorder(t + 5_000_000), cloud(lidar(t), scene(columns=30), types=TYPES)
            image = compressed(camera(t + 20_000_000), b"" if k in empty else png(8, 6, k), TYPES)
            yield "/front/compressed", COMPRESSED, recorder(t + 26_000_000), image

    return write_mcap(folder / "walk.mcap", as_cdr(messages())) if mcap else write_ros2(folder / "walk", messages())


def stamps_of(path):
    with FrameFile(path) as file:
        return file.stamps_ns.copy()


def stamps_in(path, out):
    manifest = normalise(path, out, cameras=["front"])
    with SweepFile(out / "lidar.sweeps") as lidar:
        sweeps = [lidar.sweep(index).stamp_ns for index in range(len(lidar))]
        assert sweeps == lidar.stamps_ns.tolist()
    return manifest, np.array(sweeps), stamps_of(out / "camera-front.images")


@pytest.mark.parametrize("mcap", [False, True])
@pytest.mark.parametrize("log_zero", [False, True])
def test_a_simulated_clock_begins_at_0(tmp_path, mcap, log_zero):
    path = written(tmp_path, lambda t: t, lambda t: t - 20_000_000, (lambda t: t) if log_zero else unix, mcap=mcap)
    manifest, sweeps, frames = stamps_in(path, tmp_path / "out")
    assert sweeps.tolist() == frames.tolist() == [k * S // 10 for k in range(60)]
    assert not any("no stamp" in sentence or "back" in sentence for sentence in manifest.warnings)


def test_stamps_of_0_alone_are_none(tmp_path):
    _, sweeps, frames = stamps_in(written(tmp_path, lambda t: 0, unix), tmp_path / "out")
    assert np.all(sweeps - T0 == np.arange(60) * S // 10 + 5_000_000) and len(frames) == 60


def test_an_offset_reaches_the_manifest(tmp_path):
    path = written(tmp_path, lambda t: 4281 * S + t, unix)
    manifest, _, _ = stamps_in(path, tmp_path / "out")
    lidar, camera = manifest.sensors
    assert lidar.offset_ns is None and abs(camera.offset_ns - (1_700_000_000 - 4281) * S) <= 1_000_000
    assert camera.overlap_share > 0.95 and not any("share no time" in sentence for sentence in manifest.warnings)


@pytest.mark.parametrize("of_lidar", [False, True])
def test_a_step_is_taken_out_of_the_stamps(tmp_path, of_lidar):
    clocks = (step(3, -2), unix) if of_lidar else (unix, step(3, 37))
    path = written(tmp_path, *clocks, unix if of_lidar else step(3, 37))
    manifest, sweeps, frames = stamps_in(path, tmp_path / "out")
    assert np.all(sweeps == T0 + np.arange(60) * S // 10)
    assert np.all(frames == T0 + np.arange(60) * S // 10 + 20_000_000)
    lidar, camera = manifest.sensors
    ((gap,), others) = (lidar.jumps, camera.jumps) if of_lidar else (camera.jumps, lidar.jumps)
    assert gap.duration_ns == (-2 if of_lidar else 37) * S and not others
    assert lidar.missing == camera.missing == 0
    assert any("steps by" in sentence and "30 messages" in sentence for sentence in manifest.warnings)
    assert not any("missing" in sentence for sentence in manifest.warnings)


def test_messages_that_are_left_out_beside_a_step_are_no_gap(tmp_path):
    path = written(tmp_path, unix, step(3, 37), step(3, 37), empty=(27, 33, 34))
    manifest, _, frames = stamps_in(path, tmp_path / "out")
    assert frames.tolist() == [T0 + k * S // 10 + 20_000_000 for k in range(60) if k not in (27, 33, 34)]
    assert manifest.sensors[1].missing == 0 and not any("missing" in sentence for sentence in manifest.warnings)


@pytest.mark.parametrize("mcap", [False, True])
def test_packets_of_a_lidar_whose_camera_is_by_another_clock(tmp_path, mcap):
    """The last turn ends without a message of its own."""
    stream = list(packets(turns=12.3))
    rows = []
    for start in range(0, len(stream), 76):
        part = stream[start : start + 76]
        rows.append(("/velodyne_packets", SCAN, part[-1][0] + 2_000_000, scan(part[-1][0], part)))
    for k in range(12):
        at = stream[0][0] + k * S // 10
        rows.append(("/front/compressed", COMPRESSED, at, compressed(at + 37 * S, png(8, 6, k), TYPES)))
    rows.sort(key=lambda row: row[2])
    path = write_mcap(tmp_path / "walk.mcap", as_cdr(rows)) if mcap else write_ros2(tmp_path / "walk", rows)
    _, camera = normalise(path, tmp_path / "out", cameras=["front"]).sensors
    assert abs(camera.offset_ns - 37 * S) < 0.3 * S
