"""Packets that cannot be read: their maker is told by message types and datagrams, so that a refusal can name it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

# Message types of the makers' drivers that hold packets, or points that are no PointCloud2; in small letters.
_TYPES: Final = {
    "Hesai": ("pandarscan", "pandarpacket", "hesai_ros_driver/", "hesai_lidar/", "hesai_msgs/"),
    "Ouster": ("ouster_msgs/", "ouster_ros/packet", "ouster_sensor_msgs/packet"),
    "Livox": ("livox_ros_driver", "livox_interfaces/"),
    "RoboSense": ("rslidar_msg", "robosense_msgs/"),
}
# Ports as the sensors come from the factory (user manuals).
_PORTS: Final = {
    "Ouster": frozenset({7502}),
    "Livox": frozenset({56000, 56300, 56301, 57000, 65000}),
    "RoboSense": frozenset({6699}),
}
_HESAI: Final = b"\xee\xff"
_ROBOSENSE: Final = (b"\x55\xaa\x05\x0a", b"\x55\xaa\x05\x5a")

# What each maker's driver records instead, as its documentation names it.
_INSTEAD: Final = {
    "Hesai": "Play them through the maker's HesaiLidar_ROS_2.0 and record the sensor_msgs/PointCloud2 that it "
    "publishes (/lidar_points).",
    "Ouster": "An Ouster's packets are read with its metadata: put the .json that `ouster-cli source SENSOR "
    "metadata` writes and the capture into one folder or zip; in a bag, record its driver's topic `metadata` too.",
    "Livox": "Record the CustomMsg or the sensor_msgs/PointCloud2 that the maker's livox_ros_driver2 publishes "
    "(/livox/lidar).",
    "RoboSense": "Play them through the maker's rslidar_sdk (msg_source 3 for a capture, 2 for packet messages) and "
    "record the sensor_msgs/PointCloud2 that it publishes (/rslidar_points).",
}


def maker_of_topic(described: str) -> str | None:
    """The maker whose driver's packets a topic holds, from ``name (type)``; None where it is none of these."""
    kind = described.rpartition("(")[2].lower().replace("/msg/", "/")
    return next((maker for maker, parts in _TYPES.items() if any(part in kind for part in parts)), None)


def maker_of_datagram(payload: bytes, port: int) -> str | None:
    """The maker of the LiDAR that sends such a datagram to ``port``; None where it is not known."""
    if payload.startswith(_HESAI):
        return "Hesai"
    if payload.startswith(_ROBOSENSE):
        return "RoboSense"
    return next((maker for maker, ports in _PORTS.items() if port in ports and len(payload) > 1000), None)


def instead(makers: Sequence[str]) -> str:
    """Say what to record in place of these makers' packets."""
    return " ".join(_INSTEAD[maker] for maker in makers)
