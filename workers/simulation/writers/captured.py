"""A capture of the LiDAR's packets with the cameras beside it: as JPEG files, or as a video each."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

from workers.readers.recording import Sweep
from workers.simulation.render import encode_jpeg
from workers.simulation.writers.files import StampedFiles
from workers.simulation.writers.packets import Pcap, Vlp16Packets, ethernet
from workers.simulation.writers.recording import CameraChannel, Picture, RecordingWriter

_TICKS = 90_000  # of a video's clock, per second
_CAPTURE = "lidar.pcap"


class CapturedRecording(RecordingWriter):
    """A folder with ``lidar.pcap``, and the cameras' images as ``images/<camera>/<number>.jpg``."""

    def __init__(self, folder: Path, packets: Vlp16Packets, cameras: Sequence[CameraChannel]) -> None:
        super().__init__(folder)
        folder.mkdir(parents=True)
        self.names = {"lidar": _CAPTURE, **{camera.name: f"images/{camera.name}" for camera in cameras}}
        self._capture = Pcap(folder / _CAPTURE)
        self._packets = packets
        self._images = StampedFiles(folder)

    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        """The packets of a turn."""
        for at_ns, payload in self._packets.of(sweep):
            self._capture.add(at_ns, ethernet(payload))

    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        """One JPEG file."""
        self._images.add(self.names[camera], "jpg", encode_jpeg(picture.image), picture.stamp_ns)

    def close(self) -> None:
        """Close the capture, and write the images' stamps."""
        self._capture.close()
        self._images.close()


class FilmedRecording(CapturedRecording):
    """``lidar.pcap``, and of each camera ``<camera>.mp4`` (H.264, variable time stamps) and ``<camera>.csv``.

    The table has each frame's stamp.
    """

    def __init__(self, folder: Path, packets: Vlp16Packets, cameras: Sequence[CameraChannel], start_ns: int) -> None:
        super().__init__(folder, packets, cameras)
        self.names |= {camera.name: f"{camera.name}.mp4" for camera in cameras}
        begins = datetime.fromtimestamp(start_ns // 1_000_000_000, UTC).strftime("%Y-%m-%dT%H:%M:%S.000000Z")
        self._videos = {camera.name: self._open(camera, begins) for camera in cameras}
        self._stamps: dict[str, list[int]] = {camera.name: [] for camera in cameras}

    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        """One frame."""
        container, stream = self._videos[camera]
        stamps = self._stamps[camera]
        stamps.append(picture.stamp_ns)
        frame = av.VideoFrame.from_ndarray(picture.image, format="bgr24")
        frame.time_base = Fraction(1, _TICKS)
        frame.pts = round((picture.stamp_ns - stamps[0]) * _TICKS / 1e9)
        for packet in stream.encode(frame):
            container.mux(packet)

    def _open(self, camera: CameraChannel, begins: str) -> tuple[Any, Any]:
        container: Any = av.open(str(self.path / self.names[camera.name]), "w")
        container.metadata["creation_time"] = begins
        stream: Any = container.add_stream("libx264", rate=Fraction(camera.rate_hz).limit_denominator(1000))
        stream.width, stream.height = camera.image_size
        stream.pix_fmt = "yuv420p"
        stream.time_base = Fraction(1, _TICKS)
        stream.codec_context.time_base = Fraction(1, _TICKS)
        stream.codec_context.thread_count = 1
        stream.options = {"crf": "16", "preset": "veryfast"}
        return container, stream

    def close(self) -> None:
        """Close the capture and the videos, and write their stamps."""
        self._capture.close()
        for camera, (container, stream) in self._videos.items():
            for packet in stream.encode():
                container.mux(packet)
            container.close()
            rows = [f"{number},{stamp}" for number, stamp in enumerate(self._stamps[camera])]
            (self.path / f"{camera}.csv").write_text("\n".join(["frame,stamp_ns", *rows]) + "\n", encoding="utf-8")
