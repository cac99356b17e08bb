"""Messages that cannot be used are left out, counted and said; the others are read. `inspect` says the same."""

import cv2
import numpy as np
import pytest
from altered_recordings import answers
from formats import folder_of, pcd
from making_recordings import (
    CLOUD,
    COMPRESSED,
    IMAGE,
    PERIOD_NS,
    PLAIN,
    START_NS,
    cloud,
    compressed,
    interleaved,
    png,
    raw_image,
    scene,
    write_bag,
)
from making_ros2 import INFO, TYPES, rig, write_ros2
from pypcd4 import Encoding

from workers.readers.inspection import inspect_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.omissions import Omissions
from workers.readers.recording import MessageError, ReadError

COUNT = 7
PICTURE = cv2.resize(np.random.default_rng(1).integers(0, 255, (6, 8, 3), np.uint8), (64, 48))


def encoded(suffix, *flags):
    return cv2.imencode(suffix, PICTURE, [part for flag in flags for part in (flag, 1)])[1].tobytes()


def half(suffix, *flags):
    return encoded(suffix, *flags)[: len(encoded(suffix, *flags)) // 2]


def of(columns, share=1.0):
    return {name: values[: int(share * len(values))] for name, values in columns.items()}


# What the message of one place holds instead: of a cloud its columns, of a frame its bytes; the code.
CLOUDS = {
    "no points": (of(scene(), 0.0), "cloud_empty"),
    "no return": (scene() | {"x": np.full(1440, np.nan)}, "cloud_empty"),
    "zeros": (scene() | dict.fromkeys("xyz", np.zeros(1440)), "cloud_empty"),
    "another byte order": (None, "cloud_malformed"),
    "another sensor's fields": ({name: scene()[name] for name in ("x", "y", "z")}, "cloud_fields_differ"),
}
FRAMES = {
    "no bytes": (b"", "image_empty"),
    "no image": (b"no image at all", "image_unsupported"),
    "half a JPEG": (half(".jpg"), "image_damaged"),
    "a JPEG of zeros from the middle on": (half(".jpg") + bytes(1000), "image_damaged"),
    "a JPEG with zeros in the middle": (
        half(".jpg") + bytes(600) + encoded(".jpg")[len(half(".jpg")) :],
        "image_damaged",
    ),
    "a JPEG with another's bytes in the middle": (
        half(".jpg") + b"\xff\xc8 and so on" + encoded(".jpg")[-400:],
        "image_damaged",
    ),
    "half a PNG": (half(".png"), "image_damaged"),
    "a PNG with a changed byte": (
        half(".png")[:-1] + b"\x55" + encoded(".png")[len(half(".png")) :],
        "image_damaged",
    ),
    "half a WebP": (half(".webp"), "image_damaged"),
    "half a progressive JPEG": (half(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE), "image_damaged"),
    "a frame of another size": (png(32, 24), "image_size_differs"),
    "half a BMP": (half(".bmp"), "image_damaged"),
}


def bag(path, place, columns=None, data=None, stamps=None, swapped=False):
    """Seven clouds and frames, of which the one at ``place`` holds something else."""
    messages = []
    for i in range(COUNT):
        at = START_NS + i * PERIOD_NS
        is_odd = i == place
        own = at if stamps is None or not is_odd else stamps
        fields = columns if columns is not None and is_odd else scene()
        forms = {name: form for name, form in PLAIN.items() if name in fields}
        message = cloud(own, fields or scene(), forms or PLAIN)
        message.is_bigendian = is_odd and swapped
        messages.append(("/points", CLOUD, at, message))
        picture = data if data is not None and is_odd else png(64, 48)
        messages.append(("/cam/compressed", COMPRESSED, at + 1, compressed(at + 1, picture)))
    return write_bag(path, messages)


def agreed(path, out, topic, code, total=COUNT):
    """The manifest; ingestion and `inspect` left the same message out."""
    manifest = normalise(path, out)
    (omission,) = manifest.omissions
    assert (omission.topic, omission.code, omission.count, omission.total) == (topic, code, 1, total)
    assert omission.sentence.startswith(f"{topic}: 1 of {total} ") and omission.sentence.endswith(": left out.")
    inspection = inspect_recording(path)
    assert [(each.topic, each.code, each.count) for each in inspection.omissions] == [(topic, code, 1)]
    assert [each.count for each in manifest.sensors] == [
        COUNT - (sensor.topic == topic) for sensor in manifest.sensors
    ]
    assert manifest.warnings == []  # a message that was left out is no gap
    return manifest


@pytest.mark.parametrize("place", [0, COUNT // 2, COUNT - 1])
@pytest.mark.parametrize("name", CLOUDS)
def test_a_cloud_that_cannot_be_used(tmp_path, name, place):
    columns, code = CLOUDS[name]
    path = bag(tmp_path / "a.bag", place, columns=columns, swapped=columns is None)
    agreed(path, tmp_path / "out", "/points", code)


@pytest.mark.parametrize("place", [0, COUNT // 2, COUNT - 1])
@pytest.mark.parametrize("name", FRAMES)
def test_a_frame_that_cannot_be_used_is_none_of_the_camera_s(tmp_path, name, place):
    data, code = FRAMES[name]
    manifest = agreed(bag(tmp_path / "a.bag", place, data=data), tmp_path / "out", "/cam/compressed", code)
    assert manifest.sensors[1].width == 64


@pytest.mark.parametrize("data", [encoded(".jpg") + bytes(3000), encoded(".jpg")[:-2], png(64, 48) + b"more"])
def test_a_frame_that_is_whole_stays(tmp_path, data):
    """usb_cam pads MJPEG with zeros; some cameras leave out the marker at the end."""
    assert normalise(bag(tmp_path / "a.bag", 3, data=data), tmp_path / "out").omissions == []


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"width": 0, "height": 0, "step": 0, "data": b""}, "image_empty"),
        ({"data": b""}, "image_empty"),
        ({"data": bytes(9000)}, "image_damaged"),
        ({"encoding": "none"}, "image_encoding_unsupported"),
    ],
)
@pytest.mark.parametrize("place", [0, COUNT - 1])
def test_a_raw_image_that_cannot_be_used(tmp_path, change, code, place):
    messages = [
        ("/points", CLOUD, START_NS + i * PERIOD_NS, cloud(START_NS + i * PERIOD_NS, scene())) for i in range(COUNT)
    ]
    for i in range(COUNT):
        image = raw_image(START_NS + i * PERIOD_NS, PICTURE, "bgr8")
        for name, value in change.items() if i == place else ():
            setattr(image, name, np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value)
        messages.append(("/cam/image_raw", IMAGE, START_NS + i * PERIOD_NS, image))
    agreed(write_bag(tmp_path / "a.bag", interleaved(messages)), tmp_path / "out", "/cam/image_raw", code)


def test_a_camera_that_cannot_serve_leaves_the_others(tmp_path):
    """Depth as floating point numbers beside colours, in topics that no rig names."""
    messages = list(rig(COUNT))
    for name, kind, at, message in list(messages):
        if kind == COMPRESSED:
            message.data = np.frombuffer(png(64, 48), np.uint8)
            depth = raw_image(at, np.zeros((48, 64, 4), np.uint8), "32FC1", types=TYPES)
            messages.append((name.replace("front/image_raw/compressed", "rear/image_raw"), IMAGE, at, depth))
    path = write_ros2(tmp_path / "bag", messages)
    manifest = normalise(path, tmp_path / "out")
    assert [sensor.name for sensor in manifest.sensors] == ["lidar", "front"]
    (omission,) = manifest.omissions
    assert (omission.topic, omission.count, omission.total) == ("/rear/image_raw", COUNT, COUNT)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        *("camera-front.images", "lidar.sweeps"),
    ]
    inspection = inspect_recording(path)
    assert [fault.sensor for fault in inspection.faults if fault.code == "image_encoding_unsupported"] == ["rear"]
    assert "rear" not in inspection.calibratable
    with pytest.raises(ReadError, match="32FC1"):
        normalise(path, tmp_path / "out", cameras=["front", "rear"])


