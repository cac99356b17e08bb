"""Runs the rig: sweeps and frames in the order in which a recorder would get them, then the truth."""

from __future__ import annotations

import heapq
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import SimulationOptions
from workers.simulation.background import paint_background
from workers.simulation.bag_writer import BagWriter, CameraChannel, Picture
from workers.simulation.camera import LIDAR_FRAME
from workers.simulation.driver import urdf
from workers.simulation.render import Renderer
from workers.simulation.rig import START_NS, MountedCamera, SimulatedRig
from workers.simulation.scene import WALKER_REGION
from workers.simulation.thermal import ThermalCamera
from workers.simulation.truth import rig_document, truth_document

_SWEEP_DELAY_NS = 2_000_000  # from the last point to the recorder
_FRAME_DELAY_NS = 11_000_000  # exposure, compression, transport
_TOPICS = {"none": "image", "raw": "image_raw", "rectified": "image_rect_color"}

OnProgress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class SimulationFiles:
    """The files that were written; ``frames`` counts those of all cameras."""

    recording: Path
    truth: Path
    rig: Path
    region: Path
    sweeps: int
    frames: int
    recording_bytes: int


def simulate(options: SimulationOptions, out_dir: Path, on_progress: OnProgress | None = None) -> SimulationFiles:
    """Write the recording, ``truth.json``, ``rig.json`` and ``region.json`` into ``out_dir``.

    Beside a recording with CameraInfo stands ``vehicle.urdf``.

    Whoever needs no images takes :class:`SimulatedRig` and its ``sweeps()`` instead: painting is the slow part.

    Args:
        on_progress: called with (stage, done, total); stages are ``background`` and ``recording``.

    Raises:
        FileExistsError: ``out_dir`` holds a recording already.
    """
    out_dir.mkdir(parents=True, exist_ok=True)
    rig = SimulatedRig(options)
    with _open_writer(rig, out_dir / "recording") as writer:
        _record(rig, writer, on_progress or _silent)
    (out_dir / "truth.json").write_text(json.dumps(truth_document(rig)) + "\n", encoding="utf-8")
    rig_text = json.dumps(rig_document(rig, writer.names), indent=2) + "\n"
    (out_dir / "rig.json").write_text(rig_text, encoding="utf-8")
    (out_dir / "region.json").write_text(json.dumps(WALKER_REGION, indent=2) + "\n", encoding="utf-8")
    if options.camera_info != "none":
        (out_dir / "vehicle.urdf").write_text(urdf(rig.tree()), encoding="utf-8")
    return SimulationFiles(
        recording=writer.path,
        truth=out_dir / "truth.json",
        rig=out_dir / "rig.json",
        region=out_dir / "region.json",
        sweeps=len(rig.sweep_stamps_ns),
        frames=sum(len(mounted.stamps_ns) for mounted in rig.cameras),
        recording_bytes=_size(writer.path),
    )


def _open_writer(rig: SimulatedRig, folder: Path) -> BagWriter:
    """Raises FileExistsError where the recording is there already."""
    kind, has_info = rig.options.format, rig.options.camera_info != "none"
    cameras = [
        CameraChannel(
            camera.name,
            camera.info.frame_id,
            _TOPICS[rig.options.camera_info],
            camera.info if has_info else None,
            rig.options.images == "thermal",
        )
        for camera in rig.cameras
    ]
    writer = BagWriter(folder.with_suffix(".bag") if kind == "bag" else folder, kind, LIDAR_FRAME, cameras)
    if has_info:
        writer.write_tree(rig.tree(), START_NS)
    return writer


def _record(rig: SimulatedRig, writer: BagWriter, report: OnProgress) -> None:
    films: dict[str, Callable[[int], Picture]] = {}
    for done, mounted in enumerate(rig.cameras):
        report("background", done, len(rig.cameras))
        films[mounted.name] = film_of(rig, mounted)
    report("background", len(rig.cameras), len(rig.cameras))
    turn_ns = round(rig.lidar.seconds_per_sector() * 1e9) + _SWEEP_DELAY_NS
    events = heapq.merge(
        _events("", rig.sweep_stamps_ns, turn_ns),
        *(_events(mounted.name, mounted.times_ns, _FRAME_DELAY_NS) for mounted in rig.cameras),
    )
    total = len(rig.sweep_stamps_ns) + sum(len(mounted.times_ns) for mounted in rig.cameras)
    for done, (received_ns, camera, index) in enumerate(events, start=1):
        if camera:
            writer.write_picture(camera, films[camera](index), received_ns)
        else:
            writer.write_sweep(rig.sweep(index), received_ns)
        report("recording", done, total)


def film_of(rig: SimulatedRig, mounted: MountedCamera) -> Callable[[int], Picture]:
    """Return what paints a camera's frame of an index."""
    background = paint_background(mounted.camera, rig.scene, rig.options.seed)
    poses = rig.walk.poses((mounted.times_ns - START_NS).astype(np.float64) * 1e-9)
    stamps = mounted.stamps_ns.tolist()
    if rig.options.images == "colour":
        renderer = Renderer(mounted.camera, rig.scene, background)
        return lambda index: Picture(stamps[index], renderer.frame(poses, index))
    thermal = ThermalCamera(rig.options.seed)
    warm = Renderer(mounted.camera, rig.scene, thermal.background(background), thermal.colour)
    return lambda index: Picture(stamps[index], thermal.counts(warm.frame(poses, index), index))


def _events(camera: str, times_ns: NDArray[np.int64], delay_ns: int) -> Iterator[tuple[int, str, int]]:
    """When the recorder gets each sweep (no camera) or frame."""
    for index, at_ns in enumerate(times_ns.tolist()):
        yield at_ns + delay_ns, camera, index


def _size(path: Path) -> int:
    return sum(file.stat().st_size for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file())


def _silent(stage: str, done: int, total: int) -> None:
    """Nobody watches."""
