"""Inspect what a recording holds and lacks, by its index and a few messages. Sensors are chosen as for ingestion."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.bounds import preset_bounds
from apexcal.documents.inspections import InspectedSensor, Inspection, RecordingFault
from apexcal.documents.pairs import REACH_NS
from apexcal.documents.readings import ReadOptions
from apexcal.documents.recordings import FixedFrame, StatedLens
from apexcal.documents.rig_proposals import RigAnswers, RigProposal
from apexcal.geometry.frame_tree import FrameTree, recorded_tree, urdf_tree
from apexcal.geometry.rig_proposal import RecordedSensor, propose_rig
from workers.readers.choose import CameraChoice, choose_sensors
from workers.readers.clouds.ring_spread import RINGLESS
from workers.readers.detect import open_recording
from workers.readers.first_look import FirstLook, look_at
from workers.readers.normalised.clocks import ClockReport, offset_sentence
from workers.readers.normalised.stamps import overlap_warning, report_stamps, shared_time
from workers.readers.recording import ReadError, Recording, Sensor, legible

# A fit needs marks in six places that are 1.5 m apart (`workers/judge/pair_checks.py`). A slow walk is 1 m/s.
_FEWEST_PLACES: Final = 6
_SHORTEST_S: Final = _FEWEST_PLACES * 1.5
# Still poses are recorded at less than this, each a message or a burst.
_POSES_HZ: Final = 1.0
# A walker's motion is known from pairs within half a second; a longer pause leaves vertices without it. A slow sensor
# may miss a message.
_PAUSE_STEPS: Final = 3.0


def inspect_recording(
    path: Path,
    lidar: str | None = None,
    cameras: CameraChoice = None,
    options: ReadOptions | None = None,
    answers: RigAnswers | None = None,
    urdf: bytes | None = None,
    transforms: Sequence[FixedFrame] | None = None,
) -> Inspection:
    """Inspect a file or folder. ``lidar``, ``cameras``: their topics, as :func:`choose_sensors` takes them.

    ``answers``, ``urdf``: what a person and the vehicle's URDF say of its rig. ``transforms``: instead of those that
    the recording states.

    Raises:
        ReadError: it is no recording, is damaged, or its LiDAR or cameras are not clear.
        InputError: the URDF cannot be used, or an answer is about no sensor.
    """
    with closing(open_recording(path, options)) as recording:
        chosen = choose_sensors(recording, lidar, cameras)
        notes = recording.warnings  # of its files; of what is read, ingestion counts all
        look = look_at(recording, chosen, are_named=cameras is not None)
        chosen = look.sensors
        times = look.times
        sensors = [_inspected(name, sensor, look) for name, sensor in chosen.items()]
        transforms = recording.static_transforms if transforms is None else transforms
        proposal = _proposal(chosen, transforms, answers or RigAnswers.model_validate({}), urdf)
        options = options or ReadOptions()
        is_still = options.point_times == "stamp_only"
        faults = [
            *_doubts(look.doubt, is_accepted=options.accept_implausible),
            *(_stop(error.code, name, error.message, error.hint) for name, error in look.refusals.items()),
            *(fault for name, sensor in chosen.items() if sensor.kind == "camera" for fault in _lens(name, sensor)),
            *(fault for name, clock in look.clocks.items() for fault in _clock_faults(name, clock)),
            *_time_faults(sensors, times),
            *_ring_faults(recording, chosen["lidar"], look.refusals, is_still=is_still),
            *_length_faults(sensors, is_still=is_still),
            *_frame_faults(sensors, transforms, proposal),
        ]
        notes += [note for note in recording.lidar_facts(chosen["lidar"]).notes if RINGLESS not in note]
    lidar_stops = any(fault.verdict == "stop" and fault.sensor in ("", "lidar") for fault in faults)
    stopped = {fault.sensor for fault in faults if fault.verdict == "stop"}
    names = [name for name in chosen if name != "lidar"]
    return Inspection(
        format=recording.format,
        seconds=(max(each.last_ns for each in sensors) - min(each.first_ns for each in sensors)) / 1e9,
        sensors=sensors,
        other_topics=list(recording.other_topics),
        is_connected=not any(fault.code == "frames_not_connected" for fault in faults) if transforms else None,
        faults=faults,
        omissions=look.omissions,
        notes=[legible(note) for note in notes],
        calibratable=[] if lidar_stops else [name for name in names if name not in stopped],
        proposal=proposal,
    )


def static_transforms_of(path: Path) -> Sequence[FixedFrame]:
    """The fixed transforms of a recording. Raises ReadError ``no_static_transforms`` if there are none."""
    with closing(open_recording(path)) as recording:
        transforms = recording.static_transforms
    if not transforms:
        hint = "Record /tf_static or /robot_description, or give a URDF."
        raise ReadError("no_static_transforms", f"{path.name} states no fixed transforms.", hint)
    return transforms


def _proposal(
    chosen: Mapping[str, Sensor],
    transforms: Sequence[FixedFrame],
    answers: RigAnswers,
    urdf: bytes | None,
) -> RigProposal | None:
    """Propose the rig of these sensors; None without cameras."""
    trees: dict[str, FrameTree] = {} if urdf is None else {"the URDF": urdf_tree(urdf)}
    if transforms:
        trees["the recording"] = recorded_tree(each.model_dump() for each in transforms)
    sensors = [
        RecordedSensor(
            name,
            sensor.name,
            sensor.frame_id,
            sensor.image_size,
            sensor.image_kind,
            (sensor.camera_info or {}).get("R"),
        )
        for name, sensor in chosen.items()
    ]
    return propose_rig(sensors, trees, answers) if len(sensors) > 1 else None


def _doubts(doubt: RecordingFault | None, *, is_accepted: bool) -> list[RecordingFault]:
    """Return a doubt about the points as a note. It stops a recording unless the owner accepts the points."""
    if doubt is None:
        return []
    return [_look(doubt.code, doubt.sensor, doubt.sentence, "You accepted it.") if is_accepted else doubt]


def _look(code: str, sensor: str, sentence: str, remedy: str) -> RecordingFault:
    return RecordingFault(code=code, sensor=sensor, verdict="look", sentence=sentence, remedy=remedy)


def _stop(code: str, sensor: str, sentence: str, remedy: str) -> RecordingFault:
    return RecordingFault(code=code, sensor=sensor, verdict="stop", sentence=sentence, remedy=remedy)


def _clock_faults(name: str, clock: ClockReport) -> Iterator[RecordingFault]:
    """Return the faults of a sensor's clock. Pairs can be made all the same."""
    for sentence in clock.step_sentences:
        remedy = "Let all clocks be set before you record: NTP and PTP step a clock when they first reach its server."
        yield _look("clock_steps", name, sentence, remedy)
    if clock.offset is not None:
        remedy = (
            "`apexcal solve` asks, then pairs with this offset. To `apexcal detect` say "
            f"`--offset-ms {clock.offset_ns / 1e6:.0f}`. Marks of a walk measure it "
            "(`apexcal clock-offset`). Synchronise the clocks (PTP, or stamps of one host) to need none."
        )
        yield _look("clocks_apart", name, offset_sentence(name, clock.offset), remedy)


