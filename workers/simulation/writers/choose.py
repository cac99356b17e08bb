"""The writer of each format."""

from __future__ import annotations

from pathlib import Path
from typing import assert_never

from workers.simulation.camera import LIDAR_FRAME
from workers.simulation.rig import START_NS, SimulatedRig
from workers.simulation.writers.files import CloudsAndImages
from workers.simulation.writers.packets import Vlp16Packets
from workers.simulation.writers.recording import CameraChannel, RecordingWriter
from workers.simulation.writers.ros import RosWriter

_TOPICS = {"none": "image", "raw": "image_raw", "rectified": "image_rect_color"}


def open_writer(rig: SimulatedRig, out_dir: Path) -> RecordingWriter:
    """The writer of the options' format, for a recording of that name in ``out_dir``.

    Raises:
        FileExistsError: the recording is there already.
    """
    kind, has_info = rig.options.format, rig.options.camera_info != "none"
    cameras = [
        CameraChannel(
            camera.name,
            camera.info.frame_id,
            camera.camera.image_size,
            rig.options.camera_hz,
            _TOPICS[rig.options.camera_info],
            camera.info if has_info else None,
            rig.options.images == "thermal",
        )
        for camera in rig.cameras
    ]
    folder = out_dir / "recording"
    match kind:
        case "bag" | "db3" | "mcap":
            bag = RosWriter(folder.with_suffix(".bag") if kind == "bag" else folder, kind, LIDAR_FRAME, cameras)
            if has_info:
                bag.write_tree(rig.tree(), START_NS)
            return bag
        case "folder":
            return CloudsAndImages(folder, cameras)
        case "pcap" | "video":
            from workers.simulation.writers import captured  # loads the video library

            packets = Vlp16Packets(rig.lidar)
            if kind == "video":
                return captured.FilmedRecording(folder, packets, cameras, START_NS)
            return captured.CapturedRecording(folder, packets, cameras)
        case _:
            assert_never(kind)
