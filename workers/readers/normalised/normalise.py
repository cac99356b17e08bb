"""Turns any recording into one file per sensor and a manifest: validated, in one pass, in constant memory."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from apexcal.documents.readings import ReadOptions
from apexcal.documents.recordings import ImageSize
from workers.readers.camera_guess import Sizes
from workers.readers.choose import CameraChoice, choose_sensors
from workers.readers.detect import open_recording
from workers.readers.images.frame_sizes import FrameSize, other_size, usual_size
from workers.readers.normalised.clocks import ClockReport, Times, report_clocks
from workers.readers.normalised.manifest import RecordingManifest, SensorManifest
from workers.readers.normalised.sensor_writers import FrameWriter, SweepWriter, check_item
from workers.readers.normalised.stamps import (
    StampReport,
    overlap_warning,
    partial_ends,
    report_stamps,
    shared_time,
    sweep_warnings,
)
from workers.readers.omissions import Omissions
from workers.readers.plausibility import SweepSample, implausible, refusal
from workers.readers.progress import OnProgress, Pace
from workers.readers.recording import Frame, LidarFacts, ReadError, Recording, Sensor, Sweep, legible


class _Times:
    """Stamps and times of recording of a sensor's messages, and their numbers among those of all sensors."""

    def __init__(self) -> None:
        self.stamps, self._logs, self._numbers = array("q"), array("q"), array("q")

    def add(self, item: Sweep | Frame, number: int) -> None:
        self.stamps.append(item.stamp_ns)
        if item.log_ns is not None:
            self._logs.append(item.log_ns)
            self._numbers.append(number)

    def of_recording(self) -> Times | None:
        """Return the times of all messages, if each has a time of recording."""
        if not len(self.stamps) == len(self._logs) > 0:
            return None
        return Times(*(np.array(each, np.int64) for each in (self._numbers, self.stamps, self._logs)))


class _Lidar:
    """Writes the LiDAR's file, and collects what its manifest needs."""

    def __init__(
        self, out_dir: Path, name: str, sensor: Sensor, facts: LidarFacts, accepts_implausible: bool
    ) -> None:
        self.name = name
        self.sensor = sensor
        self.facts = facts
        self.accepts_implausible = accepts_implausible
        self.writer = SweepWriter(sensor_path(out_dir, "lidar", name), sensor, facts)
        self.times = _Times()
        self.sample = SweepSample()

    def add(self, item: Sweep | Frame) -> None:
        assert isinstance(item, Sweep)
        self.writer.add(item)
        self.sample.add(item)

    def finish(self, omissions: Omissions, clock: ClockReport | None) -> tuple[SensorManifest, list[str]]:
        facts = self.facts
        stamps = _by_one_clock(self, omissions, clock)
        omitted_ns = _omitted_by_one_clock(self, omissions, clock)
        report = report_stamps(stamps, self.name, omitted_ns, has_times=self.sensor.has_times)
        self.writer.finish(stamps, report.order)
        points = np.array(self.writer.points, np.int64)[report.order]
        rate_hz = report.facts.rate_hz
        fault = implausible(self.sample, self.sensor.name, 1.0 / rate_hz if rate_hz else None)
        if fault is not None and not self.accepts_implausible:
            raise refusal(fault)
        accepted = [] if fault is None else [f"{fault.sentence} The owner has accepted it."]
        manifest = _described(
            *(self.name, self.sensor, self.writer.path, report, clock),
            stamp_convention=facts.stamp_convention,
            time_source=facts.time_source,
            ring_count=facts.ring_count,
            points=int(np.median(points)),
            partial=partial_ends(points),
            empty=omissions.count(self.sensor.name, "cloud_empty"),
            notes=list(facts.notes),
        )
        return manifest, [*accepted, *report.warnings, *sweep_warnings(points, self.name)]


