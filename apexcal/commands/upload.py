"""``apexcal upload``: uploads a recording and waits until it is ready."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from apexcal.client import Client, FailedError
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say
from apexcal.commands.connect import connected, find_rig, find_vehicle
from apexcal.commands.reading import (
    LidarModelOption,
    RingsOption,
    StillOption,
    TopicOption,
    reading_of,
    which_is_which,
)
from apexcal.documents.fleets import RigOut, VehicleOut
from apexcal.documents.recordings import RecordingSummary, RecordingView
from apexcal.embedded.folder import DEFAULT


def upload(
    path: Annotated[Path, typer.Argument(help="File or folder of one of the formats above.", exists=True)],
    vehicle: Annotated[str, typer.Option(help="Vehicle, by name or id; needed where there are several.")] = "",
    rig: Annotated[str, typer.Option(help="Rig, by name or id; needed where there are several.")] = "",
    fleet: Annotated[str, typer.Option(help="Fleet, by name or id.")] = "",
    name: Annotated[str, typer.Option(help="Name of the recording; otherwise the file's.")] = "",
    marks: Annotated[int, typer.Option(help="How many people mark each vertex.", min=1)] = 1,
    retain_days: Annotated[int, typer.Option(help="Delete it after so many days; 0 for never.", min=0)] = 0,
    topic: TopicOption = None,
    still: StillOption = False,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    new: Annotated[
        bool, typer.Option("--new", help="Start a new upload instead of continuing an interrupted one.")
    ] = False,
    wait: Annotated[bool, typer.Option(help="Wait until it is ready.")] = True,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Upload a recording. Repeat the command to continue an interrupted upload.

    Formats: ROS 1 bag; ROS 2 bag (its folder, or the bare .db3 or .mcap); MCAP of Foxglove; .pcap or .pcapng of a
    Velodyne sensor; folder, .zip or .tar of clouds (PCD, PLY, KITTI .bin, .npy, .csv) and images, or KITTI's raw
    layout; video (.mp4, .avi, .mkv) as the camera beside any of these. Sources that belong together go into one
    folder. A folder is sent as a tar that is never written anywhere.
    """
    known = reading_of(topic, still=still, lidar_model=lidar_model, rings=rings)
    with connected(url, token, data) as client:
        on = find_vehicle(client, fleet, vehicle)
        with_rig = find_rig(client, on, rig)
        begun = None if new else client.recordings.unfinished(path, on.id, with_rig.id)
        with bar("Uploading", not as_json) as progress:
            recording = _send(client, path, on, with_rig, begun, name, marks, retain_days, known, progress)
        if wait:
            with bar("Reading the recording", not as_json) as progress:
                recording = wait_until_read(client, recording, progress)
    say(recording, as_json, what_it_is(recording))


def wait_until_read(
    client: Client, recording: RecordingSummary, progress: Callable[[float, str], None]
) -> RecordingView:
    """The recording when it is ready. Raises :class:`FailedError`; where topics must be named, it lists them."""
    try:
        return client.wait(recording, on_progress=progress)
    except FailedError as error:
        error.hint += which_is_which(error.problem).replace("RECORDING", str(recording.id))
        raise


def what_it_is(recording: RecordingSummary) -> str:
    """A recording's state in a sentence, and its warnings."""
    warnings = "".join(f"\nNote: {warning}" for warning in recording.warnings)
    return f"The recording {recording.name!r} is {recording.id}, {recording.state}.{warnings}"


def _send(
    client: Client,
    path: Path,
    vehicle: VehicleOut,
    rig: RigOut,
    begun: RecordingSummary | None,
    name: str,
    marks: int,
    retain_days: int,
    reading: Mapping[str, Any],
    progress: Callable[[float, str], None],
) -> RecordingView:
    def on_bytes(done: int, total: int) -> None:
        progress(done / total, f"{done / 1e6:.0f} of {total / 1e6:.0f} MB")

    if begun:
        return client.recordings.resume(begun, path, on_progress=on_bytes)
    return client.recordings.upload(
        path,
        vehicle.id,
        rig.id,
        name=name or None,
        marks_per_vertex=marks,
        retain_days=retain_days or None,
        reading=reading,
        on_progress=on_bytes,
    )
