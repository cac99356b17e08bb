import hashlib
import json
import zipfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from making_ouster import (
    ARM_MM,
    COLUMN_NS,
    COLUMNS,
    HEIGHT_MM,
    IN_PACKET,
    PROFILES,
    START_NS,
    TURN_NS,
    altitudes,
    azimuths,
    metadata,
    packets,
)
from making_packets import datagram, write_pcap
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.capture import CaptureFile
from workers.readers.captures.datagrams import Datagrams
from workers.readers.captures.ouster.cutter import OusterSource, pixel_values
from workers.readers.captures.ouster.metadata import read_metadata
from workers.readers.choose import choose_sensors
from workers.readers.detect import open_recording
from workers.readers.recording import ReadError

DATA = Path(__file__).parents[5] / "shared" / "data" / "packets" / "ouster"
PORT = 7502


def zipped(path, stream, document=None):
    """A capture of packets, and the sensor's metadata beside it, in a zip."""
    span = IN_PACKET * COLUMN_NS
    capture = write_pcap(path / "a.pcap", [(at + span, datagram(data, port=PORT)) for at, data in stream], nano=True)
    with zipfile.ZipFile(path / "walk.zip", "w") as file:
        file.write(capture, "walk/a.pcap")
        if document is not None:
            file.writestr("walk/sensor.json", document)
    return path / "walk.zip"


def read(path, **options):
    with closing(open_recording(path, ReadOptions(**options))) as recording:
        return recording, [sweep for _, sweep in recording.messages(recording.sensors)]


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("nested", [False, True])
def test_every_profile_s_points_stand_where_the_beams_point(tmp_path, profile, nested):
    recording, sweeps = read(zipped(tmp_path, packets(profile), metadata(profile, nested=nested)))
    assert [len(sweep.xyz) for sweep in sweeps] == [32 * COLUMNS, 32 * COLUMNS, 16 * COLUMNS]
    assert recording.warnings == [] and recording.other_topics == []
    (sensor,) = recording.sensors
    assert sensor.notes["model"] == "OS-1-32" and float(sensor.notes["rate_hz"]) == pytest.approx(10.0, abs=0.01)
    facts = recording.lidar_facts(sensor)
    assert facts.ring_count == 32 and facts.sweep_ns == pytest.approx(TURN_NS, rel=1e-4)
    for turn, sweep in enumerate(sweeps):
        assert sweep.stamp_ns == pytest.approx(START_NS + turn * TURN_NS, abs=2_000)
        # The beam of row r and column c by hand, without the matrix: turned back to the lidar's frame.
        row, column = 31 - sweep.ring.astype(int), np.rint(sweep.offset_ns / COLUMN_NS).astype(int)
        np.testing.assert_array_equal(sweep.intensity, row)
        lidar = sweep.xyz.astype(float) * [-1, -1, 1] - [0, 0, HEIGHT_MM / 1000]
        encoder = -2 * np.pi * column / COLUMNS
        beam = lidar[:, :2] - ARM_MM / 1000 * np.stack([np.cos(encoder), np.sin(encoder)], 1)
        assert np.hypot(*beam.T) == pytest.approx(
            (8.0 - ARM_MM / 1000) * np.cos(np.radians(altitudes(32)[row])), abs=1e-5
        )
        ahead = np.arctan2(beam[:, 1], beam[:, 0]) - encoder + np.radians(azimuths(32)[row])
        np.testing.assert_allclose(np.mod(ahead + np.pi, 2 * np.pi) - np.pi, 0, atol=1e-5)
        assert lidar[:, 2] == pytest.approx((8.0 - ARM_MM / 1000) * np.sin(np.radians(altitudes(32)[row])), abs=1e-5)


