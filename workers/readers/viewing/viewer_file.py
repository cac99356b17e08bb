"""A recording as one MCAP file for Foxglove and Lichtblick: points, frames, undistorted frames, calibrations, poses.

It is written from the normalised sensors, so any recording has one. All times are of the LiDAR's clock, because
viewers lay the newest cloud over a frame.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import cv2
import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from pydantic import TypeAdapter

from apexcal.documents.recordings import FixedFrame
from workers.readers.images.decode import decoded
from workers.readers.normalised.sensor_files import FrameFile, SweepFile
from workers.readers.output import bytes_written, create
from workers.readers.viewing.messages import (
    ENCODING,
    KINDS,
    ViewerLens,
    camera_calibration,
    compressed_image,
    descriptor_set,
    frame_transforms,
    point_cloud,
)


@dataclass(frozen=True, slots=True)
class ViewedCamera:
    """A camera of the recording as calibrated.

    Attributes:
        name: the camera's name in the rig.
        frame_id: its optical frame.
        file: its frames.
        map: an .npy file, (height, width, 2) float32: for each pixel of the undistorted image the pixel of the frame;
            it lies outside of the frame where the lens sees nothing.
        clock_offset_ns: its clock minus the LiDAR's.
        raw: the lens; None if no message can carry it.
        pinhole: that of the undistorted image.
    """

    name: str
    frame_id: str
    file: Path
    map: Path
    clock_offset_ns: int
    raw: ViewerLens | None
    pinhole: ViewerLens


FILE_NAME: Final = "recording.mcap"
_LIDAR: Final = -1
_Maps = tuple[NDArray[np.int16], NDArray[np.uint16]]


def write_viewer_file(
    lidar: Path, out_dir: Path, request: Mapping[str, Any], on_share: Callable[[float], None]
) -> dict[str, Any]:
    """Write the file into a folder. Returns its ``file`` name and how many messages were copied and added.

    ``left_out`` counts frames without an undistorted one: those that are damaged, or of another size.

    Args:
        lidar: the normalised LiDAR.
        request: ``lidar_frame``, ``cameras`` (see :class:`ViewedCamera`), ``poses`` and ``facts`` (texts).
    """
    out_dir.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        sweeps = stack.enter_context(SweepFile(lidar))
        cameras = [
            _Camera(camera, stack) for camera in TypeAdapter(list[ViewedCamera]).validate_python(request["cameras"])
        ]
        file = Writer(stack.enter_context(create(out_dir / FILE_NAME)), compression=CompressionType.ZSTD)
        file.start(library="apexcal")
        poses = [FixedFrame(**item) for item in request["poses"]]
        writer = _ViewerFile(file, sweeps, str(request["lidar_frame"]), cameras, poses)
        writer.run(on_share)
        file.add_metadata("apexcal", {str(name): str(value) for name, value in request["facts"].items()})
        file.finish()
    counts = {"copied": writer.copied, "replaced": 0, "added": writer.added, "left_out": writer.left_out}
    return {"file": FILE_NAME, **counts, "written": bytes_written()}


class _Camera:
    """A camera, its frames' bytes, and its map from the undistorted image to the frame."""

    def __init__(self, camera: ViewedCamera, stack: ExitStack) -> None:
        self.of = camera
        self.frames = stack.enter_context(FrameFile(camera.file))
        # Fixed-point coordinates of 1/32 px. From other coordinates cv2.remap computes them again for every frame.
        at = np.load(camera.map)
        self._maps = cast("_Maps", cv2.convertMaps(at[..., 0], at[..., 1], cv2.CV_16SC2))

    def stamp_ns(self, index: int) -> int:
        """A frame's time by the LiDAR's clock."""
        return max(0, int(self.frames.stamps_ns[index]) - self.of.clock_offset_ns)

    def undistorted(self, index: int, data: bytes) -> bytes | None:
        """The frame as the pinhole sees it, as JPEG; black where the lens sees nothing. None: it cannot be made."""
        width, height = (int(self.frames.entries[name][index]) for name in ("width", "height"))
        if (width, height) != (self.of.pinhole.width, self.of.pinhole.height):
            return None
        # As large as it is, also where it is taller than wide: the map is of its own pixels.
        pixels = decoded(data, colour=True, widest=max(width, height))
        if pixels is None or pixels.shape[:2] != (height, width):
            return None
        whole, parts = self._maps
        undistorted_pixels = cv2.remap(pixels, whole, parts, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return cv2.imencode(".jpg", undistorted_pixels)[1].tobytes()


class _ViewerFile:
    def __init__(
        self,
        file: Writer,
        sweeps: SweepFile,
        lidar_frame: str,
        cameras: list[_Camera],
        poses: list[FixedFrame],
    ) -> None:
        self._file, self._sweeps, self._lidar_frame = file, sweeps, lidar_frame
        self._cameras, self._poses = cameras, poses
        self.copied = self.added = self.left_out = 0
        self._schemas = {
            kind.DESCRIPTOR.name: file.register_schema(kind.DESCRIPTOR.full_name, ENCODING, descriptor_set(kind))
            for kind in KINDS
        }
        self._channels: dict[str, int] = {}
        # Lichtblick takes the first image that is listed, and its calibration from the topics beside it.
        for camera in cameras:
            for kind in ("undistorted", "raw"):
                self._add_channel(f"/{camera.of.name}/{kind}/image", "CompressedImage")
                self._add_channel(f"/{camera.of.name}/{kind}/calibration", "CameraCalibration")
        self._add_channel("/lidar", "PointCloud")
        self._add_channel("/tf", "FrameTransforms")

    def _add_channel(self, topic: str, schema: str) -> None:
        self._channels[topic] = self._file.register_channel(topic, ENCODING, self._schemas[schema])

    def run(self, on_share: Callable[[float], None]) -> None:
        """Write all messages in the order of their times."""
        total = len(self._sweeps) + sum(len(camera.frames) for camera in self._cameras)
        moments = heapq.merge(
            _moments(map(int, self._sweeps.stamps_ns), _LIDAR),
            *(
                _moments(map(camera.stamp_ns, range(len(camera.frames))), number)
                for number, camera in enumerate(self._cameras)
            ),
        )
        for done, (stamp_ns, source, index) in enumerate(moments):
            # Poses come with every sweep, so that a viewer that jumps into the file finds them.
            if done == 0 or source == _LIDAR:
                self._add("/tf", stamp_ns, frame_transforms(stamp_ns, self._poses))
            if source == _LIDAR:
                self._write_sweep(stamp_ns, index)
            else:
                self._write_frame(self._cameras[source], stamp_ns, index)
            on_share(done / total)

    def _write_sweep(self, stamp_ns: int, index: int) -> None:
        self._write("/lidar", stamp_ns, point_cloud(self._sweeps.sweep(index), self._lidar_frame))
        self.copied += 1

    def _write_frame(self, camera: _Camera, stamp_ns: int, index: int) -> None:
        of = camera.of
        data = camera.frames.data(index)
        image = compressed_image(stamp_ns, of.frame_id, camera.frames.media_type(index), data)
        self._write(f"/{of.name}/raw/image", stamp_ns, image)
        self.copied += 1
        if of.raw is not None:
            self._add(f"/{of.name}/raw/calibration", stamp_ns, camera_calibration(stamp_ns, of.frame_id, of.raw))
        undistorted = camera.undistorted(index, data)
        if undistorted is None:
            self.left_out += 1
            return
        image = compressed_image(stamp_ns, of.frame_id, "image/jpeg", undistorted)
        self._add(f"/{of.name}/undistorted/image", stamp_ns, image)
        calibration = camera_calibration(stamp_ns, of.frame_id, of.pinhole)
        self._add(f"/{of.name}/undistorted/calibration", stamp_ns, calibration)

    def _add(self, topic: str, stamp_ns: int, message: bytes) -> None:
        self._write(topic, stamp_ns, message)
        self.added += 1

    def _write(self, topic: str, stamp_ns: int, message: bytes) -> None:
        self._file.add_message(self._channels[topic], stamp_ns, message, stamp_ns)


def _moments(stamps_ns: Iterable[int], source: int) -> Iterator[tuple[int, int, int]]:
    """Time, source and number of each message of one sensor, whose times ascend."""
    return ((stamp_ns, source, index) for index, stamp_ns in enumerate(stamps_ns))
