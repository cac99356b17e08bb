"""The writer of each format."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import assert_never

import numpy as np

from workers.geometry.transforms import RigidTransform
from workers.simulation.camera import LIDAR_FRAME, camera_frame, nominal_mount
from workers.simulation.driver import frame_tree
from workers.simulation.rig import START_NS, Rig
from workers.simulation.settings import CameraInfos
from workers.simulation.writers.files import CloudsAndImages, KittiRaw
from workers.simulation.writers.packets import Pcap, Pcapng, Vlp16Packets
from workers.simulation.writers.recording import Channel, RecordingWriter, refuse_existing
from workers.simulation.writers.ros import RosWriter
from workers.simulation.writers.trees import FolderTree, TarTree, ZipTree

_TOPICS: dict[CameraInfos, str] = {"none": "image", "raw": "image_raw", "rectified": "image_rect_color"}


def open_writer(rig: Rig, out_dir: Path) -> RecordingWriter:
    """The writer of the settings' format, for a recording of that name in ``out_dir``.

    Raises:
        FileExistsError: the recording is there already.
    """
    kind = rig.settings.format
    cameras = _channels(rig)
    match kind:
        case "bag":
            return RosWriter(out_dir / "recording.bag", kind, LIDAR_FRAME, cameras, vehicle_tree(rig), START_NS)
        case "db3" | "mcap":
            return RosWriter(out_dir / "recording", kind, LIDAR_FRAME, cameras, vehicle_tree(rig), START_NS)
        case "folder":
            return CloudsAndImages(FolderTree(out_dir / "recording"), cameras)
        case "tar":
            return CloudsAndImages(TarTree(out_dir / "recording.tar"), cameras)
        case "zip":
            return CloudsAndImages(ZipTree(out_dir / "recording.zip"), cameras)
        case "kitti":
            ahead_ns, turn_ns = (round(seconds * 1e9) for seconds in _sweep_seconds(rig))
            return KittiRaw(FolderTree(out_dir / "recording"), cameras, START_NS, ahead_ns, turn_ns)
        case "pcap" | "pcapng" | "video":
            return _captured(rig, out_dir / "recording", cameras)
        case _:
            assert_never(kind)


def _channels(rig: Rig) -> list[Channel]:
    hz, kind = rig.settings.camera_hz, rig.settings.camera_info
    return [
        Channel(
            *(one.spec.name, camera_frame(one.spec.name), one.camera.image_size, hz, _TOPICS[kind]),
            None if kind == "none" else one.info,
        )
        for one in rig.cameras
    ]


def vehicle_tree(rig: Rig) -> list[RigidTransform]:
    """The tree of frames that the vehicle states beside a CameraInfo; empty without one."""
    if rig.settings.camera_info == "none":
        return []
    down, is_true = rig.settings.pitch_down_deg, rig.settings.tree == "true"
    mounts = (
        (one.spec.name, one.own.T_camera_lidar if is_true else nominal_mount(one.spec.name, one.spec.yaw_deg, down))
        for one in rig.cameras
    )
    return frame_tree(rig.scene.ground_z, list(mounts))


def _sweep_seconds(rig: Rig) -> tuple[float, float]:
    return float(rig.lidar.scan_seconds(np.zeros(1))[0]), rig.lidar.seconds_per_sector()


def _captured(rig: Rig, folder: Path, cameras: Sequence[Channel]) -> RecordingWriter:
    from workers.simulation.writers.captured import CapturedRecording, JpegFiles, Videos  # loads the video library

    refuse_existing(folder)
    name = "lidar.pcapng" if rig.settings.format == "pcapng" else "lidar.pcap"
    capture = (Pcapng if rig.settings.format == "pcapng" else Pcap)(folder / name)
    beside = Videos(folder, cameras, START_NS) if rig.settings.format == "video" else JpegFiles(folder, cameras)
    return CapturedRecording(folder, name, capture, Vlp16Packets(rig.lidar), beside)
