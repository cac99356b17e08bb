import struct

import numpy as np
import pytest
from making_packets import PORT, START_NS, captured, datagram, jittered, packets, write_pcap, write_pcapng

from apexcal.documents.readings import ReadOptions
from workers.readers.detect import open_recording
from workers.readers.recording import ReadError


def read(path, **options):
    recording = open_recording(path, ReadOptions(**options))
    return recording, [sweep for _, sweep in recording.messages(recording.sensors)]


def sent(*sensor, **how):
    """Frames of a sensor's packets, stamped when their first laser fired."""
    return [(moment, datagram(data)) for moment, data in packets(*sensor, **how)]


def azimuth(sweep):
    return np.degrees(np.arctan2(-sweep.xyz[:, 1], sweep.xyz[:, 0])) % 360


def same(sweeps, others):
    assert len(sweeps) == len(others)
    for one, other in zip(sweeps, others, strict=True):
        assert abs(one.stamp_ns - other.stamp_ns) < 3_000
        np.testing.assert_array_equal(one.xyz, other.xyz)
        np.testing.assert_allclose(one.offset_ns, other.offset_ns, atol=2_000)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return read(write_pcap(tmp_path_factory.mktemp("pcap") / "a.pcap", captured(packets()), nano=True))


def test_turns_are_cut_at_the_seam_and_no_point_is_doubled_or_lost(plain):
    recording, sweeps = plain
    total = len(list(packets())) * 24 * 16
    assert len(sweeps) == 4 and sum(len(s.xyz) for s in sweeps) == total and recording.warnings == []
    for number, sweep in enumerate(sweeps):
        # Each ring goes once round, without a step back. Azimuths come rounded to hundredths of a degree, so the
        # middle of the turn, far from the seam, is where the sweep is held against them.
        low = np.unwrap(np.radians(azimuth(sweep)[sweep.ring == 0].astype(np.float64)))
        assert np.all(np.diff(low) > 0) and low[-1] - low[0] < 2 * np.pi
        turn = (azimuth(sweep) - 118.88) % 360
        middle = (turn > 1) & (turn < 359)
        np.testing.assert_allclose(sweep.offset_ns[middle], turn[middle] / 360 * 1e8, atol=150_000)
        assert sweep.ring.min() == 0 and sweep.ring.max() == 15
        elevation = np.degrees(np.arcsin(sweep.xyz[:, 2] / np.linalg.norm(sweep.xyz, axis=1)))
        np.testing.assert_allclose(elevation, -15 + 2.0 * sweep.ring, atol=0.2)
        assert abs(sweep.stamp_ns - START_NS - number * 100_000_000) < 110_592 + 1_000
        assert sweep.time_source == "per_point" and sweep.offset_ns.min() >= -200


def test_what_is_said_of_the_sensor(plain):
    recording, _ = plain
    (sensor,) = recording.sensors
    assert (sensor.kind, sensor.name) == ("lidar", f"192.168.1.201:{PORT}")
    assert "ring" in sensor.notes["fields"] and sensor.notes["model"] == "VLP-16"
    facts = recording.lidar_facts(sensor)
    assert (facts.ring_count, facts.stamp_convention, facts.time_source) == (16, "start", "per_point")
    assert facts.sweep_ns == pytest.approx(1e8, rel=1e-3)
    assert any("118.88" in note for note in facts.notes) and any("host" in note for note in facts.notes)


