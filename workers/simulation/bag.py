"""Writes what the simulator made as a ROS 1 bag, as the drivers of such a rig would record it."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from workers.readers.recording import Frame, Sweep

# The layout of the Velodyne driver's PointXYZIRT: time is seconds after the sweep's stamp.
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")])
# (name, offset, datatype) as sensor_msgs/PointField numbers them: 4 is uint16, 7 is float32.
_FIELDS = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("ring", 16, 4), ("time", 18, 7))


class BagWriter:
    """A ROS 1 bag with one LiDAR topic (PointCloud2) and one camera topic (CompressedImage, JPEG).

    Raises:
        FileExistsError: the file is there already.
    """

    def __init__(
        self, path: Path, *, lidar_topic: str, lidar_frame: str, camera_topic: str, camera_frame: str
    ) -> None:
        if path.exists():
            raise FileExistsError(f"{path} is there already")
        self._types = get_typestore(Stores.ROS1_NOETIC)
        self._bag = Writer(path)
        self._bag.open()
        self._frames = {"lidar": lidar_frame, "camera": camera_frame}
        self._sequence = {"lidar": 0, "camera": 0}
        self._lidar = self._bag.add_connection(lidar_topic, "sensor_msgs/msg/PointCloud2", typestore=self._types)
        self._camera = self._bag.add_connection(
            camera_topic, "sensor_msgs/msg/CompressedImage", typestore=self._types
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bag.__exit__(kind, error, trace)

    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        """One PointCloud2; ``received_ns`` is when the recorder got it, as drivers send after the turn."""
        cloud = np.empty(len(sweep.xyz), POINT)
        for axis, name in enumerate("xyz"):
            cloud[name] = sweep.xyz[:, axis]
        cloud["intensity"] = sweep.intensity
        cloud["ring"] = sweep.ring
        cloud["time"] = sweep.offset_ns * 1e-9
        field = self._types.types["sensor_msgs/msg/PointField"]
        message = self._types.types["sensor_msgs/msg/PointCloud2"](
            header=self._header("lidar", sweep.stamp_ns),
            height=1,
            width=len(cloud),
            fields=[field(name=name, offset=at, datatype=kind, count=1) for name, at, kind in _FIELDS],
            is_bigendian=False,
            point_step=POINT.itemsize,
            row_step=POINT.itemsize * len(cloud),
            data=cloud.view(np.uint8),
            is_dense=True,
        )
        raw = self._types.serialize_ros1(message, "sensor_msgs/msg/PointCloud2")
        self._bag.write(self._lidar, received_ns, raw)

    def write_frame(self, frame: Frame, received_ns: int) -> None:
        """One CompressedImage with the frame's bytes as they are."""
        message = self._types.types["sensor_msgs/msg/CompressedImage"](
            header=self._header("camera", frame.stamp_ns),
            format=frame.media_type.removeprefix("image/"),
            data=np.frombuffer(frame.data, np.uint8),
        )
        raw = self._types.serialize_ros1(message, "sensor_msgs/msg/CompressedImage")
        self._bag.write(self._camera, received_ns, raw)

    def _header(self, sensor: str, stamp_ns: int) -> Any:
        sequence = self._sequence[sensor]
        self._sequence[sensor] = sequence + 1
        stamp = self._types.types["builtin_interfaces/msg/Time"](
            sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000
        )
        return self._types.types["std_msgs/msg/Header"](seq=sequence, stamp=stamp, frame_id=self._frames[sensor])
