"""Recordings of which one field was altered at random, in one message, in some or in all, each by its seed.

``python tests/workers/readers/altered_recordings.py FIRST LAST`` says of each what `inspect` and ingestion answer.
"""

from __future__ import annotations

import random
import sys
import tempfile
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[3])]

from making_recordings import CLOUD, COMPRESSED, IMAGE, PERIOD_NS, START_NS, cloud, compressed, raw_image, scene
from making_ros2 import INFO, TYPES, info, write_ros2

from apexcal.documents.errors import InputError
from workers.readers.inspection import inspect_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.recording import ReadError

COUNT = 10
_PIXELS = cv2.resize(np.random.default_rng(3).integers(0, 255, (6, 8, 3), np.uint8), (64, 48))
_K = [60.0, 0, 32, 0, 60, 24, 0, 0, 1]
_NUMBERS = (0, 1, 2, 3, 4, 5, 7, 8, 16, 255, 65_535, 2**31 - 1)
_TEXTS = ("", "x", "rgb8", "png", "jpeg", "bgr8; jpeg compressed bgr8", "h264", "ring", "plumb_bob", "\n")
_FACTORS = (0.0, -1.0, 1e-3, 0.1, 100.0, 1000.0, 1e9, np.nan, np.inf)


class Answers(NamedTuple):
    """What was altered; whether `inspect` promised a calibration; messages that ingestion took, or why it refused."""

    change: str
    is_promised: bool
    taken: int
    refusal: str


def altered(rng):
    """The messages of a recording, and what was altered."""
    kind = rng.choice([COMPRESSED, IMAGE])
    topic = "/front/image_raw" + ("/compressed" if kind == COMPRESSED else "")
    messages = []
    for i in range(COUNT):
        at = START_NS + i * PERIOD_NS
        frame = compressed(at, cv2.imencode(".jpg", _PIXELS)[1].tobytes(), TYPES)
        frame = frame if kind == COMPRESSED else raw_image(at, _PIXELS, "bgr8", types=TYPES)
        lens = info(at, k=_K)
        lens.width, lens.height = 64, 48
        messages += [("/points", CLOUD, at, cloud(at, scene(), types=TYPES)), (topic, kind, at, frame)]
        messages.append(("/front/camera_info", INFO, at, lens))
    target = rng.choice(["/points", "/points", topic, topic, "/front/camera_info"])
    of_target = [message for name, _, _, message in messages if name == target]
    choices = {
        "first": of_target[:1],
        "middle": [of_target[len(of_target) // 2]],
        "last": of_target[-1:],
        "another": [of_target[3]],
        "half": of_target[::2],
        "all": of_target,
    }
    where = rng.choice(list(choices))
    seed = rng.random()
    whats = {_alter(message, random.Random(seed)) for message in choices[where]}
    return messages, f"{target}, {where}: {', '.join(sorted(whats))}"


def _alter(message, rng):
    """Alter one field, however deep."""
    if hasattr(message, "fields") and rng.random() < 0.3:
        return f"points, {_alter_points(message, rng)}"
    name = rng.choice([field.name for field in fields(message) if not field.name.startswith("__")])
    value = getattr(message, name)
    if isinstance(value, list):
        return f"{name}[], {_alter(rng.choice(value), rng)}"
    if hasattr(value, "__dataclass_fields__"):
        return f"{name}.{_alter(value, rng)}"
    if isinstance(value, bool):
        new = not value
    elif isinstance(value, int):
        largest = 255 if name in ("datatype", "is_bigendian") else 2**31 - 1
        new = min(rng.choice([*_NUMBERS, value + 1, max(0, value - 1), 2 * value]), largest)
    elif isinstance(value, str):
        new = rng.choice([*_TEXTS, value.upper(), value + "_2"])
    elif value.dtype == np.uint8:
        new = _bytes(value, rng)
    else:
        new = (value * rng.choice(_FACTORS)).astype(value.dtype)
    setattr(message, name, new)
    return name


def _alter_points(message, rng):
    """Alter one column of a cloud."""
    columns = [field for field in message.fields if field.datatype == 7]
    field, factor = rng.choice(columns), rng.choice(_FACTORS)
    rows = message.data.reshape(-1, message.point_step).copy()
    values = rows[:, field.offset : field.offset + 4].copy().view(np.float32)
    with np.errstate(all="ignore"):
        rows[:, field.offset : field.offset + 4] = (values * np.float32(factor)).view(np.uint8)
    message.data = rows.reshape(-1)
    return f"{field.name} x {factor}"


def _bytes(value, rng):
    noise = np.random.default_rng(rng.randrange(2**32))
    changes = (
        lambda: value[:0],
        lambda: value[:1],
        lambda: value[: len(value) // 2],
        lambda: value[: len(value) - 7],
        lambda: np.concatenate([value, value[:100]]),
        lambda: np.concatenate([value[: len(value) // 2], np.zeros(len(value) - len(value) // 2, np.uint8)]),
        lambda: np.zeros_like(value),
        lambda: noise.integers(0, 256, len(value)).astype(np.uint8),
    )
    return rng.choice(changes)()


def answers(seed, folder):
    """What `inspect` and ingestion answer to the recording of a seed, written into a folder."""
    rng = random.Random(seed)
    messages, change = altered(rng)
    path = write_ros2(folder / "walk", messages, rng.choice(["sqlite3", "mcap"]))
    try:
        is_promised = bool(inspect_recording(path).calibratable)
    except (ReadError, InputError):
        is_promised = False
    try:
        sensors = normalise(path, folder / "out").sensors
    except ReadError as error:
        return Answers(change, is_promised, 0, f"{error.code}: {error.message}")
    return Answers(change, is_promised, min(sensor.count for sensor in sensors), "")


if __name__ == "__main__":
    for number in range(int(sys.argv[1]), int(sys.argv[2])):
        with tempfile.TemporaryDirectory() as scratch:
            print(number, *answers(number, Path(scratch)), sep=" | ", flush=True)