@pytest.mark.parametrize(
    ("sensor", "mode"),
    [("hdl64e", 0x37), *((sensor, mode) for sensor in ("vlp32c", "hdl32e", "alpha_prime") for mode in (0x37, 0x39))],
)
def test_every_sensor(tmp_path, sensor, mode):
    frames = sent(sensor, 1.5, mode=mode)
    recording, sweeps = read(write_pcap(tmp_path / "a.pcap", frames))
    rings = {"vlp32c": 32, "hdl32e": 32, "hdl64e": 64, "alpha_prime": 128}[sensor]
    assert recording.lidar_facts(recording.sensors[0]).ring_count == rings
    used = 8 / 12 if (sensor, mode) == ("alpha_prime", 0x39) else 1
    kept = used * 12 * 32 / (2 if mode == 0x39 else 1)
    assert len(sweeps) == 2 and sum(len(s.xyz) for s in sweeps) == pytest.approx(len(frames) * kept, rel=0.02)
    sweep = sweeps[0]
    ring_turn = (azimuth(sweep)[sweep.ring == 1] - azimuth(sweep)[sweep.ring == 1][0]) % 360
    assert (np.diff(ring_turn) > 0).all() and ring_turn.max() < 360
    elevation = np.degrees(np.arctan2(sweep.xyz[:, 2], np.hypot(sweep.xyz[:, 0], sweep.xyz[:, 1])))
    medians = [np.median(elevation[sweep.ring == ring]) for ring in range(rings)]
    assert np.all(np.diff(medians) > -0.35) and medians[-1] > medians[0] + 20
    if mode == 0x39:
        assert np.linalg.norm(sweep.xyz, axis=1).std() < 0.5  # the last returns, 1 to 2 m behind, are gone
        assert any("dual return" in note for note in recording.lidar_facts(recording.sensors[0]).notes)


@pytest.mark.parametrize("sensor", ["vlp16", "vlp32c", "hdl32e", "alpha_prime"])
def test_azimuths_go_on_evenly_where_a_sweep_begins(tmp_path, sensor):
    _, sweeps = read(write_pcap(tmp_path / "a.pcap", sent(sensor, 2.2, mode=0x38)))
    before, after = sweeps[:2]
    for ring in range(0, int(after.ring.max()) + 1, 5):
        last, first = (azimuth(sweep)[sweep.ring == ring] for sweep in (before, after))
        steps = np.diff(np.concatenate([last[-9:], first[:9]])) % 360
        # The sensor states hundredths of a degree, cut off.
        np.testing.assert_allclose(steps, np.median(steps), atol=0.03)


@pytest.mark.parametrize("mode", [0x39, 0x38])
def test_one_damaged_packet_does_not_tell_what_a_sweep_returns(tmp_path, mode):
    frames = sent("hdl32e", 2.2, mode=mode)
    _, whole = read(write_pcap(tmp_path / "a.pcap", frames))
    moment, frame = frames[0]
    frames[0] = moment, frame[:-2] + bytes((0x37 if mode == 0x39 else 0x39, frame[-1]))
    _, sweeps = read(write_pcap(tmp_path / "b.pcap", frames))
    assert len(sweeps) == len(whole)
    assert abs(len(sweeps[0].xyz) - len(whole[0].xyz)) <= 384


def status_bytes(elevations):
    """What an HDL-64E S2 sends of itself, a byte a packet: the clock and so on, then its calibration."""
    rows = b"".join(
        struct.pack("<BhhhhhhhhhBB", laser, round(100 * up), *(0,) * 8, 0, 255) + bytes(7)
        for laser, up in enumerate(elevations)
    )
    table = b"UNIT#" + bytes(2) + rows[:-7] + bytes((16, 11, 15, 12, 47, 47)) + bytes(20) + struct.pack("<H", 1820)
    assert len(table) == 1820
    return [(ord(kind), 1) for kind in "HMSDNYGTV"] + [(ord("x"), byte) for byte in table]


