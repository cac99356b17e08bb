"""Messages that cannot be used are left out, counted and said; the others are read. `inspect` says the same."""

import cv2
import numpy as np
import pytest
from formats import folder_of, pcd
from making_recordings import (
    CLOUD,
    COMPRESSED,
    PERIOD_NS,
    PLAIN,
    START_NS,
    cloud,
    compressed,
    png,
    scene,
    write_bag,
)
from pypcd4 import Encoding

from workers.readers.inspection import inspect_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.recording import ReadError

COUNT = 7
PICTURE = cv2.resize(np.random.default_rng(1).integers(0, 255, (6, 8, 3), np.uint8), (64, 48))


def encoded(suffix):
    return cv2.imencode(suffix, PICTURE)[1].tobytes()


def half(suffix):
    return encoded(suffix)[: len(encoded(suffix)) // 2]


def of(columns, share=1.0):
    return {name: values[: int(share * len(values))] for name, values in columns.items()}


# What the message of one place holds instead: of a cloud its columns, of a frame its bytes; the code.
CLOUDS = {
    "no points": (of(scene(), 0.0), "cloud_empty"),
    "no return": (scene() | {"x": np.full(1440, np.nan)}, "cloud_empty"),
    "zeros": (scene() | dict.fromkeys("xyz", np.zeros(1440)), "cloud_empty"),
    "another sensor's fields": ({name: scene()[name] for name in ("x", "y", "z")}, "cloud_fields_differ"),
}
FRAMES = {
    "no bytes": (b"", "image_empty"),
    "no image": (b"no image at all", "image_unsupported"),
    "half a JPEG": (half(".jpg"), "image_damaged"),
    "a JPEG of zeros from the middle on": (half(".jpg") + bytes(1000), "image_damaged"),
    "half a PNG": (half(".png"), "image_damaged"),
    "a PNG with a changed byte": (
        half(".png")[:-1] + b"\x55" + encoded(".png")[len(half(".png")) :],
        "image_damaged",
    ),
    "half a WebP": (half(".webp"), "image_damaged"),
    "half a BMP": (half(".bmp"), "image_damaged"),
}


def bag(path, place, columns=None, data=None, stamps=None):
    """Seven clouds and frames, of which the one at ``place`` holds something else."""
    messages = []
    for i in range(COUNT):
        at = START_NS + i * PERIOD_NS
        is_odd = i == place
        own = at if stamps is None or not is_odd else stamps
        fields = columns if columns is not None and is_odd else scene()
        forms = {name: form for name, form in PLAIN.items() if name in fields}
        messages.append(("/points", CLOUD, at, cloud(own, fields, forms)))
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
    agreed(bag(tmp_path / "a.bag", place, columns=columns), tmp_path / "out", "/points", code)


@pytest.mark.parametrize("place", [0, COUNT // 2, COUNT - 1])
@pytest.mark.parametrize("name", FRAMES)
def test_a_frame_that_cannot_be_used_is_none_of_the_camera_s(tmp_path, name, place):
    data, code = FRAMES[name]
    manifest = agreed(bag(tmp_path / "a.bag", place, data=data), tmp_path / "out", "/cam/compressed", code)
    assert manifest.sensors[1].width == 64


@pytest.mark.parametrize(("stamp", "code"), [(0, "stamp_missing"), (-(10**9), "stamp_out_of_range")])
def test_stamps_that_others_do_not_have(tmp_path, stamp, code):
    agreed(bag(tmp_path / "a.bag", 0, stamps=stamp), tmp_path / "out", "/points", code)


def test_files_that_cannot_be_used(tmp_path):
    files = {f"clouds/{i}.pcd": pcd(Encoding.BINARY) for i in range(COUNT)}
    files |= {f"images/{i}.png": encoded(".png") for i in range(COUNT)}
    files["clouds/3.pcd"] = files["clouds/3.pcd"][:4000]
    files["images/0.png"] = half(".png")
    folder_of(tmp_path / "walk", files)
    manifest = normalise(tmp_path / "walk", tmp_path / "out")
    assert {(each.topic, each.code, each.count, each.total) for each in manifest.omissions} == {
        ("clouds", "cloud_truncated", 1, COUNT),
        ("images", "image_damaged", 1, COUNT),
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
