import cv2
import numpy as np
import pytest

from workers.readers.recording import ReadError
from workers.readers.transcode import raw_to_png

RGB = np.random.default_rng(0).integers(0, 255, (5, 7, 3), np.uint8)
GREY = RGB[..., :1]
ALPHA = np.concatenate([RGB, np.full((5, 7, 1), 9, np.uint8)], 2)


@pytest.mark.parametrize(
    ("encoding", "stored", "bgr"),
    [
        ("rgb8", RGB, RGB[..., ::-1]),
        ("bgr8", RGB, RGB),
        ("rgba8", ALPHA, RGB[..., ::-1]),
        ("bgra8", ALPHA, RGB),
        ("mono8", GREY, np.repeat(GREY, 3, 2)),
    ],
)
@pytest.mark.parametrize("padding", [0, 4])
def test_every_pixel_survives(encoding, stored, bgr, padding):
    rows = np.pad(stored.reshape(5, -1), ((0, 0), (0, padding)))
    how = {"width": 7, "height": 5, "step": rows.shape[1], "encoding": encoding, "stamp_ns": 3, "where": "image"}
    frame = raw_to_png(rows.reshape(-1), **how)
    assert (frame.media_type, frame.width, frame.height, frame.stamp_ns) == ("image/png", 7, 5, 3)
    assert frame.transcoded
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR), bgr)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"encoding": "32FC1"}, "image_encoding_unsupported"),
        ({"width": 60000, "height": 60000}, "image_too_large"),
        ({"step": 20}, "image_damaged"),
        ({"height": 6}, "image_damaged"),
        ({"width": 0}, "image_damaged"),
    ],
)
def test_what_cannot_be_an_image(change, code):
    how = {"width": 7, "height": 5, "step": 21, "encoding": "rgb8", "stamp_ns": 3, "where": "image"} | change
    with pytest.raises(ReadError) as caught:
        raw_to_png(RGB.reshape(-1), **how)
    assert caught.value.code == code
