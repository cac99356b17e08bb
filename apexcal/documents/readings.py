"""What an owner may say of a recording that its file does not: the words of its options."""

from __future__ import annotations

from typing import Literal

LidarModel = Literal["vlp16", "vlp32c", "hdl32e", "hdl64e", "alpha_prime"]
PointTimes = Literal["auto", "stamp_only"]
StampConvention = Literal["start", "end", "unknown"]
