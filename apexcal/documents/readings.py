"""What an owner may say of a recording that its file does not: the words of its options.

Images are raw, as the lens drew them, or rectified: without distortion, and perhaps turned.
"""

from __future__ import annotations

from typing import Literal

ImageKind = Literal["raw", "rectified"]
LidarModel = Literal["vlp16", "vlp32c", "hdl32e", "hdl64e", "alpha_prime"]
PointTimes = Literal["auto", "stamp_only"]
StampConvention = Literal["start", "end", "unknown"]
