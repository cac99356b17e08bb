import struct

import cv2
import numpy as np
import pytest
from making_recordings import png, png_claiming

from workers.readers.images.still_images import image_frame
from workers.readers.recording import ReadError

PIXELS = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
DEEP = (np.arange(48, dtype=np.uint16).reshape(6, 8) * 80 + 200).astype(np.uint16)


def encoded(suffix, pixels, *flags):
    return cv2.imencode(suffix, pixels, flags)[1].tobytes()


def refused(data, name):
    with pytest.raises(ReadError) as caught:
        image_frame(data, 1, name)
    assert name in caught.value.message and caught.value.hint
    return caught.value


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_what_browsers_show_stays_byte_for_byte(suffix):
    data = encoded(suffix, PIXELS)
    frame = image_frame(data, 17, f"a{suffix}")
    assert (frame.data, frame.stamp_ns, frame.width, frame.height) == (data, 17, 8, 6)
    assert not frame.transcoded and frame.transcoding == ""


@pytest.mark.parametrize("suffix", [".tif", ".bmp", ".ppm"])
def test_other_formats_become_png_without_loss(suffix):
    frame = image_frame(encoded(suffix, PIXELS), 17, f"a{suffix}")
    assert (frame.media_type, frame.width, frame.height, frame.transcoded) == ("image/png", 8, 6, True)
    assert "without loss" in frame.transcoding
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR), PIXELS)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".pgm"])
def test_16_bits_are_stretched_to_8(suffix):
    frame = image_frame(encoded(suffix, DEEP), 17, f"a{suffix}")
    shown = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown.dtype == np.uint8 and (shown.min(), shown.max()) == (0, 255)
    assert (np.diff(shown.reshape(-1).astype(int)) >= 5).all()  # 48 values, evenly over 256
    assert "16 bits" in frame.transcoding


def claiming(suffix, width, height):
    """A file whose header claims a size."""
    data = bytearray(encoded(suffix, PIXELS))
    if suffix == ".bmp":
        struct.pack_into("<ii", data, 18, width, height)
    elif suffix == ".ppm":
        data = data.replace(b"8 6", f"{width} {height}".encode())
    else:
        (directory,) = struct.unpack_from("<I", data, 4)
        (count,) = struct.unpack_from("<H", data, directory)
        for entry in range(directory + 2, directory + 2 + 12 * count, 12):
            (tag,) = struct.unpack_from("<H", data, entry)
            if tag in (256, 257):
                struct.pack_into("<HII", data, entry + 2, 4, 1, width if tag == 256 else height)
    return bytes(data)


@pytest.mark.parametrize("suffix", [".tif", ".bmp", ".ppm"])
def test_absurd_sizes_are_refused_before_anything_is_decoded(suffix):
    assert refused(claiming(suffix, 60_000, 60_000), f"a{suffix}").code == "image_too_large"
    assert refused(claiming(suffix, 0, 5), f"a{suffix}").code == "image_damaged"
    error = refused(claiming(suffix, 12_000, 12_000), f"a{suffix}")
    assert error.code == "image_damaged" and "cannot hold" in error.message


@pytest.mark.parametrize("suffix", [".tif", ".bmp", ".ppm"])
def test_images_cut_short_and_images_of_another_kind(suffix):
    data = encoded(suffix, PIXELS)
    assert refused(data[:6], f"a{suffix}").code == "image_damaged"
    assert refused(b"", f"a{suffix}").code == "image_unsupported"
    assert image_frame(png(4, 4), 1, f"a{suffix}").data == png(4, 4)  # the content counts and not the name


def test_a_png_of_16_bits_that_is_damaged():
    data = bytearray(png_claiming(8, 6, b"no deflate"))
    data[24] = 16
    assert refused(bytes(data), "a.png").code == "image_damaged"