def _inspected(name: str, sensor: Sensor, look: FirstLook) -> InspectedSensor:
    times, clock = look.times[name], look.clocks.get(name)
    offset = clock.offset if clock else None
    if not len(times):
        raise ReadError("sensor_without_messages", f"{sensor.name} holds no message.", "Was the sensor switched on?")
    report = report_stamps(times, name, has_times=sensor.has_times)
    return InspectedSensor(
        kind=sensor.kind,
        name=name,
        topic=sensor.name,
        frame_id=sensor.frame_id,
        count=len(times),
        first_ns=report.facts.first_ns,
        last_ns=report.facts.last_ns,
        rate_hz=report.facts.rate_hz,
        longest_pause_s=float(np.max(np.diff(times), initial=0)) / 1e9 if sensor.has_times else None,
        delay_s=look.delays.get(name),
        offset_ns=offset and offset.offset_ns,
        spread_ns=offset and offset.spread_ns,
        image_size=sensor.image_size,
        image_kind=sensor.image_kind,
        lens=StatedLens.model_validate(sensor.camera_info) if sensor.camera_info else None,
    )


def _lens(name: str, sensor: Sensor) -> list[RecordingFault]:
    """Return the faults of a camera's stated lens. A result needs none."""
    advice = (
        "State the lens (--intrinsics FILE, or a camera_info.yaml in the folder or beside the bag), or record the "
        "CameraInfo. Without either it is fitted: fill the image with marks, to its corners."
    )
    stated, size = sensor.camera_info, sensor.image_size
    if stated is None and sensor.notes.get("camera_info") == "unusable":
        sentence = f"The CameraInfo of {name} states no lens: its K is 0 or the identity, or holds what is no number."
        return [_look("lens_not_stated", name, sentence, advice)]
    if stated is None:
        return [_look("no_camera_info", name, f"No CameraInfo was recorded for {name}.", advice)]
    if size and (stated["width"], stated["height"]) != size:
        sentence = (
            f"The images of {name} have {size[0]} x {size[1]} pixels; its CameraInfo is of {stated['width']} x "
            f"{stated['height']}."
        )
        remedy = "Record the full images, or their own CameraInfo: a lens holds for images of one size."
        return [_stop("image_size_differs", name, sentence, remedy)]
    if stated["model"] is None:
        sentence = (
            f"The CameraInfo of {name} states a lens that is not used: no model here is "
            f"{stated['distortion_model']!r} with {len(stated['D'])} coefficients."
        )
        return [_look("lens_not_used", name, sentence, advice)]
    K = stated["K"]
    bounds = preset_bounds(
        "image-size", "pinhole", "rotation_vector", size or (stated["width"], stated["height"]), (0.0, 0.0, 0.0)
    )
    values = {"f_x": K[0], "f_y": K[4], "c_x": K[2], "c_y": K[5]}
    odd = [f"{word} = {value:g}" for word, value in values.items() if not bounds[word][0] <= value <= bounds[word][1]]
    if odd:
        sentence = f"The CameraInfo of {name} states {', '.join(odd)} px, which no lens of such images has."
        return [_look("lens_not_plausible", name, sentence, advice)]
    return []