@pytest.mark.parametrize("zeros", [{0}, set(range(4))])
def test_the_first_good_camera_info_counts(tmp_path, zeros):
    messages = list(rig(COUNT))
    for number, (_, kind, _, message) in enumerate(messages):
        if kind == COMPRESSED:
            message.data = np.frombuffer(png(64, 48), np.uint8)
        if kind == INFO and number // 3 in zeros:
            message.k = np.zeros(9)
    manifest = normalise(write_ros2(tmp_path / "bag", messages), tmp_path / "out")
    assert manifest.sensors[1].camera_info.K[0] == 1176.9
    (omission,) = manifest.omissions
    assert (omission.topic, omission.count, omission.total) == ("/front/camera_info", len(zeros), COUNT)
    assert inspect_recording(tmp_path / "bag").omissions == manifest.omissions


@pytest.mark.parametrize(("start_s", "left_out"), [(0, 0), (20, 1)])
def test_a_stamp_of_0_is_a_simulated_clock_s_beginning_and_nothing_else(tmp_path, start_s, left_out):
    messages = []
    for i in range(COUNT):
        at, own = START_NS + i * PERIOD_NS, start_s * 10**9 + i * PERIOD_NS
        own = 0 if start_s and i == 3 else own
        messages += [
            ("/points", CLOUD, at, cloud(own, scene())),
            ("/cam", COMPRESSED, at, compressed(own, png(64, 48))),
        ]
    manifest = normalise(write_bag(tmp_path / "a.bag", messages), tmp_path / "out")
    assert [each.count for each in manifest.omissions] == [left_out] * (2 if left_out else 0)
    assert [sensor.first_ns for sensor in manifest.sensors] == [start_s * 10**9] * 2


