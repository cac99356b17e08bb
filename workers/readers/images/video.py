"""A video (MP4, AVI, Matroska) as a camera: its frames decoded in the order in which they are shown, as JPEG."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import av
import av.error
import cv2
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from apexcal.documents.readings import ReadOptions
from workers.readers.images.headers import MAX_PIXELS, check_size
from workers.readers.images.video_times import FrameTimes, VideoClock
from workers.readers.omissions import Omissions
from workers.readers.output import video_is_decoded
from workers.readers.progress import beat
from workers.readers.recording import Frame, MessageError, ReadError, Recording, Sensor, Sweep

# On frames of 1920 x 1208 pixels 8 ms and 0.9 MB, 1.6 grey levels RMS off what the video holds; as PNG they take
# 75 ms and 4 MB. What the video's own compression cost is not undone by either.
_JPEG_QUALITY: Final = 95
_TRANSCODED: Final = f"Frames of a video were decoded and encoded anew as JPEG of quality {_JPEG_QUALITY}."
# What cameras and their recorders write; FFmpeg has hundreds more, and each is code that an upload could reach.
CODECS: Final = (
    *("h264", "hevc", "av1", "libdav1d", "vp8", "vp9", "libvpx", "libvpx-vp9"),
    *("mpeg4", "msmpeg4v3", "mpeg2video", "mjpeg", "prores", "dnxhd", "ffv1", "huffyuv", "ffvhuff", "rawvideo"),
)
_OPTIONS: Final = {"protocol_whitelist": "file", "codec_whitelist": ",".join(CODECS), "max_pixels": str(MAX_PIXELS)}
_FORMATS: Final = ((b"RIFF", 0, "avi"), (b"\x1aE\xdf\xa3", 0, "matroska"), (b"ftyp", 4, "mov"))


class VideoRecording(Recording):
    """One video file: one camera.

    Frames come as they are stored, not turned as the file may ask a player to.

    Args:
        path: the file.
        options: ``camera_start_ns`` is the first frame's moment, where no table says it.
        times: content of a CSV beside it with the moment of every frame: ``stamp_ns``, or ``frame,stamp_ns``.
        start_ns: the first frame's moment as a ``timestamps.csv`` states it.
        name: what to call the camera; None: the file's name.

    Raises:
        ReadError: ``video_damaged``, ``video_unsupported``, ``image_too_large``, ``timestamps_malformed``,
            ``timestamps_incomplete``.
    """

    format = "video"

    def __init__(
        self,
        path: Path,
        options: ReadOptions,
        *,
        times: bytes | None = None,
        start_ns: int | None = None,
        name: str | None = None,
    ) -> None:
        self._path = path
        self._name = name or path.name
        self._warnings: list[str] = []
        self._omissions = Omissions()
        with self._opened() as container:
            stream = self._stream(container)
            check_size(stream.width, stream.height, self._name)
            self._table = None if times is None else FrameTimes.read(times, f"{self._name}'s table of times")
            count: int | None = stream.frames or None
            if self._table is not None:
                self._table.check_count(count, self._name)
            begin_ns = start_ns if start_ns is not None else options.camera_start_ns
            self._clock = VideoClock.of(stream, self._table, begin_ns, _created(container, stream), self._name)
            self.sensors = [Sensor("camera", self._name, "", count, self._notes(container, stream))]
        self._announced = count
        self._share = 0.0

    def _notes(self, container: InputContainer, stream: VideoStream) -> dict[str, str]:
        turned = _rotation(container, stream)
        if turned:
            self._warnings.append(
                f"{self._name}: players turn this video by {turned} degrees; its frames are taken as the camera "
                "stored them, unturned."
            )
        others = len(container.streams.video) - 1
        if others > 0:
            self._warnings.append(f"{self._name} holds {others} more video streams; only the first is read.")
        rate = stream.average_rate
        return {
            "width": str(stream.width),
            "height": str(stream.height),
            "codec": str(stream.codec_context.name),
            **({} if rate is None else {"rate_hz": f"{float(rate):.6g}"}),
        }

    @property
    def warnings(self) -> list[str]:
        """Sentences about the times and about what was missing."""
        return [*self._clock.warnings, *self._warnings]

    @property
    def share_read(self) -> float | None:
        """Share of the file's bytes up to the packet that was decoded last."""
        return self._share

    def frames(self, sensor: Sensor) -> Iterator[Frame]:
        """The frames in the order in which they are shown."""
        number = -1
        left_out = 0
        self._omissions.clear([sensor.name])
        with self._opened() as container:
            stream = self._stream(container)
            for number, frame in enumerate(self._decoded(container, stream)):
                stamp_ns = self._clock.stamp_ns(number, frame.pts)
                if stamp_ns is None:
                    left_out += 1
                    continue
                with self._omissions.leaving_out(sensor.name, stamp_ns):
                    yield jpeg_frame(frame, stamp_ns, f"{self._name}, frame {number}")
        self._close_account(number + 1, left_out)

    def _decoded(self, container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
        """Frames up to the end, or up to where the file is damaged."""
        number = 0
        size = max(1, self._path.stat().st_size)
        try:
            for packet in container.demux(stream):
                beat()
                self._share = min(1.0, max(self._share, (packet.pos or 0) / size))
                for frame in packet.decode():
                    number += 1
                    yield frame
        except av.error.FFmpegError as error:
            if number == 0:
                raise self._damaged(f"its first frame cannot be decoded ({_reason(error)})") from error
            self._warn(f"{self._name} is damaged behind frame {number} ({_reason(error)}); what is there was read.")

    def _close_account(self, count: int, left_out: int) -> None:
        if count == 0:
            raise self._damaged("no frame can be decoded from it")
        if left_out:
            self._warn(f"{self._name}: {left_out} frames that the table of times does not list were left out.")
        if self._announced is not None and count < self._announced:
            self._warn(f"{self._name}: {count} of {self._announced} frames are there; the file may be cut short.")
        elif self._table is not None:
            self._table.check_count(count, self._name)

    def _warn(self, sentence: str) -> None:
        if sentence not in self._warnings:
            self._warnings.append(sentence)

    @property
    def omissions(self) -> Omissions:
        """Frames that are damaged."""
        return self._omissions

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """The frames, if the camera was chosen."""
        for sensor in sensors:
            for frame in self.frames(sensor):
                yield sensor, frame

    @contextmanager
    def _opened(self) -> Generator[InputContainer]:
        """The container; its format is told by its first bytes, so that no playlist can make it open other files."""
        with self._path.open("rb") as file:
            head = file.read(12)
        form = next((name for magic, at, name in _FORMATS if head[at : at + 4] == magic), None)
        if form is None:
            raise ReadError(
                "video_unsupported",
                f"{self._name} is no MP4, AVI or Matroska file, whatever its name says.",
                "Convert it to MP4 without re-encoding: `ffmpeg -i IN -c copy OUT.mp4`.",
            )
        try:
            # Opening decodes some frames to learn of them: the limit on their size has to stand before.
            container = av.open(str(self._path), format=form, options=_OPTIONS, metadata_errors="replace")
        except av.error.FFmpegError as error:
            why = "its directory of frames is missing, as in a file that was never closed" if form == "mov" else ""
            raise self._damaged(why or _reason(error)) from error
        with container:
            yield container

    def _stream(self, container: InputContainer) -> VideoStream:
        if not container.streams.video:
            raise ReadError("video_unsupported", f"{self._name} holds no video.", "Upload the camera's video.")
        stream = container.streams.video[0]
        context: Any = stream.codec_context
        if context is None or context.name is None:
            raise ReadError(
                "video_unsupported",
                f"{self._name} uses a codec that is not known here.",
                "Convert it to H.264: `ffmpeg -i IN -crf 12 OUT.mp4`.",
            )
        if context.name not in CODECS:
            raise ReadError(
                "video_unsupported",
                f"{self._name} uses the codec {context.name}, which is not read.",
                f"Convert it to one of {', '.join(CODECS)}.",
            )
        video_is_decoded()
        context.thread_count = 1
        context.options = {"max_pixels": _OPTIONS["max_pixels"]}
        return stream

    def _damaged(self, why: str) -> ReadError:
        return ReadError(
            "video_damaged",
            f"{self._name} is damaged or cut short: {why}.",
            "Copy it again; if the original does not play either, convert what is there: "
            "`ffmpeg -err_detect ignore_err -i IN -c copy OUT.mkv`.",
        )


def jpeg_frame(picture: VideoFrame, stamp_ns: int, where: str) -> Frame:
    """A decoded picture as JPEG.

    Raises:
        MessageError: ``image_too_large``, ``video_damaged``.
    """
    if picture.is_corrupt:
        raise MessageError("video_damaged", f"{where} is damaged.", "Copy the recording again.")
    check_size(picture.width, picture.height, where)
    pixels: Any = picture.to_ndarray(format="bgr24")
    done, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not done:
        raise MessageError("video_damaged", f"{where} holds a frame that is no JPEG.", "Record it again.")
    size = (picture.width, picture.height)
    return Frame(stamp_ns, data.tobytes(), "image/jpeg", *size, _TRANSCODED)


def _reason(error: Exception) -> str:
    return re.sub(r"^\[Errno -?\d+\] ", "", str(error)).partition(":")[0] or type(error).__name__


def _rotation(container: InputContainer, stream: VideoStream) -> int:
    """Degrees by which players turn the frames."""
    try:
        return next((int(frame.rotation) % 360 for frame in container.decode(stream)), 0)
    except av.error.FFmpegError:
        return 0  # said when the frames are read


def _created(container: InputContainer, stream: VideoStream) -> int | None:
    """The creation time of a file in nanoseconds; years before 2000 are cameras whose clock was never set."""
    tables: tuple[Mapping[str, str], ...] = (stream.metadata, container.metadata)
    for table in tables:
        try:
            moment = datetime.fromisoformat(table.get("creation_time", ""))
        except ValueError:
            continue
        moment = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
        if moment.year >= 2000:
            seconds = int(moment.replace(microsecond=0).timestamp())
            return seconds * 1_000_000_000 + moment.microsecond * 1000
    return None
