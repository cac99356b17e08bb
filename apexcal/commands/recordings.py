"""Recordings: ``upload``, ``reread``, ``copy``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from apexcal.client import ClientError, FailedError
from apexcal.commands.camera_files import lenses, state_lenses
from apexcal.commands.named import assignments, find_recording, find_rig, find_vehicle
from apexcal.commands.options import (
    CamerasOption,
    FleetOption,
    IntrinsicsOption,
    KeepOption,
    RecordingArgument,
    RigOption,
    TargetOption,
    VehicleOption,
)
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import check_target, usage
from apexcal.documents.readings import LidarModel
from apexcal.documents.recordings import RecordingSummary
from apexcal.transport import Document

TopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="NAME=TOPIC",
        help="Which topic, folder or file is which: lidar=/velodyne_points, or a camera's name in the rig, as "
        "front=/camera/image. Several times.",
    ),
]
StillOption = Annotated[
    bool,
    typer.Option("--still", help="Still poses, one sweep or several of each: no track, no times of single points."),
]
AcceptOption = Annotated[
    bool, typer.Option("--accept", help="The points are right, although no LiDAR seems to have measured them.")
]
LidarModelOption = Annotated[
    LidarModel | None, typer.Option(help="Sensor of a packet capture; otherwise found from its packets.")
]
RingsOption = Annotated[
    int, typer.Option(help="Number of the LiDAR's rings, if the file does not say it; 1 if it has none.", min=0)
]


def upload(
    session: Session,
    path: Annotated[Path, typer.Argument(exists=True)],
    vehicle: VehicleOption = "",
    rig: RigOption = "",
    fleet: FleetOption = "",
    name: str = "",
    marks: Annotated[int, typer.Option(min=1)] = 1,
    retain_days: Annotated[int, typer.Option(min=0)] = 0,
    topic: TopicOption = None,
    still: StillOption = False,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    intrinsics: IntrinsicsOption = None,
    accept: AcceptOption = False,
    new: Annotated[bool, typer.Option("--new")] = False,
    wait: bool = True,
) -> Reply:
    """Upload a recording. Repeat the command to continue an interrupted upload.

    Formats: ROS 1 bag; ROS 2 bag (its folder, or the bare .db3 or .mcap); MCAP of Foxglove; .pcap or .pcapng of a
    Velodyne or, with its metadata in one folder, of an Ouster; folder, .zip or .tar of clouds (PCD, PLY, KITTI .bin,
    .npy, .csv) and images, or KITTI's raw layout; video (.mp4, .avi, .mkv) as the camera beside any of these. Sources
    that belong together go into one folder. A folder is sent as a tar that is never written anywhere. A recording
    without CameraInfo takes the lens of a file in its folder or beside it: camera_info.yaml, calib_cam_to_cam.txt.

    Args:
        path: File or folder of one of the formats above.
        name: Name of the recording; otherwise the file's.
        marks: How many people mark each corner.
        retain_days: Delete it after so many days; 0 for never.
        new: Start a new upload instead of continuing an interrupted one.
        wait: Wait until it is ready.
    """
    if intrinsics and not wait:
        usage("not both: the lens of --intrinsics is stated once the recording is ready", "Leave --no-wait out")
    reading = reading_of(topic, still=still, lidar_model=lidar_model, rings=rings, accept=accept)
    on = find_vehicle(session.client, fleet, vehicle)
    with_rig = find_rig(session.client, on, rig)
    # Read before the upload too: a lens that cannot be used is said at once.
    lenses(session.client, intrinsics or [], {camera.name: camera.image_size for camera in with_rig.cameras})
    with session.progress("Uploading") as progress:
        recording = session.client.recordings.upload(
            path,
            on.id,
            with_rig.id,
            name=name or None,
            marks_per_vertex=marks,
            retain_days=retain_days or None,
            reading=reading,
            resume=not new,
            on_progress=lambda sent, size: progress(sent / size, f"{sent / 1e6:.0f} of {size / 1e6:.0f} MB"),
        )
    if not wait:
        return Reply(recording, _summary(recording))
    ready = _when_read(session, recording)
    return ready._replace(document=state_lenses(session.client, ready.document, intrinsics or [], path))


def reread(
    session: Session,
    recording: RecordingArgument,
    rig: str = "",
    topic: TopicOption = None,
    still: StillOption = False,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    accept: AcceptOption = False,
) -> Reply:
    """Read a failed recording again from its original. Options add to those given before.

    Args:
        rig: Another rig of the same vehicle, by name or id.
    """
    reading = reading_of(topic, still=still, lidar_model=lidar_model, rings=rings, accept=accept)
    recordings = session.client.recordings
    of = find_recording(session.client, recording)
    if of.state != "failed":
        raise ClientError(f"the recording {of.name!r} is {of.state}", "Only a failed recording is read again.")
    changes: dict[str, object] = {}
    if rig:
        changes["rig_id"] = str(find_rig(session.client, session.client.vehicles.get(of.vehicle_id), rig).id)
    if reading:
        changes["reading"] = merged_reading(of.reading.model_dump(mode="json", exclude_unset=True), reading)
    if changes:
        of = recordings.edit(of, **changes)
    return _when_read(session, recordings.retry(of.id))


def copy(
    session: Session,
    recording: RecordingArgument,
    output: TargetOption = None,
    camera: CamerasOption = None,
    joint: list[str] | None = None,
    for_viewers: Annotated[bool, typer.Option("--for-viewers")] = False,
    keep: KeepOption = False,
) -> Reply:
    """Copy a bag with CameraInfo and /tf_static as published. Every other message stays, byte for byte.

    With --for-viewers it writes points, frames, undistorted frames and calibrations. Any kind of recording will do.
    Without --output the service names the file.

    Args:
        joint: CAMERA=FRAME: the frame of /tf_static whose pose is replaced.
        for_viewers: Write an MCAP file for Foxglove or Lichtblick, with undistorted frames.
    """
    joints = assignments(joint, "--joint", "front=camera_link")
    if joints and for_viewers:
        usage("--joint does not go with --for-viewers: such a file replaces no pose", "Leave --joint out")
    if output:
        check_target(output, False)
    analyses, of = session.client.analyses, find_recording(session.client, recording)
    request = analyses.copy_calibrated(of.id, cameras=camera or [], joints=joints, for_viewers=for_viewers)
    view = session.wait(request, "Copying")
    facts = view.result
    assert facts is not None
    target = output or Path(facts.file_name)
    analyses.download(view, target)
    if not keep:
        analyses.delete(view.id)
    poses = ", ".join(f"{pose.child} in {pose.parent}" for pose in view.poses)
    more = f" Damaged frames, or of another size, left out: {facts.left_out}." if facts.left_out else ""
    counts = f"{facts.replaced} messages replaced, {facts.added} added, {facts.copied} as they were"
    return Reply(view, f"Wrote {target}: {counts}. Placed: {poses}.{more}")


def reading_of(
    topics: list[str] | None,
    *,
    still: bool = False,
    lidar_model: LidarModel | None = None,
    rings: int = 0,
    accept: bool = False,
) -> dict[str, Any]:
    """The ``reading`` of a recording. A topic that is no ``name=topic`` ends the command as wrong usage."""
    reading: dict[str, Any] = {"point_times": "stamp_only"} if still else {}
    reading |= {"lidar_model": lidar_model} if lidar_model else {}
    reading |= {"rings": rings} if rings else {}
    reading |= {"accept_implausible": True} if accept else {}
    cameras = assignments(topics, "--topic", "front=/camera/image or --topic lidar=/points")
    named: dict[str, Any] = {"lidar": cameras.pop("lidar")} if "lidar" in cameras else {}
    named |= {"cameras": cameras} if cameras else {}
    return reading | ({"topics": named} if named else {})


def merged_reading(before: Document, now: Document) -> Document:
    """Return the earlier statements with the new ones in their place; topics are merged by sensor."""
    topics, more = before.get("topics") or {}, now.get("topics") or {}
    cameras = (topics.get("cameras") or {}) | (more.get("cameras") or {})
    both = topics | more | ({"cameras": cameras} if cameras else {})
    return before | now | ({"topics": both} if both else {})


def candidates_of(problem: Document | None) -> str:
    """Return the topics of a refused recording, and how to say which is which; empty for any other refusal."""
    candidates = (problem or {}).get("candidates") or []
    if not candidates:
        return ""
    lines = "".join(f"\n  {each['kind']:<6}  {each['name']}{_size(each)}" for each in candidates)
    return f"\nIt holds:{lines}\nSay which is which: apexcal reread RECORDING --topic NAME={candidates[-1]['name']}"


def _size(candidate: Document) -> str:
    count, width = candidate.get("count"), candidate.get("width")
    parts = [f"{count} messages"] if count is not None else []
    parts += [f"{width} x {candidate.get('height')} pixels"] if width else []
    return f"  ({', '.join(parts)})" if parts else ""


def _when_read(session: Session, recording: RecordingSummary) -> Reply:
    """Wait until the recording is ready.

    Raises:
        FailedError: reading failed. If topics must be named, the error lists them.
    """
    try:
        with session.progress("Reading the recording") as progress:
            view = session.client.wait(recording, on_progress=progress)
    except FailedError as error:
        error.hint += candidates_of(error.problem).replace("RECORDING", str(recording.id))
        raise
    return Reply(view, _summary(view), next=f"apexcal suggest {view.id}")


def _summary(recording: RecordingSummary) -> str:
    """A recording's state in a sentence, what was left out of it, and its warnings."""
    omissions = [f"{each.sentence} {each.example}" for each in recording.facts.omissions] if recording.facts else []
    notes = "".join(f"\nNote: {note}" for note in [*omissions, *recording.warnings])
    return f"The recording {recording.name!r} is {recording.id}, {recording.state}.{notes}"