@pytest.mark.parametrize("seed", [2, 5, *range(40, 46)])
def test_inspect_and_ingestion_agree_on_what_was_altered_at_random(tmp_path, seed):
    """Seeds 0 to 299 do; the others take long."""
    answer = answers(seed, tmp_path)
    assert answer.taken or not answer.is_promised, answer


@pytest.mark.parametrize(("stamp", "code"), [(0, "stamp_missing"), (-(10**9), "stamp_out_of_range")])
def test_stamps_that_others_do_not_have(tmp_path, stamp, code):
    agreed(bag(tmp_path / "a.bag", 0, stamps=stamp), tmp_path / "out", "/points", code)


def test_files_that_cannot_be_used(tmp_path):
    files = {f"clouds/{i}.pcd": pcd(Encoding.BINARY) for i in range(COUNT)}
    files |= {f"images/{i}.png": encoded(".png") for i in range(COUNT)}
    files["clouds/3.pcd"], files["clouds/2.pcd"] = files["clouds/3.pcd"][:4000], b""
    files["images/0.png"], files["images/4.png"] = half(".png"), b""
    folder_of(tmp_path / "walk", files)
    manifest = normalise(tmp_path / "walk", tmp_path / "out")
    assert {(each.topic, each.code, each.count, each.total) for each in manifest.omissions} == {
        *(("clouds", code, 1, COUNT) for code in ("cloud_truncated", "cloud_empty")),
        *(("images", code, 1, COUNT) for code in ("image_damaged", "image_empty")),
    }
    assert inspect_recording(tmp_path / "walk").omissions == manifest.omissions


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_what_is_left_decides(tmp_path, share):
    messages = []
    for i in range(6):
        at, is_odd = START_NS + i * PERIOD_NS, i >= 6 * share
        messages.append(("/points", CLOUD, at, cloud(at, of(scene(), 0.0 if is_odd else 1.0))))
        messages.append(("/cam/compressed", COMPRESSED, at + 1, compressed(at + 1, png(64, 48))))
    path = write_bag(tmp_path / "a.bag", messages)
    if share:
        assert normalise(path, tmp_path / "out").omissions[0].count == 3
        return
    for look in (lambda: normalise(path, tmp_path / "out"), lambda: inspect_recording(path)):
        with pytest.raises(ReadError) as caught:
            look()
        assert caught.value.code == "cloud_empty" and "/points" in caught.value.message


def test_what_two_found_is_added():
    """A reader and the writer leave out messages of one topic for one reason; what a reader counts stays its own."""
    error = MessageError("cloud_empty", "Empty.", "Look.")
    reader, writer, every = Omissions(), Omissions(), Omissions()
    for stamp_ns in (1, 2):
        reader.add("/points", error, stamp_ns)
    writer.add("/points", error, 3)
    every.update(reader)
    every.update(writer)
    assert every.count("/points", "cloud_empty") == 3 and every.stamps("/points").tolist() == [1, 2, 3]
    assert reader.count("/points", "cloud_empty") == 2 and reader.stamps("/points").tolist() == [1, 2]


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_the_first_filled_camera_info_counts(tmp_path, storage):
    messages = list(rig(COUNT))
    infos = [message for _, kind, _, message in messages if kind == INFO]
    infos[0].k, infos[-1].width = np.eye(3).ravel(), 17  # the identity, before a driver has its calibration
    camera = normalise(write_ros2(tmp_path / "bag", messages, storage), tmp_path / "out").sensors[1]
    assert (camera.camera_info.width, camera.camera_info.K[0]) == (1920, 1176.9)


def test_a_refusal_counts_each_message_once(tmp_path):
    """A few messages are looked at, and more if none of them can be used."""
    messages = [m for m in rig(COUNT) if m[1] != COMPRESSED]
    messages += [
        ("/cam/compressed", COMPRESSED, START_NS + i, compressed(START_NS + i, b"x", TYPES)) for i in range(12)
    ]
    path = write_ros2(tmp_path / "bag", messages)
    with pytest.raises(ReadError) as caught:
        inspect_recording(path)
    assert caught.value.message.startswith("None of the 12 messages of /cam/compressed can be used. ")


def test_inspect_notes_what_ingestion_notes_of_the_lidar(tmp_path):
    columns = {name: values for name, values in scene().items() if name != "ring"} | {"diode": scene()["ring"]}
    messages = [("/cam/compressed", COMPRESSED, START_NS, compressed(START_NS, png(64, 48), TYPES))]
    for i in range(COUNT):
        at = START_NS + i * PERIOD_NS
        message = cloud(at, columns, dict.fromkeys(columns, "f4"), types=TYPES)
        messages.append(("/points", CLOUD, at, message))
    path = write_ros2(tmp_path / "bag", messages)
    notes = inspect_recording(path).notes
    assert notes == normalise(path, tmp_path / "out").sensors[0].notes
    assert any("not used: diode" in note for note in notes)