def _time_faults(
    sensors: Sequence[InspectedSensor], times: Mapping[str, NDArray[np.int64]]
) -> Iterator[RecordingFault]:
    lidar, *cameras = sensors
    for camera in cameras:
        spans = (lidar.first_ns, lidar.last_ns), (camera.first_ns, camera.last_ns)
        seconds, _ = shared_time(*spans)
        yield from _pauses(camera, lidar, times)
        if sentences := overlap_warning(camera.name, *spans):
            remedy = "Record both at the same time, from before the walk to after it."
            fault = _stop if seconds == 0.0 else _look
            yield fault("no_overlap" if seconds == 0.0 else "little_overlap", camera.name, sentences[0], remedy)
    for camera in cameras[:1]:
        yield from _pauses(lidar, camera, times)


def _ring_faults(
    recording: Recording, lidar: Sensor, refusals: Collection[str], *, is_still: bool
) -> Iterator[RecordingFault]:
    if "lidar" not in refusals and not is_still and recording.lidar_facts(lidar).ring_count == 1:
        yield _look("no_rings", "lidar", f"{lidar.name} has no rings.", RINGLESS)


def _length_faults(sensors: Sequence[InspectedSensor], *, is_still: bool) -> Iterator[RecordingFault]:
    lidar, *cameras = sensors
    if not cameras:
        remedy = "Record the cameras together with the LiDAR, or put their images into one folder with its clouds."
        yield _stop("no_camera", "", "The recording holds no images.", remedy)
    for sensor in sensors:
        if sensor.count < _FEWEST_PLACES:
            sentence = f"{sensor.name} has {sensor.count} messages; a fit needs marks in {_FEWEST_PLACES} places."
            remedy = "Walk with the board for two minutes, or record twenty still poses."
            yield _stop("too_few", sensor.name, sentence, remedy)
    seconds = [(each.last_ns - each.first_ns) / 1e9 for each in sensors]
    longest_s = max((min(seconds[0], each) for each in seconds[1:]), default=0.0)
    is_walk = not is_still and lidar.count >= _FEWEST_PLACES and (lidar.rate_hz or 0.0) > _POSES_HZ
    if is_walk and 0.0 < longest_s < _SHORTEST_S:
        sentence = f"LiDAR and cameras were recorded for {longest_s:.1f} s only."
        remedy = (
            "Does the board stand still in every sweep? Then say --still, here and to `apexcal upload`. If not, walk "
            "with the board for two minutes, slowly, everywhere in view."
        )
        yield _look("too_short", "", sentence, remedy)


def _pauses(
    sensor: InspectedSensor, other: InspectedSensor, times: Mapping[str, NDArray[np.int64]]
) -> Iterator[RecordingFault]:
    """A pause of one sensor while the other one was recorded. A recorder that pauses both loses no pair."""
    if sensor.longest_pause_s is None:
        return
    own, others = times[sensor.name], times[other.name]
    step_ns = float(np.median(np.diff(own))) if len(own) > 1 else 0.0
    least_ns = max(float(REACH_NS), _PAUSE_STEPS * step_ns)
    pauses = [(after, end) for after, end in pairwise(own.tolist()) if end - after > least_ns]
    lost = [(after, end) for after, end in pauses if np.count_nonzero((others > after) & (others < end)) > 2]
    if lost:
        after, end = max(lost, key=lambda pause: pause[1] - pause[0])
        more = f", and {len(lost) - 1} times more" if len(lost) > 1 else ""
        begin_s = (after - sensor.first_ns) / 1e9
        sentence = f"{sensor.name} pauses for {(end - after) / 1e9:.1f} s after {begin_s:.1f} s{more}."
        remedy = "Look at the network and the disk of the recorder; nothing can be paired in a pause."
        yield _look("gap", sensor.name, sentence, remedy)


def _frame_faults(
    sensors: Sequence[InspectedSensor], transforms: Sequence[FixedFrame], proposal: RigProposal | None
) -> Iterator[RecordingFault]:
    """Cameras that ``/tf_static`` does not connect with the LiDAR, if it states frames and nothing else does."""
    lidar, *cameras = sensors
    parents = {each.child: each.parent for each in transforms}
    open_sensors = {question.sensor for question in proposal.questions} if proposal else set[str]()
    for camera in cameras if parents else ():
        if open_sensors & {"lidar", camera.name} and _root(parents, lidar.frame_id) != _root(
            parents, camera.frame_id
        ):
            ends = f"{lidar.frame_id or 'the LiDAR'} to {camera.frame_id or camera.name}"
            remedy = "Give the rig's mount by hand, or record the tree that joins both frames."
            yield _look("frames_not_connected", camera.name, f"/tf_static does not lead from {ends}.", remedy)


def _root(parents: Mapping[str, str], frame: str) -> str:
    frame = frame.removeprefix("/")
    visited: set[str] = set()
    while frame in parents and frame not in visited:
        visited.add(frame)
        frame = parents[frame]
    return frame
