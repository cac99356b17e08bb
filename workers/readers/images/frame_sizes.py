"""The size of a camera's frames: one calibration fits one size."""

from __future__ import annotations

from collections import Counter

from workers.readers.recording import MessageError

# Width and height, pixels.
FrameSize = tuple[int, int]


def usual_size(counts: Counter[FrameSize], stated: FrameSize | None) -> FrameSize:
    """Return the size that the rig states if any frame has it, else the size of most frames."""
    return stated if stated in counts and stated is not None else counts.most_common(1)[0][0]


def other_size(size: FrameSize, usual: FrameSize, stamp_ns: int) -> MessageError:
    """The reason to leave out a frame whose size is not the usual one."""
    return MessageError(
        "image_size_differs",
        f"The frame at {stamp_ns / 1e9:.3f} s has {size[0]} x {size[1]} pixels; the others have {usual[0]} x "
        f"{usual[1]}.",
        "Two cameras may share this topic or folder, or the camera was switched: record each by itself.",
    )