class _Camera:
    """Writes a camera's file, and collects what its manifest needs."""

    def __init__(self, out_dir: Path, name: str, sensor: Sensor, size: FrameSize | None) -> None:
        self.name = name
        self.sensor = sensor
        self.size = size
        self.writer = FrameWriter(sensor_path(out_dir, "camera", name), sensor)
        self.times = _Times()
        self.transcodings: list[str] = []

    def add(self, item: Sweep | Frame) -> None:
        assert isinstance(item, Frame)
        self.writer.add(item)
        if item.transcoding and item.transcoding not in self.transcodings:
            self.transcodings.append(item.transcoding)

    def finish(self, omissions: Omissions, clock: ClockReport | None) -> tuple[SensorManifest, list[str]]:
        stamps = _by_one_clock(self, omissions, clock)
        all_sizes = [kind[:2] for kind in self.writer.kinds]
        counts = Counter(all_sizes)
        usual = usual_size(counts, self.size)
        is_usual = np.array([size == usual for size in all_sizes])
        omitted_ns = np.concatenate([_omitted_by_one_clock(self, omissions, clock), stamps[~is_usual]])
        for i in np.flatnonzero(~is_usual).tolist():
            stamp_ns = int(stamps[i])
            omissions.add(self.sensor.name, other_size(all_sizes[i], usual, stamp_ns), stamp_ns)
        report = report_stamps(stamps[is_usual], self.name, omitted_ns, has_times=self.sensor.has_times)
        self.writer.finish(stamps, np.flatnonzero(is_usual)[report.order])
        sizes = [ImageSize(width=width, height=height, count=n) for (width, height), n in counts.most_common(100)]
        manifest = _described(
            *(self.name, self.sensor, self.writer.path, report, clock),
            transcoded=bool(self.transcodings),
            width=usual[0],
            height=usual[1],
            sizes=sizes,
            camera_info=self.sensor.camera_info,
            image_kind=self.sensor.image_kind,
            notes=list(self.transcodings),
        )
        return manifest, [*report.warnings, *_size_warnings(self.name, usual, self.sensor)]


def sensor_path(folder: Path, kind: str, name: str) -> Path:
    """Return the path of a sensor's file in the folder of a normalised recording."""
    return folder / (f"{name}.sweeps" if kind == "lidar" else f"camera-{name}.images")


def _described(
    name: str, sensor: Sensor, file: Path, report: StampReport, clock: ClockReport | None, **facts: Any
) -> SensorManifest:
    """Return a sensor's manifest with what is told of a LiDAR or of a camera alone."""
    own: dict[str, Any] = {
        "kind": sensor.kind,
        "topic": sensor.name,
        "frame_id": sensor.frame_id,
        "name": name,
        "file": file.name,
    }
    if clock is not None:
        own["jumps"] = [*clock.steps, *report.facts.jumps]
        own |= {} if clock.offset is None else clock.offset._asdict()
    return SensorManifest.model_validate(dict(report.facts) | own | facts)


def _size_warnings(name: str, size: FrameSize, sensor: Sensor) -> list[str]:
    info = sensor.camera_info or {}
    stated = (info.get("width"), info.get("height"))
    if not all(stated) or stated == size:
        return []
    return [
        f"{name}: its camera info is for {stated[0]} x {stated[1]} pixels, its frames have {size[0]} x {size[1]}; do "
        "not start from these intrinsics."
    ]


