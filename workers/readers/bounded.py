"""Decompression of what was uploaded: never more than the bound, whatever the data claim of themselves."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

import zstandard

_WINDOW_BYTES: Final = 128 * 1024**2


class ExpandsError(ValueError):
    """More came out than was allowed or stated."""


def decompress_zstd(data: bytes | memoryview, limit: int) -> bytes:
    """One or several zstd frames.

    Raises:
        ExpandsError: more than ``limit`` bytes came out.
        zstandard.ZstdError: the data are damaged.
    """
    decompressor = zstandard.ZstdDecompressor(max_window_size=_WINDOW_BYTES)
    with decompressor.stream_reader(data, read_across_frames=True) as stream:
        return _checked(stream.read(limit + 1), limit)


def decompress_lz4(data: bytes | memoryview, limit: int) -> bytes:
    """One lz4 frame.

    Raises:
        ExpandsError: more than ``limit`` bytes came out.
        RuntimeError: the data are damaged.
    """
    lz4: Any = import_module("lz4.frame")  # without types
    return _checked(lz4.LZ4FrameDecompressor().decompress(data, max_length=limit + 1), limit)


def _checked(raw: bytes, limit: int) -> bytes:
    if len(raw) > limit:
        raise ExpandsError(f"more than {limit} bytes come out of a compressed part")
    return raw
