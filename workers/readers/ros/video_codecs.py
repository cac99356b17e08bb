"""The codec of a video message, by the name that the message states and by its first bytes."""

from __future__ import annotations

from typing import Final

# Parts of names that Foxglove, ffmpeg_image_transport (libx264, hevc_nvenc, h264;yuv420p;bgr8) and drivers write, to
# the decoders of FFmpeg.
_DECODERS: Final = {
    "264": "h264",
    "avc": "h264",
    "265": "hevc",
    "hevc": "hevc",
    "vp8": "vp8",
    "vp9": "vp9",
    "av1": "av1",
}
CODECS: Final = ("h264", "h265", "vp8", "vp9", "av1")
_STARTS: Final = (b"\0\0\0\1", b"\0\0\1")
# Types of the units with which a stream of H.265 begins (ITU-T H.265, table 7-1): parameter sets, delimiter, message.
_HEVC_FIRST: Final = frozenset((32, 33, 34, 35, 39))


def decoder_of(codec: str) -> str | None:
    """Return FFmpeg's decoder for a codec's name; None for an unknown name."""
    name = codec.partition(";")[0].lower()
    return next((decoder for part, decoder in _DECODERS.items() if part in name), None)


def codec_of_data(data: bytes, name: str) -> str:
    """Return the codec of a message that may hold an image or a frame of video; empty for an image.

    Args:
        data: the whole message.
        name: the format that it states.
    """
    decoder = decoder_of(name)
    start = next((start for start in _STARTS if data.startswith(start)), None)
    if start is not None and len(data) > len(start) + 1:
        kind = data[len(start)]
        is_hevc = (kind >> 1) & 63 in _HEVC_FIRST and kind & 129 == 0 and data[len(start) + 1] == 1
        return decoder or ("hevc" if is_hevc else "h264")
    # Images begin with letters, or with a byte that no frame of these codecs begins with.
    is_image = data[:2] in (b"\xff\xd8", b"\x89P", b"RI", b"BM", b"P5", b"P6", b"II", b"MM")
    return decoder if decoder and data and not is_image else ""
