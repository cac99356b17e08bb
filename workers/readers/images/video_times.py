"""The moment of each frame of a video: from a table beside it, or from its own time stamps and a start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Final

from workers.readers.recording import ReadError
from workers.readers.trees.file_times import read_table, whole_ns

if TYPE_CHECKING:
    from av.video.stream import VideoStream

# Not 0, which ROS reads as "no stamp".
_MADE_UP_START_NS: Final = 1_000_000_000
_EPOCH_NS: Final = 946_684_800_000_000_000  # 2000: what lies behind it counts from 1970
_MAX_FRAMES: Final = 10_000_000


@dataclass(frozen=True, slots=True)
class FrameTimes:
    """A CSV of frame times.

    Attributes:
        stamps_ns: by frame number, from 0 in the order in which frames are shown.
        complete: whether every frame has to be in it: it has no column ``frame``.
    """

    stamps_ns: Mapping[int, int]
    complete: bool

    @classmethod
    def read(cls, content: bytes, where: str) -> FrameTimes:
        """Read the times of a CSV with the columns ``stamp_ns`` and, optionally, ``frame``.

        Raises:
            ReadError: ``timestamps_malformed``.
        """
        rows = read_table(where, content, ("stamp_ns",))
        numbered = bool(rows) and "frame" in rows[0]
        stamps: dict[int, int] = {}
        for line, row in enumerate(rows, start=2):
            number = line - 2
            if numbered:
                text = (row.get("frame") or "").strip()
                if not (text.isascii() and text.isdigit() and len(text) < 9) or int(text) in stamps:
                    raise ReadError(
                        "timestamps_malformed",
                        f"{where}, line {line}: {text[:40]!r} is no frame number, or comes twice.",
                        "Number the frames from 0 in the order in which they are shown.",
                    )
                number = int(text)
            stamps[number] = whole_ns(row.get("stamp_ns"), where, line)
        if not stamps or len(stamps) > _MAX_FRAMES:
            raise ReadError(
                "timestamps_malformed", f"{where} lists {len(stamps)} frames.", "Give one line per frame: stamp_ns."
            )
        return cls(stamps, not numbered)

    def check_count(self, count: int | None, name: str) -> None:
        """Hold the table against the number of frames, where it is known.

        Raises:
            ReadError: ``timestamps_incomplete``.
        """
        if self.complete and count is not None and count != len(self.stamps_ns):
            raise ReadError(
                "timestamps_incomplete",
                f"{name} has {count} frames, and its table of times {len(self.stamps_ns)} lines.",
                "Give one line per frame; where frames were dropped, add a column frame that numbers them from 0.",
            )


@dataclass(slots=True)
class VideoClock:
    """The rule for the moments of a video's frames.

    Attributes:
        table: moments of frames; None: by their own time stamps.
        time_base: seconds in one unit of the video's time stamps.
        start_ns: moment of the first frame; None: the time stamps count from 1970.
        rate: frames per second, for frames without a time stamp.
        warnings: sentences about what was assumed.
    """

    table: FrameTimes | None
    time_base: Fraction
    start_ns: int | None
    rate: Fraction
    warnings: list[str] = field(default_factory=list[str])
    _first: int | None = None

    @classmethod
    def of(
        cls, stream: VideoStream, table: FrameTimes | None, given_ns: int | None, created_ns: int | None, name: str
    ) -> VideoClock:
        """The best that there is: a table, a given start, stamps since 1970, the creation time, or none of them.

        Args:
            stream: of the video.
            table: moments of frames.
            given_ns: the first frame's moment as the owner says it.
            created_ns: the file's creation time.
            name: of the video, for messages.
        """
        base = stream.time_base or Fraction(1, 1000)
        clock = cls(table, base, given_ns, stream.average_rate or Fraction(25))
        if table is not None or given_ns is not None:
            return clock
        if stream.start_time is not None and _nanoseconds(stream.start_time, base) > _EPOCH_NS:
            return clock
        if created_ns is not None:
            clock.start_ns = created_ns
            clock.warnings.append(
                f"{name}: times count from the file's creation time, which may be seconds off, or the recording's "
                "end. Estimate the clocks' offset, or put a CSV with stamp_ns for each frame beside the video."
            )
        else:
            clock.start_ns = _MADE_UP_START_NS
            clock.warnings.append(
                f"{name}: the video does not say when it began; its times count from its first frame, and are "
                "not the LiDAR's. Put a CSV with stamp_ns for each frame beside it, or say when its first frame "
                "was taken (camera_start_ns)."
            )
        return clock

    def stamp_ns(self, number: int, pts: int | None) -> int | None:
        """The moment of a frame, None where a table leaves the frame out.

        Args:
            number: of the frame, from 0.
            pts: its time stamp in the video.
        """
        if self.table is not None:
            return self.table.stamps_ns.get(number)
        relative: int
        if number == 0:
            self._first = pts
        if pts is None or self._first is None:
            relative = int(Fraction(number * 1_000_000_000) / self.rate)
        else:
            relative = _nanoseconds(pts - self._first, self.time_base)
        if self.start_ns is None:
            return _nanoseconds(self._first or 0, self.time_base) + relative
        return self.start_ns + relative


def _nanoseconds(ticks: int, base: Fraction) -> int:
    return ticks * base.numerator * 1_000_000_000 // base.denominator
