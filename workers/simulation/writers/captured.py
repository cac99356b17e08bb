"""A capture of the LiDAR's packets with the cameras beside it: as JPEG files, or as a video each."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import av

from workers.readers.recording import Sweep
from workers.simulation.render import encode_jpeg
from workers.simulation.writers.files import StampTable
from workers.simulation.writers.packets import Capture, Vlp16Packets, ethernet
from workers.simulation.writers.recording import Channel, Picture

_TICKS = 90_000  # of a video's clock, per second


class Cameras(Protocol):
    """What lies beside the capture."""

    names: dict[str, str]

    def write(self, camera: str, picture: Picture) -> None: ...

    def close(self) -> None: ...


class CapturedRecording:
    """A folder with ``lidar.pcap`` (or pcapng) and the cameras beside it."""

    def __init__(
        self, folder: Path, lidar_file: str, capture: Capture, packets: Vlp16Packets, cameras: Cameras
    ) -> None:
        self.path = folder
        self.names = {"lidar": lidar_file, **cameras.names}
        self._capture = capture
        self._packets = packets
        self._cameras = cameras

    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        for at_ns, payload in self._packets.of(sweep):
            self._capture.add(at_ns, ethernet(payload))

    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        self._cameras.write(camera, picture)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._capture.close()
        self._cameras.close()


class JpegFiles:
    """``images/<camera>/<number>.jpg`` and ``timestamps.csv`` at the top."""

    def __init__(self, folder: Path, cameras: Sequence[Channel]) -> None:
        self._folder = folder
        self.names = {camera.name: f"images/{camera.name}" for camera in cameras}
        self._table = StampTable()
        self._count = dict.fromkeys(self.names, 0)
        for name in self.names.values():
            (folder / name).mkdir(parents=True)

    def write(self, camera: str, picture: Picture) -> None:
        name = f"{self.names[camera]}/{self._count[camera]:06d}.jpg"
        self._count[camera] += 1
        (self._folder / name).write_bytes(encode_jpeg(picture.image))
        self._table.add(name, picture.stamp_ns)

    def close(self) -> None:
        (self._folder / StampTable.NAME).write_bytes(self._table.content())


class Videos:
    """``<camera>.mp4`` (H.264, its own variable time stamps) and ``<camera>.csv`` with each frame's stamp."""

    def __init__(self, folder: Path, cameras: Sequence[Channel], start_ns: int) -> None:
        self._folder = folder
        self.names = {camera.name: f"{camera.name}.mp4" for camera in cameras}
        self._channels = {camera.name: camera for camera in cameras}
        self._begins = datetime.fromtimestamp(start_ns // 1_000_000_000, UTC).strftime("%Y-%m-%dT%H:%M:%S.000000Z")
        self._open: dict[str, tuple[Any, Any]] = {}
        self._stamps: dict[str, list[int]] = {name: [] for name in self.names}

    def write(self, camera: str, picture: Picture) -> None:
        if camera not in self._open:
            self._open[camera] = self._start(camera)
        container, stream = self._open[camera]
        stamps = self._stamps[camera]
        stamps.append(picture.stamp_ns)
        frame = av.VideoFrame.from_ndarray(picture.image, format="bgr24")
        frame.time_base = Fraction(1, _TICKS)
        frame.pts = round((picture.stamp_ns - stamps[0]) * _TICKS / 1e9)
        for packet in stream.encode(frame):
            container.mux(packet)

    def _start(self, camera: str) -> tuple[Any, Any]:
        channel = self._channels[camera]
        container: Any = av.open(str(self._folder / self.names[camera]), "w")
        container.metadata["creation_time"] = self._begins
        stream: Any = container.add_stream("libx264", rate=Fraction(channel.rate_hz).limit_denominator(1000))
        stream.width, stream.height = channel.image_size
        stream.pix_fmt = "yuv420p"
        stream.time_base = Fraction(1, _TICKS)
        stream.codec_context.time_base = Fraction(1, _TICKS)
        stream.codec_context.thread_count = 1
        stream.options = {"crf": "16", "preset": "veryfast"}
        return container, stream

    def close(self) -> None:
        for camera, (container, stream) in self._open.items():
            for packet in stream.encode():
                container.mux(packet)
            container.close()
            rows = [f"{number},{stamp}" for number, stamp in enumerate(self._stamps[camera])]
            (self._folder / f"{camera}.csv").write_text("\n".join(["frame,stamp_ns", *rows]) + "\n", encoding="utf-8")