def _by_one_clock(
    sink: _Lidar | _Camera, omissions: Omissions, clock: ClockReport | None
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(N,) stamps, in recorded order, with the steps of the sensor's clock taken out."""
    if not sink.times.stamps:
        raise omissions.refusal(sink.sensor.name) or ReadError(
            "no_sweeps" if sink.sensor.kind == "lidar" else "no_frames",
            f"{sink.sensor.name} holds no messages.",
            "Record again, or choose another topic.",
        )
    stamps = np.array(sink.times.stamps, np.int64)
    return stamps if clock is None else stamps + clock.added_ns


def _omitted_by_one_clock(
    sink: _Lidar | _Camera, omissions: Omissions, clock: ClockReport | None
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(M,) stamps of what was left out while reading, with the steps of the sensor's clock taken out."""
    omitted_ns = omissions.stamps(sink.sensor.name)
    return omitted_ns if clock is None else clock.moved(omitted_ns, np.array(sink.times.stamps, np.int64))


def _clocks(sinks: Mapping[str, _Lidar | _Camera]) -> dict[str, ClockReport]:
    """Return reports, by sensor, on the clocks of sensors whose messages have a time of recording."""
    timed = {name: times for name, sink in sinks.items() if (times := sink.times.of_recording()) is not None}
    return report_clocks(timed) if "lidar" in timed else {}


def normalise(
    path: str | Path,
    out_dir: str | Path,
    *,
    lidar: str | None = None,
    cameras: CameraChoice = None,
    sizes: Sizes | None = None,
    options: ReadOptions | None = None,
    on_progress: OnProgress | None = None,
) -> RecordingManifest:
    """Write ``lidar.sweeps`` and a ``camera-<name>.images`` per camera into a folder.

    Args:
        path: the recording, a file or a folder.
        out_dir: made if it is not there. Files of the same names are overwritten. An error removes what was written.
        lidar: topic of the LiDAR; None: :func:`workers.readers.choose.choose_sensors` finds it.
        cameras, sizes: the rig's camera names with their topics, and the size of their images; see there.
        options: what the owner knows and the file does not say.
        on_progress: called about five times a second; what it raises ends the ingestion.

    Raises:
        ReadError: the recording cannot be used; the code says why.
    """
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    files: list[Path] = []
    try:
        with closing(open_recording(path, options)) as recording:
            chosen = choose_sensors(recording, lidar, cameras, sizes)
            files += [sensor_path(out, sensor.kind, name) for name, sensor in chosen.items()]
            accepts = options is not None and options.accept_implausible
            sinks = {
                name: _Lidar(out, name, sensor, recording.lidar_facts(sensor), accepts)
                if sensor.kind == "lidar"
                else _Camera(out, name, sensor, (sizes or {}).get(name))
                for name, sensor in chosen.items()
            }
            return _normalise(recording, sinks, cameras is not None, on_progress or (lambda progress: None))
    except BaseException:
        for file in files:
            file.unlink(missing_ok=True)
        raise


def _normalise(
    recording: Recording, sinks: Mapping[str, _Lidar | _Camera], are_named: bool, on_progress: OnProgress
) -> RecordingManifest:
    """Read the recording into the files of its sensors, ``sinks`` by their names.

    ``are_named``: the cameras are those of a rig, and each must serve; else those that do suffice.
    """
    by_topic = {sink.sensor.name: sink for sink in sinks.values()}
    pace = Pace(_total([sink.sensor for sink in sinks.values()]))
    try:
        done = 0
        unstorable = Omissions()
        for sensor, item in recording.messages([sink.sensor for sink in sinks.values()]):
            with unstorable.leaving_out(sensor.name):
                check_item(item, sensor.name)
                by_topic[sensor.name].add(item)
                by_topic[sensor.name].times.add(item, done)
            done += 1
            if pace.due:
                on_progress(pace.at(done, recording.share_read))
        on_progress(pace.at(done, 1.0))
        omissions = recording.omissions
        omissions.update(unstorable)
        serving = sinks if are_named else _serving(sinks)
        clocks = _clocks(serving)
        finished = [sink.finish(omissions, clocks.get(name)) for name, sink in serving.items()]
    finally:
        for sink in sinks.values():
            sink.writer.abandon()
    fixed = recording.static_transforms  # which may say something too
    warnings = [*recording.warnings, *(line for name, clock in clocks.items() for line in clock.sentences(name))]
    warnings += [sentence for _, sentences in finished for sentence in sentences]
    sensors = [manifest for manifest, _ in finished]
    span = (sensors[0].first_ns, sensors[0].last_ns)
    for number, camera in enumerate(sensors[1:], start=1):
        offset_ns = camera.offset_ns or 0
        by_lidar = (camera.first_ns - offset_ns, camera.last_ns - offset_ns)
        seconds, share = shared_time(span, by_lidar)
        sensors[number] = camera.model_copy(update={"overlap_s": seconds, "overlap_share": share})
        warnings += overlap_warning(camera.name, span, by_lidar)
    return RecordingManifest(
        format=recording.format,
        sensors=sensors,
        warnings=[legible(warning) for warning in warnings],
        static_transforms=list(fixed),
        omissions=omissions.documents({sensor.topic: sensor.count for sensor in sensors}),
    )


def _serving(sinks: Mapping[str, _Lidar | _Camera]) -> Mapping[str, _Lidar | _Camera]:
    """Leave out cameras without a usable frame, and remove their files; return all if every camera lacks one."""
    empty = {name for name, sink in sinks.items() if sink.sensor.kind == "camera" and not sink.times.stamps}
    if len(empty) == len(sinks) - 1:
        return sinks
    for name in empty:
        sinks[name].writer.abandon()
        sinks[name].writer.path.unlink()
    return {name: sink for name, sink in sinks.items() if name not in empty}


def _total(sensors: Sequence[Sensor]) -> int | None:
    counts = [sensor.count for sensor in sensors if sensor.count is not None]
    return sum(counts) if len(counts) == len(sensors) else None
