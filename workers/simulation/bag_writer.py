"""Writes ROS 1 and ROS 2 bags (db3, mcap) with the topics and fields that a real rig's drivers use."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2

from apexcal.documents.copies import PutPose
from apexcal.geometry.se3 import SE3
from workers.readers.copying.edits import CameraEdit
from workers.readers.copying.messages import Messages
from workers.readers.recording import Sweep
from workers.readers.ros.ros_types import INFO, TRANSFORM, fixed_types
from workers.simulation.render import encode_jpeg

LIDAR_TOPIC = "/velodyne_points"
# The layout of the Velodyne driver's PointXYZIRT: time is seconds after the sweep's stamp.
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")])
# (name, offset, datatype) as sensor_msgs/PointField numbers them: 4 is uint16, 7 is float32.
_FIELDS = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("ring", 16, 4), ("time", 18, 7))
_CLOUD = "sensor_msgs/msg/PointCloud2"
_IMAGE = "sensor_msgs/msg/CompressedImage"
_DEEP_IMAGE = "sensor_msgs/msg/Image"


@dataclass(frozen=True, slots=True)
class Picture:
    """One camera frame before it is encoded.

    Attributes:
        stamp_ns: by the camera's clock, UTC nanoseconds.
        image: (height, width, 3) uint8 BGR, or (height, width) uint16 of a thermal camera.
    """

    stamp_ns: int
    image: NDArray[Any]


@dataclass(frozen=True, slots=True)
class CameraChannel:
    """A camera as a bag must know it before the first frame.

    Attributes:
        name: the rig's name for it.
        frame_id: its coordinate frame.
        topic: last word of its images' topic.
        info: the driver's CameraInfo with each image; None: nothing.
        is_deep: whether its images have 16 bits, and are not compressed.
    """

    name: str
    frame_id: str
    topic: str = "image"
    info: CameraEdit | None = None
    is_deep: bool = False


def points_of(sweep: Sweep) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """(N,) of ``POINT``."""
    cloud = np.empty(len(sweep.xyz), POINT)
    for axis, name in enumerate("xyz"):
        cloud[name] = sweep.xyz[:, axis]
    cloud["intensity"] = sweep.intensity
    cloud["ring"] = sweep.ring
    cloud["time"] = sweep.offset_ns * 1e-9
    return cloud


class BagWriter:
    """A bag with one LiDAR topic (PointCloud2) and a topic per camera (CompressedImage, JPEG; Image of 16 bits).

    It is complete when it is closed.

    Args:
        path: a file for ``bag``; a folder that does not exist for ``db3`` and ``mcap``.

    Attributes:
        names: topics of ``lidar`` and of each camera.

    Raises:
        FileExistsError: something is at ``path`` already.
    """

    def __init__(
        self, path: Path, kind: Literal["bag", "db3", "mcap"], lidar_frame: str, cameras: Sequence[CameraChannel]
    ) -> None:
        if path.exists():
            raise FileExistsError(f"{path} is there already")
        self.path = path
        kinds = {"lidar": _CLOUD, **{c.name: _DEEP_IMAGE if c.is_deep else _IMAGE for c in cameras}}
        self.names = {
            "lidar": LIDAR_TOPIC,
            **{c.name: f"/camera/{c.name}/{c.topic}{'' if c.is_deep else '/compressed'}" for c in cameras},
        }
        self._frame_ids = {"lidar": lidar_frame, **{camera.name: camera.frame_id for camera in cameras}}
        self._sequence: Counter[str] = Counter()
        self._ros1 = kind == "bag"
        self._types = fixed_types("ros1" if self._ros1 else "cdr")
        self._bag: Any = Bag1(path) if self._ros1 else Bag2(path, version=9, storage_plugin=_PLUGINS[kind])
        self._bag.open()
        self._connections = {
            name: self._bag.add_connection(topic, kinds[name], typestore=self._types)
            for name, topic in self.names.items()
        }
        serialize: Callable[[Any, str], Any] = self._types.serialize_ros1 if self._ros1 else self._types.serialize_cdr
        self._serialize = serialize
        self._messages = Messages("ros1" if self._ros1 else "cdr")
        self._infos: dict[str, tuple[Any, CameraEdit]] = {}
        for camera in cameras:
            if camera.info is not None:
                topic = f"/camera/{camera.name}/camera_info"
                self._infos[camera.name] = self._bag.add_connection(topic, INFO, typestore=self._types), camera.info

    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        """One PointCloud2. ``received_ns`` is when the recorder got it, as drivers send after the turn."""
        cloud = points_of(sweep)
        field = self._types.types["sensor_msgs/msg/PointField"]
        message = self._types.types[_CLOUD](
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
        self._bag.write(self._connections["lidar"], received_ns, self._serialize(message, _CLOUD))

    def write_tree(self, tree: Sequence[SE3], stamp_ns: int) -> None:
        """One latched message of T_parent_child on ``/tf_static``, as robot_state_publisher sends."""
        poses = [
            PutPose(
                parent=pose.to_frame,
                child=pose.from_frame,
                translation_m=pose.t.tolist(),
                quaternion_xyzw=pose.quaternion_xyzw,
                is_new=True,
            )
            for pose in tree
        ]
        latched: dict[str, Any] = {"latching": 1} if self._ros1 else {"offered_qos_profiles": [_LATCHED]}
        connection = self._bag.add_connection("/tf_static", TRANSFORM, typestore=self._types, **latched)
        self._bag.write(connection, stamp_ns, self._messages.new_poses(poses, stamp_ns))

    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        """One CompressedImage, or Image of 16 bits, and its CameraInfo."""
        header, image = self._header(camera, picture.stamp_ns), picture.image
        kind = _DEEP_IMAGE if image.dtype == np.uint16 else _IMAGE
        if kind == _DEEP_IMAGE:
            height, width = image.shape
            data = image.astype("<u2").view(np.uint8).ravel()
            size: dict[str, Any] = {"height": height, "width": width, "step": 2 * width}
            message = self._types.types[kind](header=header, encoding="mono16", is_bigendian=0, data=data, **size)
        else:
            data = np.frombuffer(encode_jpeg(image), np.uint8)
            message = self._types.types[kind](header=header, format="jpeg", data=data)
        self._bag.write(self._connections[camera], received_ns, self._serialize(message, kind))
        if camera in self._infos:
            connection, info = self._infos[camera]
            message = self._messages.new_info(info, picture.stamp_ns, self._frame_ids[camera])
            self._bag.write(connection, received_ns, message)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bag.close()

    def _header(self, sensor: str, stamp_ns: int) -> Any:
        number: dict[str, int] = {"seq": self._sequence[sensor]} if self._ros1 else {}
        self._sequence[sensor] += 1
        stamp = self._types.types["builtin_interfaces/msg/Time"](
            sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000
        )
        return self._types.types["std_msgs/msg/Header"](**number, stamp=stamp, frame_id=self._frame_ids[sensor])


_NEVER = QosTime(0, 0)
_UNSAID = (_NEVER, _NEVER, QosLiveliness.SYSTEM_DEFAULT, _NEVER, False)
_LATCHED = Qos(QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, *_UNSAID)
_PLUGINS = {"db3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}
