import struct

import cv2
import numpy as np
import pytest
from making_recordings import DATA, jpeg_claiming, png, png_claiming

from workers.readers.images.headers import ImageHeader, read_image_header
from workers.readers.recording import ReadError


def refused(data):
    with pytest.raises(ReadError) as caught:
        read_image_header(data, "frame 7")
    assert "frame 7" in caught.value.message and caught.value.hint
    return caught.value


@pytest.mark.parametrize(
    ("suffix", "media_type", "flags"),
    [
        (".png", "image/png", []),
        (".jpg", "image/jpeg", []),
        (".jpg", "image/jpeg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
        (".webp", "image/webp", [cv2.IMWRITE_WEBP_QUALITY, 80]),
        (".webp", "image/webp", [cv2.IMWRITE_WEBP_QUALITY, 101]),
    ],
)
def test_size_and_type_of_real_encodings(suffix, media_type, flags):
    pixels = np.random.default_rng(0).integers(0, 255, (301, 417, 3), np.uint8)
    data = cv2.imencode(suffix, pixels, flags)[1].tobytes()
    assert read_image_header(data, "frame") == ImageHeader(media_type, 417, 301)


def test_an_extended_webp():
    head = b"RIFF" + bytes(4) + b"WEBPVP8X" + bytes(8) + (639).to_bytes(3, "little") + (479).to_bytes(3, "little")
    assert read_image_header(head + bytes(100), "frame") == ImageHeader("image/webp", 640, 480)


def test_a_photograph():
    photograph = DATA / "chessboard" / "left01.jpg"
    if not photograph.exists():
        pytest.skip("real data is not here: ../shared/data/chessboard")
    assert read_image_header(photograph.read_bytes(), "frame") == ImageHeader("image/jpeg", 640, 480)


@pytest.mark.parametrize("data", [png_claiming(60000, 60000), jpeg_claiming(60000, 60000)])
def test_60000_by_60000_is_refused_from_the_header(data):
    error = refused(data)
    assert error.code == "image_too_large" and "60000 x 60000" in error.message


def test_a_png_that_claims_more_than_its_bytes_can_hold():
    assert refused(png_claiming(14000, 14000, b"x" * 100)).code == "image_damaged"
    assert read_image_header(png(4000, 4000), "frame").width == 4000  # one grey: packed 1000 to 1, still honest


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"", "image_unsupported"),
        (b"GIF89a" + bytes(40), "image_unsupported"),
        (png(4, 4)[:20], "image_damaged"),
        (png_claiming(0, 5), "image_damaged"),
        (jpeg_claiming(640, 480)[:30], "image_damaged"),
        (jpeg_claiming(640, 0), "image_damaged"),
        (b"\xff\xd8\xff\xe0\x00\x10" + bytes(60), "image_damaged"),
        (b"RIFF\0\0\0\0WEBPVP8X\0\0\0\0", "image_damaged"),
    ],
)
def test_broken_headers(data, code):
    assert refused(data).code == code


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_photograph_that_viewers_turn(order):
    def photograph(orientation):
        entries = [(0x10F, 2, 4, 0), (0x112, 3, 1, orientation)]
        directory = struct.pack(order + "H", 2) + b"".join(struct.pack(order + "HHIHxx", *e) for e in entries)
        tiff = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8) + directory
        segment = b"Exif\0\0" + tiff
        upright = jpeg_claiming(640, 480)
        return upright[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + upright[2:]

    assert read_image_header(photograph(1), "frame").width == 640
    assert refused(photograph(6)).code == "image_turned"


def test_a_comment_is_not_mistaken_for_the_frame_header():
    assert read_image_header(jpeg_claiming(640, 480), "frame") == ImageHeader("image/jpeg", 640, 480)