def test_lost_late_and_doubled_packets_are_counted(tmp_path):
    stream = list(packets())
    turn = COLUMNS // IN_PACKET
    late = stream.pop(5)
    stream[turn + 3 : turn + 3] = [(stream[turn + 2][0] + 1000, late[1])]
    stream[8:8] = [stream[7]]
    recording, sweeps = read(zipped(tmp_path, stream, metadata()))
    assert [len(sweep.xyz) // 32 // IN_PACKET for sweep in sweeps] == [turn - 1, turn, turn // 2]
    said = " ".join(recording.warnings)
    assert "1 packets were lost" in said and "1 packets came twice" in said and "1 packets came after" in said


def test_times_of_the_stamp_alone(tmp_path):
    _, sweeps = read(zipped(tmp_path, packets(), metadata()), point_times="stamp_only")
    assert sweeps[0].time_source == "stamp_only" and not sweeps[0].offset_ns.any()


def refusal(path):
    with pytest.raises(ReadError) as caught:
        open_recording(path)
    return caught.value


def test_packets_without_metadata_are_refused_with_what_to_do(tmp_path):
    error = refusal(zipped(tmp_path, packets()))
    assert error.code == "lidar_packets_not_read" and "Ouster" in error.message
    assert ".json" in error.hint and "ouster-cli" in error.hint


@pytest.mark.parametrize(
    ("document", "word"),
    [
        (metadata(profile="RNG99"), "RNG99"),
        (metadata().replace(b'"columns_per_frame": 512', b'"columns_per_frame": 999999999'), "999999999"),
        (metadata().replace(b"20.0,", b"NaN,", 1), "numbers"),
        (metadata().replace(b"20.0,", b"", 1), "numbers"),
        (b'{"beam_altitude_angles": []}', "data_format"),
        (b'{"beam_altitude_angles": ' + b"[" * 5000, "Error"),
    ],
)
def test_metadata_that_cannot_be_used_are_said(tmp_path, document, word):
    error = refusal(zipped(tmp_path, packets(), document))
    assert error.code == "lidar_metadata_unusable" and word in error.message and "sensor.json" in error.message


def test_another_sensor_s_metadata_do_not_read_these_packets(tmp_path):
    document = metadata().replace(b"122150000150", b"122150000151")
    assert refusal(zipped(tmp_path, packets(), document)).code == "lidar_packets_not_read"


def bag(path, *, with_metadata=True):
    """A driver's bag: packets of the LiDAR and of its inertial unit, and its metadata once."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg("uint8[] buf\n", "ouster_sensor_msgs/msg/PacketMsg"))
    packet, text = types.types["ouster_sensor_msgs/msg/PacketMsg"], types.types["std_msgs/msg/String"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        lidar, imu = (
            writer.add_connection(f"/ouster/{name}_packets", packet.__msgtype__, typestore=types)
            for name in ("lidar", "imu")
        )
        if with_metadata:
            told = writer.add_connection("/ouster/metadata", text.__msgtype__, typestore=types)
            writer.write(told, START_NS, types.serialize_cdr(text(metadata().decode()), text.__msgtype__))
        for at, data in packets():
            for connection, payload in ((lidar, data), (imu, bytes(48))):
                message = packet(np.frombuffer(payload, np.uint8))
                raw = types.serialize_cdr(message, packet.__msgtype__)
                writer.write(connection, at + IN_PACKET * COLUMN_NS, raw)
    return path


def test_a_driver_s_bag_gives_the_capture_s_sweeps(tmp_path):
    recording, sweeps = read(bag(tmp_path / "bag"))
    assert [sensor.name for sensor in recording.sensors] == ["/ouster/lidar_packets"]
    _, captured = read(zipped(tmp_path, packets(), metadata()))
    assert len(sweeps) == len(captured) == 3
    for one, other in zip(sweeps, captured, strict=True):
        np.testing.assert_array_equal(one.xyz, other.xyz)
        assert one.stamp_ns == other.stamp_ns and recording.warnings == []


def test_a_bag_without_the_metadata_topic_is_refused_with_what_to_do(tmp_path):
    recording = open_recording(bag(tmp_path / "bag", with_metadata=False))
    with closing(recording), pytest.raises(ReadError) as caught:
        choose_sensors(recording, None, None)
    assert caught.value.code == "lidar_packets_not_read" and "metadata" in caught.value.hint


@pytest.mark.skipif(not DATA.exists(), reason="../shared/data is absent")
@pytest.mark.parametrize("name", ["OS-0-128-U1_v2.3.0_1024x10", "OS-2-32-U0_v2.0.0_1024x10"])
def test_the_publisher_s_digests(name):
    """Ranges, reflectivity, times and numbers of all columns of real captures, hashed as their publisher did."""
    sensor = read_metadata((DATA / f"{name}.json").read_bytes(), name)
    datagrams = Datagrams()
    taken = (datagrams.take(link, frame) for _, link, frame in CaptureFile(DATA / f"{name}.pcap").frames())
    payloads = [d[3] for d in taken if d is not None and OusterSource(sensor).takes(d[3])]
    columns = np.frombuffer(b"".join(payloads), sensor.packet)["columns"].reshape(-1)
    columns = columns[np.argsort(columns["number"])]
    range_mm, reflectivity = pixel_values(sensor, columns["pixels"])
    (scan,) = json.loads((DATA / f"{name}_digest.json").read_text())["scans"]
    values = {
        "RANGE": range_mm.T,
        "REFLECTIVITY": reflectivity.T,
        "TIMESTAMP": columns["t"],
        "MEASUREMENT_ID": columns["number"],
    }
    assert {key: hashlib.md5(np.ascontiguousarray(each).tobytes()).hexdigest() for key, each in values.items()} == {
        key: scan[key] for key in values
    }


def test_more_sensors_than_a_vehicle_has_are_refused_before_they_are_read(tmp_path):
    capture = zipped(tmp_path, packets(turns=0.2), metadata())
    with zipfile.ZipFile(capture, "a") as file:
        for number in range(16):
            file.writestr(f"walk/{number}.json", metadata())
    error = refusal(capture)
    assert error.code == "folder_refused" and "16 Ouster sensors" in error.message
