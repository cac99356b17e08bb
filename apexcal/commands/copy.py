"""``apexcal copy``: a copy of a recording that carries the published calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, check_target, say, usage
from apexcal.commands.connect import connected, find_recording
from apexcal.embedded.folder import DEFAULT


def copy(
    recording: Annotated[str, typer.Argument(help="Recording, by id or by name.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write; otherwise the service names it.")
    ] = None,
    camera: Annotated[list[str] | None, typer.Option(help="Only this camera; may be given several times.")] = None,
    joint: Annotated[
        list[str] | None, typer.Option(help="CAMERA=FRAME: the frame of /tf_static whose pose is replaced.")
    ] = None,
    for_viewers: Annotated[
        bool,
        typer.Option("--for-viewers", help="Write an MCAP file for Foxglove or Lichtblick, with undistorted frames."),
    ] = False,
    keep: Annotated[bool, typer.Option("--keep", help="Keep the copy on the service, too.")] = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Copy a bag with CameraInfo and /tf_static as published. Every other message stays, byte for byte.

    With --for-viewers it writes points, frames, undistorted frames and calibrations. Any kind of recording will do.
    """
    joints = dict(one.split("=", 1) for one in joint or [] if "=" in one)
    if len(joints) != len(joint or []):
        usage("--joint names no camera or no frame", "Write it as --joint front=camera_link")
    if joints and for_viewers:
        usage("--joint does not go with --for-viewers: such a file replaces no pose", "Leave --joint out")
    if output:
        check_target(output, False)
    with connected(url, token, data) as client, bar("Copying", not as_json) as progress:
        of = find_recording(client, recording)
        asked = client.recordings.copy_calibrated(of.id, cameras=camera or [], joints=joints, for_viewers=for_viewers)
        made = client.wait(asked, on_progress=progress)
        assert made.result is not None
        target = output or Path(made.result.file_name)
        client.recordings.download_copy(made, target)
        if not keep:
            client.recordings.delete_copy(made.id)
    placed = ", ".join(f"{pose.child} in {pose.parent}" for pose in made.poses)
    left_out = made.result.left_out
    more = f" Frames not undistorted, because damaged or of another size: {left_out}." if left_out else ""
    counts = f"{made.result.replaced} messages replaced, {made.result.added} added, {made.result.copied} as they were"
    say(made, as_json, f"Wrote {target}: {counts}. Placed: {placed}.{more}")
