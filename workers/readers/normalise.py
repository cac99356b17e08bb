"""Any recording into one MCAP file per sensor, with a manifest: validated, in one pass, in constant memory."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from pathlib import Path

import numpy as np

from workers.readers.choose import CameraChoice, choose_sensors
from workers.readers.detect import open_recording
from workers.readers.manifest import FrameTable, Manifest, SensorManifest, SweepTable, write_table
from workers.readers.mcap_files import CameraWriter, LidarWriter
from workers.readers.recording import Frame, LidarFacts, ReadError, ReadOptions, Recording, Sensor, Sweep
from workers.readers.stamps import overlap, partial_sweeps, report_stamps

# (messages done, messages in all where the format tells)
OnProgress = Callable[[int, int | None], None]


class _Lidar:
    """The LiDAR's file while it is written, and what is noted on the way."""

    def __init__(self, out_dir: Path, sensor: Sensor, facts: LidarFacts) -> None:
        self.sensor = sensor
        self.facts = facts
        self.writer = LidarWriter(out_dir / "lidar.mcap", sensor.name, sensor.frame_id)
        self.stamps = array("q")
        self.points = array("q")

    def add(self, item: Sweep | Frame) -> None:
        assert isinstance(item, Sweep)
        self.writer.add(item)
        self.stamps.append(item.stamp_ns)
        self.points.append(len(item.xyz))

    def finish(self, out_dir: Path) -> tuple[SensorManifest, list[str]]:
        facts = self.facts
        self.writer.finish(
            time_source=facts.time_source,
            stamp_convention=facts.stamp_convention,
            ring_count=facts.ring_count,
            sweep_ns=facts.sweep_ns,
        )
        stamps = _stamps(self.stamps, self.sensor)
        report = report_stamps(stamps, "lidar")
        points = np.array(self.points, np.int64)[report.order]
        write_table(out_dir / "lidar.sweeps.json", SweepTable(stamps[report.order].tolist(), points.tolist()))
        manifest = SensorManifest(
            kind="lidar",
            name="lidar",
            topic=self.sensor.name,
            frame_id=self.sensor.frame_id,
            file="lidar.mcap",
            frames="lidar.sweeps.json",
            count=len(stamps),
            first_ns=report.first_ns,
            last_ns=report.last_ns,
            rate_hz=report.rate_hz,
            gaps=report.gaps,
            gap_count=report.gap_count,
            stamp_convention=facts.stamp_convention,
            time_source=facts.time_source,
            ring_count=facts.ring_count,
            notes=list(facts.notes),
        )
        return manifest, [*report.warnings, *partial_sweeps(points, "lidar")]


class _Camera:
    """A camera's file while it is written, and what is noted on the way."""

    def __init__(self, out_dir: Path, name: str, sensor: Sensor) -> None:
        self.name = name
        self.sensor = sensor
        self.writer = CameraWriter(out_dir / f"camera-{name}.mcap", sensor.name, sensor.frame_id)
        self.stamps = array("q")
        self.widths = array("i")
        self.heights = array("i")
        self.types = bytearray()
        self.known_types: list[str] = []
        self.transcoded = 0

    def add(self, item: Sweep | Frame) -> None:
        assert isinstance(item, Frame)
        self.writer.add(item)
        self.stamps.append(item.stamp_ns)
        self.widths.append(item.width)
        self.heights.append(item.height)
        if item.media_type not in self.known_types:
            self.known_types.append(item.media_type)
        self.types.append(self.known_types.index(item.media_type))
        self.transcoded += item.transcoded

    def finish(self, out_dir: Path) -> tuple[SensorManifest, list[str]]:
        offsets = self.writer.finish()
        stamps = _stamps(self.stamps, self.sensor)
        report = report_stamps(stamps, self.name)
        order: list[int] = report.order.tolist()
        table = FrameTable(
            stamp_ns=stamps[report.order].tolist(),
            offset=[offsets[i] for i in order],
            length=[self.writer.lengths[i] for i in order],
            media_type=[self.known_types[self.types[i]] for i in order],
            width=[self.widths[i] for i in order],
            height=[self.heights[i] for i in order],
        )
        write_table(out_dir / f"camera-{self.name}.frames.json", table)
        warnings = list(report.warnings)
        sizes = sorted(set(zip(self.widths, self.heights, strict=True)))
        if len(sizes) > 1:
            listed = ", ".join(f"{w} x {h}" for w, h in sizes[:5])
            warnings.append(f"{self.name}: frames differ in size ({listed}); one calibration fits one size only.")
        manifest = SensorManifest(
            kind="camera",
            name=self.name,
            topic=self.sensor.name,
            frame_id=self.sensor.frame_id,
            file=self.writer.path.name,
            frames=f"camera-{self.name}.frames.json",
            count=len(stamps),
            first_ns=report.first_ns,
            last_ns=report.last_ns,
            rate_hz=report.rate_hz,
            gaps=report.gaps,
            gap_count=report.gap_count,
            transcoded=self.transcoded > 0,
            width=table.width[0],
            height=table.height[0],
            notes=["Raw frames were encoded as PNG, without loss."] if self.transcoded else [],
        )
        return manifest, warnings


