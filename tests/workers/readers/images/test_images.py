"""Encoded images: what browsers show stays, other formats become PNG. What is no image is in test_refusals.py."""

import cv2
import numpy as np
import pytest
from making_recordings import jpeg_claiming, png

from workers.readers.images.deep_images import depth_of, with_depth
from workers.readers.images.headers import ImageHeader, read_image_header
from workers.readers.images.still_images import image_frame

PIXELS = np.random.default_rng(0).integers(0, 255, (301, 417, 3), np.uint8)
DEEP = (np.arange(48, dtype=np.uint16).reshape(6, 8) * 80 + 200).astype(np.uint16)


def encoded(suffix, pixels, *flags):
    return cv2.imencode(suffix, pixels, flags)[1].tobytes()


@pytest.mark.parametrize(
    ("suffix", "flags"),
    [
        *((".png", []), (".jpg", []), (".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])),
        *((".webp", [cv2.IMWRITE_WEBP_QUALITY, 80]), (".webp", [cv2.IMWRITE_WEBP_QUALITY, 101])),
    ],
)
def test_what_browsers_show_stays_byte_for_byte(suffix, flags):
    data = encoded(suffix, PIXELS, *flags)
    frame = image_frame(data, 17, "a")
    assert (frame.data, frame.stamp_ns, frame.width, frame.height) == (data, 17, 417, 301)
    assert frame.media_type == f"image/{suffix[1:].replace('jpg', 'jpeg')}"
    assert frame.transcoding == ""


@pytest.mark.parametrize(
    ("data", "header"),
    [
        (jpeg_claiming(640, 480), ImageHeader("image/jpeg", 640, 480)),  # a comment looks like a frame header
        (png(4000, 4000), ImageHeader("image/png", 4000, 4000)),  # one grey: packed 1000 to 1, still honest
    ],
)
def test_headers_that_look_odd(data, header):
    assert read_image_header(data, "frame") == header


@pytest.mark.parametrize("suffix", [".tif", ".bmp", ".ppm"])
def test_other_formats_become_png_without_loss(suffix):
    frame = image_frame(encoded(suffix, PIXELS), 17, f"a{suffix}")
    assert (frame.media_type, frame.width, frame.height, bool(frame.transcoding)) == ("image/png", 417, 301, True)
    assert "without loss" in frame.transcoding
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR), PIXELS)


def thermal(hot_k=150.0):
    """A frame of 0.04 K a count: air, a board 2 K warmer, something hot, and a noise of 50 mK."""
    kelvin = 290.0 + np.random.default_rng(1).normal(0.0, 0.05, (240, 320))
    kelvin[60:120, 80:140] += 2.0
    kelvin[200:220, 280:300] += hot_k
    return np.rint(kelvin / 0.04).astype(np.uint16)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".pgm"])
def test_grey_of_16_bits_shows_what_is_faint_and_keeps_the_16_bits(suffix):
    frame = image_frame(encoded(suffix, thermal()), 17, f"a{suffix}")
    shown = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown.dtype == np.uint8 and shown.shape == (240, 320)
    board, beside = shown[65:115, 85:135].astype(float), shown[65:115, 20:70].astype(float)
    # As a whole the frame spans 150 K: the board would be 3 of 255 levels above the air.
    assert board.mean() - beside.mean() > 20.0
    assert np.diff(beside, axis=1).std() / np.sqrt(2.0) < 6.0, "noise is not blown up"
    np.testing.assert_array_equal(depth_of(frame.data), thermal())
    assert "16 bits" in frame.transcoding
    assert read_image_header(frame.data, "frame") == ImageHeader("image/png", 320, 240)


def test_16_bits_beside_an_image_count_only_if_they_are_of_it():
    plain = encoded(".png", np.zeros((240, 320), np.uint8))
    assert depth_of(plain) is None and depth_of(encoded(".jpg", PIXELS)) is None
    assert depth_of(with_depth(plain, np.zeros((240, 321), np.uint16))) is None
    assert depth_of(with_depth(plain, np.zeros((240, 320), np.uint8))) is None
    whole = with_depth(plain, thermal())
    for cut in (20, 60, 1000, len(whole) - 40):
        assert depth_of(whole[:cut]) is None
    start = whole.index(b"apXd") + 4
    assert depth_of(whole[:start] + bytes(200) + whole[start + 200 :]) is None


def test_colours_of_16_bits_are_stretched_to_8():
    deep = np.repeat(DEEP[..., None], 3, axis=2)
    frame = image_frame(encoded(".png", deep), 17, "a.png")
    shown = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown.dtype == np.uint8 and (shown.min(), shown.max()) == (0, 255)
    assert (np.diff(shown[..., 0].reshape(-1).astype(int)) >= 5).all()  # 48 values, evenly over 256
    assert "16 bits" in frame.transcoding and depth_of(frame.data) is None
