import cv2
import numpy as np
import pytest

from workers.readers.images.deep_images import depth_of
from workers.readers.images.transcode import raw_to_png
from workers.readers.recording import ReadError
from workers.readers.ros.topic_messages import RawImage


def png_of(data, width, height, step, encoding, *, big_endian=False):
    return raw_to_png(RawImage(3, "camera", width, height, step, encoding, big_endian, data), 3, "image")


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
    frame = png_of(rows.reshape(-1), 7, 5, rows.shape[1], encoding)
    assert (frame.media_type, frame.width, frame.height, frame.stamp_ns) == ("image/png", 7, 5, 3)
    assert frame.transcoding
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR), bgr)


def test_rows_without_a_step_follow_each_other():
    frame = png_of(RGB.reshape(-1), 7, 5, 0, "bgr8")
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR), RGB)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"encoding": "32FC1"}, "image_encoding_unsupported"),
        ({"width": 60000, "height": 60000}, "image_too_large"),
        ({"step": 20}, "image_damaged"),
        ({"height": 6}, "image_damaged"),
        ({"height": 6, "step": 0}, "image_damaged"),
        ({"width": 0}, "image_empty"),
    ],
)
def test_what_cannot_be_an_image(change, code):
    how = {"width": 7, "height": 5, "step": 21, "encoding": "rgb8"} | change
    with pytest.raises(ReadError) as caught:
        png_of(RGB.reshape(-1), **how)
    assert caught.value.code == code


# A smooth scene in colour: demosaicing and shared colours can restore it.
Y, X = np.mgrid[0:32, 0:48]
SMOOTH = np.stack([60 + 2 * X, 200 - 3 * Y, 40 + X + Y], 2).astype(np.uint8)  # blue, green, red


def shown(stored, encoding, *, step=None, **how):
    height, width = SMOOTH.shape[:2]
    data = np.ascontiguousarray(stored).view(np.uint8).reshape(-1)
    step = step or stored[0].nbytes
    frame = png_of(data, width, height, step, encoding, **how)
    assert (frame.width, frame.height) == (width, height)
    return cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR).astype(int), frame


def mosaic(pattern, pixels):
    """What a sensor with this pattern of filters (first row, second row) sees."""
    channel = {"b": 0, "g": 1, "r": 2}
    raw = np.empty(pixels.shape[:2], pixels.dtype)
    for i, colour in enumerate(pattern):
        raw[i // 2 :: 2, i % 2 :: 2] = pixels[i // 2 :: 2, i % 2 :: 2, channel[colour]]
    return raw


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_mosaic_of_filters_gives_the_colours_back(pattern):
    image, frame = shown(mosaic(pattern, SMOOTH), f"bayer_{pattern}8")
    assert np.abs(image - SMOOTH)[2:-2, 2:-2].max() <= 4
    assert "demosaiced" in frame.transcoding


@pytest.mark.parametrize("big_endian", [False, True])
def test_a_mosaic_of_16_bits(big_endian):
    deep = mosaic("rggb", SMOOTH.astype(np.uint16) * 16)
    image, frame = shown(deep.astype(">u2") if big_endian else deep, "bayer_rggb16", big_endian=big_endian)
    expected = (SMOOTH.astype(float) - SMOOTH.min()) * 255 / (int(SMOOTH.max()) - int(SMOOTH.min()))
    assert np.abs(image - expected)[2:-2, 2:-2].max() <= 8
    assert "16 bits" in frame.transcoding


@pytest.mark.parametrize(
    ("encoding", "conversion"),
    [("uyvy", cv2.COLOR_BGR2YUV_UYVY), ("yuv422", cv2.COLOR_BGR2YUV_UYVY), ("yuv422_yuy2", cv2.COLOR_BGR2YUV_YUY2)],
)
def test_pairs_of_pixels_that_share_a_colour(encoding, conversion):
    image, frame = shown(cv2.cvtColor(SMOOTH, conversion), encoding)
    assert np.abs(image - SMOOTH).max() <= 5 and "YUV" in frame.transcoding


@pytest.mark.parametrize("encoding", ["nv12", "nv21"])
def test_planes_of_brightness_and_colour(encoding):
    planes = cv2.cvtColor(SMOOTH, cv2.COLOR_BGR2YUV_I420)
    height, width = SMOOTH.shape[:2]
    blue, red = planes[height:].reshape(2, height // 2, width // 2)
    first, second = (blue, red) if encoding == "nv12" else (red, blue)
    stored = np.concatenate([planes[:height], np.stack([first, second], 2).reshape(height // 2, width)])
    image, _ = shown(stored, encoding)
    assert np.abs(image - SMOOTH).max() <= 6


@pytest.mark.parametrize(("encoding", "channels"), [("bgr16", 3), ("rgba16", 4)])
def test_16_bits_keep_their_order_and_fill_8(encoding, channels):
    """All values within a narrow part of what 16 bits hold."""
    deep = np.repeat((21_000 + 3 * X + 100 * Y)[..., None].astype(np.uint16), channels, 2)
    image, frame = shown(deep, encoding)
    level = image[..., 0]
    assert level.min() == 0 and level.max() == 255 and "16 bits" in frame.transcoding
    assert (np.diff(level, axis=0) >= 0).all() and (np.diff(level, axis=1) >= 0).all()


@pytest.mark.parametrize(("encoding", "big_endian"), [("mono16", False), ("mono16", True), ("16UC1", False)])
def test_grey_of_16_bits_is_kept_as_it_was_measured(encoding, big_endian):
    deep = (21_000 + 3 * X + 100 * Y).astype(np.uint16)
    image, frame = shown(deep.astype(">u2") if big_endian else deep, encoding, big_endian=big_endian)
    np.testing.assert_array_equal(depth_of(frame.data), deep)
    assert (np.diff(image[..., 0], axis=1) >= 0).mean() > 0.95 and "16 bits" in frame.transcoding


def test_a_constant_image_of_16_bits():
    shown(np.full(SMOOTH.shape[:2], 700, np.uint16), "mono16")


@pytest.mark.parametrize("encoding", ["nv12", "uyvy"])
def test_odd_sizes_where_pixels_share_colours(encoding):
    with pytest.raises(ReadError) as caught:
        png_of(np.zeros(400, np.uint8), 7, 5, 14, encoding)
    assert caught.value.code == "image_damaged"
