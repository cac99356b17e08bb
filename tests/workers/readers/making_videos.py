"""Small videos made for tests, with PyAV."""

from fractions import Fraction

import av
import numpy as np

WIDTH, HEIGHT = 64, 48
CREATED = "2023-11-14T22:13:20.000000Z"
CREATED_NS = 1_700_000_000_000_000_000
# Milliseconds: a camera whose rate varies.
TIMES_MS = (0, 67, 133, 190, 280, 333, 400, 471, 540, 600)


def picture(number):
    """A frame that says its number: as many bright columns of eight pixels."""
    pixels = np.full((HEIGHT, WIDTH, 3), 30, np.uint8)
    pixels[:, : 6 * (number + 1)] = (200, 120, 60)
    return pixels


def number_of(pixels):
    """The number that a decoded frame says."""
    return round(np.count_nonzero(pixels[HEIGHT // 2, :, 0] > 100) / 6) - 1


def write_video(path, *, times_ms=TIMES_MS, codec="libx264", created=CREATED, start_ms=0, size=None, options=None):
    """A video with B-frames and the given times."""
    width, height = size or (WIDTH, HEIGHT)
    with av.open(str(path), "w", options=options or {}) as container:
        if created is not None:
            container.metadata["creation_time"] = created
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        if codec == "libx264":
            stream.options = {"bf": "2", "crf": "12"}
        elif codec == "mpeg4":
            stream.bit_rate = 4_000_000
        stream.codec_context.time_base = stream.time_base = (
            Fraction(1, 1000) if codec == "libx264" else Fraction(1, 30)
        )
        for number, time_ms in enumerate(times_ms):
            pixels = picture(number) if size is None else np.zeros((height, width, 3), np.uint8)
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
            frame.time_base = stream.codec_context.time_base
            frame.pts = start_ms + time_ms if codec == "libx264" else number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