def _stamps(stamps: array[int], sensor: Sensor) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    if not stamps:
        raise ReadError(
            "no_sweeps" if sensor.kind == "lidar" else "no_frames",
            f"{sensor.name} holds no messages.",
            "Record again, or choose another topic.",
        )
    return np.array(stamps, np.int64)


def normalise(
    path: str | Path,
    out_dir: str | Path,
    *,
    lidar: str | None = None,
    cameras: CameraChoice = None,
    options: ReadOptions | None = None,
    on_progress: OnProgress | None = None,
) -> Manifest:
    """Write ``lidar.mcap``, a ``camera-<name>.mcap`` per camera, and their tables into a folder.

    Args:
        path: the recording, a file or a folder.
        out_dir: made if it is not there; files of the same names are overwritten. After an error what was written
            is removed.
        lidar: topic of the LiDAR; None: the only one.
        cameras: the rig's camera names with their topics; see :func:`workers.readers.choose.choose_sensors`.
        options: what the owner knows and the file does not say.
        on_progress: called after every message; what it raises ends the ingestion.

    Raises:
        ReadError: the recording cannot be used; the code says why.
    """
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    recording = open_recording(path, options)
    written: list[Path] = []
    try:
        return _normalise(recording, out, lidar, cameras, on_progress or (lambda done, total: None), written)
    except BaseException:
        for file in written:
            file.unlink(missing_ok=True)
        raise
    finally:
        recording.close()


def _normalise(
    recording: Recording,
    out: Path,
    lidar: str | None,
    cameras: CameraChoice,
    on_progress: OnProgress,
    written: list[Path],
) -> Manifest:
    chosen = choose_sensors(recording, lidar, cameras)
    facts = recording.lidar_facts(chosen["lidar"])
    sinks: dict[str, _Lidar | _Camera] = {}
    total = _total(chosen)
    try:
        for name, sensor in chosen.items():
            stem = "lidar" if name == "lidar" else f"camera-{name}"
            table = "sweeps" if name == "lidar" else "frames"
            written += [out / f"{stem}.mcap", out / f"{stem}.{table}.json"]
            sinks[sensor.name] = _Lidar(out, sensor, facts) if name == "lidar" else _Camera(out, name, sensor)
        for done, (sensor, item) in enumerate(recording.messages(list(chosen.values())), start=1):
            sinks[sensor.name].add(item)
            on_progress(done, total)
        finished = [sink.finish(out) for sink in sinks.values()]
    finally:
        for sink in sinks.values():
            sink.writer.abandon()
    sensors = [manifest for manifest, _ in finished]
    warnings = [*recording.warnings, *(said for _, sentences in finished for said in sentences)]
    warnings += overlap([(s.name, s.first_ns, s.last_ns) for s in sensors])
    return Manifest(recording.format, sensors, warnings)


def _total(chosen: dict[str, Sensor]) -> int | None:
    counts = [sensor.count for sensor in chosen.values() if sensor.count is not None]
    return sum(counts) if len(counts) == len(chosen) else None