def test_an_hdl_64e_is_decoded_with_its_own_calibration(tmp_path):
    elevations = np.linspace(-25, 3, 64)
    status = status_bytes(elevations)
    frames = [
        (moment, datagram(data[:-2] + bytes(status[number % len(status)])))
        for number, (moment, data) in enumerate(packets("hdl64e", len(status) / 280, distance=5000))
    ]
    assert len(frames) > len(status)
    recording, sweeps = read(write_pcap(tmp_path / "a.pcap", frames))
    facts = recording.lidar_facts(recording.sensors[0])
    assert facts.ring_count == 64 and any("HDL-64E S2" in note and "its own" in note for note in facts.notes)
    xyz, ring = sweeps[1].xyz, sweeps[1].ring
    found = np.degrees(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    np.testing.assert_allclose([np.median(found[ring == r]) for r in range(64)], elevations, atol=0.02)
    recording, _ = read(write_pcap(tmp_path / "b.pcap", frames[:900]))
    assert any("was not found" in note for note in recording.lidar_facts(recording.sensors[0]).notes)


def fragments(path):
    frames = []
    for number, (stamp, frame) in enumerate(captured(packets())):
        udp = frame[34:]
        pieces = [(0x2000, udp[:800]), (100, udp[800:])]
        for piece, data in pieces if number % 2 else reversed(pieces):
            frames.append((stamp, datagram(data, identity=number, piece=piece)))
    return write_pcap(path, frames)


@pytest.mark.parametrize(
    "write",
    [
        *(
            lambda path, how=how: write_pcapng(path, captured(packets()), order=how[0], exponent=how[1])
            for how in (("<", 6), ("<", 9), (">", 6), (">", 9))
        ),
        lambda path: write_pcap(path, captured(packets()), order=">"),
        *(
            lambda path, link=link: write_pcap(path, captured(packets(), link=link), link=link)
            for link in ("cooked", "raw")
        ),
        *(lambda path, tags=tags: write_pcap(path, captured(packets(), tags=tags)) for tags in (1, 2)),
        fragments,
    ],
)
def test_pcapng_and_any_layers_around_the_packets_hold_the_same(tmp_path, plain, write):
    same(read(write(tmp_path / "a"))[1], plain[1])


def test_other_traffic_is_passed_over(tmp_path, plain):
    frames = []
    for number, entry in enumerate(captured(packets())):
        frames.append(entry)
        frames.append((entry[0], datagram(bytes(512), port=8308)))  # the sensor's position packets
        frames.append((entry[0], b"\xff" * 12 + b"\x08\x06" + bytes(28)))  # ARP
        if number % 7 == 0:
            frames.append((entry[0], datagram(bytes(1206), port=5000)))
    recording, sweeps = read(write_pcap(tmp_path / "a.pcap", frames))
    same(sweeps, plain[1])
    assert recording.other_topics == ["UDP 192.168.1.201:5000 (1206 bytes)", "UDP 192.168.1.201:8308 (512 bytes)"]


def test_two_sensors_told_apart_by_address_and_port(tmp_path):
    frames = sent() + [(t, datagram(d, sender=bytes((10, 0, 0, 7)))) for t, d in packets("vlp32c", 2)]
    frames += [(t, datagram(d, port=2369)) for t, d in packets(turns=2, first=0)]
    recording, _ = read(write_pcap(tmp_path / "a.pcap", sorted(frames)))
    models = {s.name: s.notes["model"] for s in recording.sensors}
    names = ("192.168.1.201:2368", "192.168.1.201:2369", "10.0.0.7:2368")
    assert models == dict(zip(names, ("VLP-16", "VLP-16", "VLP-32C"), strict=True))
    second = next(s for s in recording.sensors if s.name.startswith("10."))
    assert {sweep.ring.max() for sweep in recording.sweeps(second)} == {31}


def test_the_sensors_clock_evens_a_busy_host(tmp_path, plain):
    path = write_pcap(tmp_path / "a.pcap", jittered(captured(packets(clock_us=3_599_900_000))))
    _, sweeps = read(path)
    spread = [one.stamp_ns - other.stamp_ns for one, other in zip(sweeps, plain[1], strict=True)]
    assert max(spread) - min(spread) < 40_000 and abs(np.mean(spread)) < 60_000  # frames came up to 3 ms late
    for one, other in zip(sweeps, plain[1], strict=True):
        np.testing.assert_allclose(one.offset_ns, other.offset_ns, atol=20_000)


def test_a_sensor_without_a_clock(tmp_path, plain):
    frozen = ((moment, data[:1200] + bytes(4) + data[1204:]) for moment, data in packets())
    path = write_pcap(tmp_path / "a.pcap", captured(frozen), nano=True)
    recording, sweeps = read(path)
    same(sweeps, plain[1])
    stamps_only, sweeps = read(path, point_times="stamp_only")
    assert not any(sweep.offset_ns.any() for sweep in sweeps)
    assert stamps_only.lidar_facts(stamps_only.sensors[0]).time_source == "stamp_only"
    assert any("moments at which they were captured" in n for n in recording.lidar_facts(recording.sensors[0]).notes)


def test_a_capture_that_ends_inside_a_packet(tmp_path, plain):
    path = write_pcap(tmp_path / "a.pcap", captured(packets()), nano=True)
    path.write_bytes(path.read_bytes()[:-700])
    recording, sweeps = read(path)
    same(sweeps[:3], plain[1][:3])
    assert "ends inside a packet" in recording.warnings[0]
    assert len(sweeps[3].xyz) == len(plain[1][3].xyz) - 24 * 16


def test_lost_doubled_and_disordered_packets(tmp_path, plain):
    frames = list(captured(packets()))
    broken = [*frames[:10], frames[9], *frames[15:30], frames[31], frames[30], *frames[32:]]
    recording, sweeps = read(write_pcap(tmp_path / "a.pcap", broken, nano=True))
    said = " ".join(recording.warnings)
    assert "6 packets were lost" in said and "1 packets came twice" in said  # the late one leaves a gap too
    assert "1 packets came after later ones" in said
    assert len(sweeps[0].xyz) == len(plain[1][0].xyz) - 6 * 24 * 16
    same(sweeps[1:], plain[1][1:])


def test_a_sensor_that_sends_part_of_the_turn_is_cut_in_the_gap(tmp_path):
    stream = packets(turns=4, first=200, mute=(300, 360))
    recording, sweeps = read(write_pcap(tmp_path / "a.pcap", captured(stream)))
    assert any("does not send" in note for note in recording.lidar_facts(recording.sensors[0]).notes)
    assert len(sweeps) == 5 and len({len(s.xyz) for s in sweeps[1:4]}) <= 3
    for sweep in sweeps[1:4]:
        assert azimuth(sweep)[0] < 6 and azimuth(sweep)[-1] > 294


def test_a_long_recording_is_cut_behind_the_sensor(tmp_path):
    recording, sweeps = read(write_pcap(tmp_path / "a.pcap", captured(packets(turns=22.5, distance=100))))
    assert any("behind the sensor" in note for note in recording.lidar_facts(recording.sensors[0]).notes)
    assert len(sweeps) == 24 and len(sweeps[0].xyz) < 0.2 * len(sweeps[1].xyz)  # from 118.88 to 180 degrees
    for sweep in sweeps[1:23]:
        assert 179.5 < azimuth(sweep)[0] < 180.5 and abs(len(sweep.xyz) - 28_935) < 40


def test_the_model_can_be_stated_but_not_against_the_packets(tmp_path, plain):
    blank = ((moment, data[:1204] + bytes(2)) for moment, data in packets("hdl32e", 1.2))
    path = write_pcap(tmp_path / "a.pcap", captured(blank))
    with pytest.raises(ReadError) as caught:
        read(path)
    assert caught.value.code == "lidar_model_unknown" and "hdl32e" in caught.value.hint
    recording, sweeps = read(path, lidar_model="hdl32e")
    assert sweeps[0].ring.max() == 31
    assert "; an HDL-32E was stated." in " ".join(recording.lidar_facts(recording.sensors[0]).notes)
    with pytest.raises(ReadError) as caught:
        read(plain[0]._path, lidar_model="alpha_prime")
    assert caught.value.code == "lidar_model_contradicted" and "VLP-16" in caught.value.message
