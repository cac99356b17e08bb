"""The writer of each format."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import assert_never

import numpy as np

from workers.simulation.camera import LIDAR_FRAME
from workers.simulation.rig import START_NS, Rig
from workers.simulation.writers.files import CloudsAndImages, KittiRaw
from workers.simulation.writers.packets import Pcap, Pcapng, Vlp16Packets
from workers.simulation.writers.recording import Channel, RecordingWriter, refuse_existing
from workers.simulation.writers.ros import RosWriter
from workers.simulation.writers.trees import FolderTree, TarTree, ZipTree


def open_writer(rig: Rig, out_dir: Path) -> RecordingWriter:
    """The writer of the settings' format, for a recording of that name in ``out_dir``.

    Raises:
        FileExistsError: the recording is there already.
    """
    kind = rig.settings.format
    cameras = _channels(rig)
    match kind:
        case "bag" | "db3" | "mcap":
            bag = RosWriter(out_dir / ("recording.bag" if kind == "bag" else "recording"), kind, LIDAR_FRAME, cameras)
            if rig.settings.camera_info != "none":
                bag.write_tree(rig.tree(), START_NS)
            return bag
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
    topic = {"none": "image", "raw": "image_raw", "rectified": "image_rect_color"}[kind]
    heads = [(one.spec.name, one.info.frame_id, one.camera.image_size, hz, topic) for one in rig.cameras]
    infos = [None if kind == "none" else one.info for one in rig.cameras]
    return [Channel(*head, info) for head, info in zip(heads, infos, strict=True)]


def _sweep_seconds(rig: Rig) -> tuple[float, float]:
    return float(rig.lidar.scan_seconds(np.zeros(1))[0]), rig.lidar.seconds_per_sector()


def _captured(rig: Rig, folder: Path, cameras: Sequence[Channel]) -> RecordingWriter:
    from workers.simulation.writers.captured import CapturedRecording, JpegFiles, Videos  # loads the video library

    refuse_existing(folder)
    name = "lidar.pcapng" if rig.settings.format == "pcapng" else "lidar.pcap"
    capture = (Pcapng if rig.settings.format == "pcapng" else Pcap)(folder / name)
    beside = Videos(folder, cameras, START_NS) if rig.settings.format == "video" else JpegFiles(folder, cameras)
    return CapturedRecording(folder, name, capture, Vlp16Packets(rig.lidar), beside)
