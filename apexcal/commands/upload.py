"""``apexcal upload``: a recording, from this disk to `ready`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from apexcal.client import Client
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say
from apexcal.commands.connect import connected, find_rig, find_vehicle
from apexcal.embedded.folder import DEFAULT
from apexcal.transport import Document


def upload(
    path: Annotated[Path, typer.Argument(help="A ROS 1 bag, or a folder of clouds (PCD) and images.")],
    vehicle: Annotated[str, typer.Option(help="Vehicle, by name or id; needed where there are several.")] = "",
    rig: Annotated[str, typer.Option(help="Rig, by name or id; needed where there are several.")] = "",
    fleet: Annotated[str, typer.Option(help="Fleet, by name or id.")] = "",
    name: Annotated[str, typer.Option(help="Name of the recording; otherwise the file's.")] = "",
    marks: Annotated[int, typer.Option(help="How many people mark each vertex.", min=1)] = 1,
    retain_days: Annotated[int, typer.Option(help="Delete it after so many days; 0 for never.", min=0)] = 0,
    still: Annotated[
        bool,
        typer.Option("--still", help="Still poses: the sweeps' stamps alone count, not when each point was seen."),
    ] = False,
    new: Annotated[bool, typer.Option("--new", help="Do not go on with an upload that broke off.")] = False,
    wait: Annotated[bool, typer.Option(help="Wait until it is ready.")] = True,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Upload a recording. One that broke off goes on where it stopped when the same command is given again."""
    with connected(url, token, data) as client:
        on = find_vehicle(client, fleet, vehicle)
        with_rig = find_rig(client, on, rig)
        begun = None if new else client.recordings.unfinished(path, on["id"], with_rig["id"])
        with bar("Uploading", not as_json) as progress:
            recording = _send(client, path, on, with_rig, begun, name, marks, retain_days, still, progress)
        if wait:
            with bar("Reading the recording", not as_json) as progress:
                recording = client.wait(recording, on_progress=progress)
    warnings = "".join(f"\nNote: {warning}" for warning in recording.get("warnings") or [])
    say(
        recording,
        as_json,
        f"The recording {recording['name']!r} is {recording['id']}, {recording['state']}.{warnings}",
    )


def _send(
    client: Client,
    path: Path,
    vehicle: Document,
    rig: Document,
    begun: Document | None,
    name: str,
    marks: int,
    retain_days: int,
    still: bool,
    progress: Callable[[float, str], None],
) -> Document:
    def on_bytes(done: int, total: int) -> None:
        progress(done / total, f"{done / 1e6:.0f} of {total / 1e6:.0f} MB")

    if begun:
        return client.recordings.resume(begun, path, on_progress=on_bytes)
    return client.recordings.upload(
        path,
        vehicle["id"],
        rig["id"],
        name=name or None,
        marks_per_vertex=marks,
        retain_days=retain_days or None,
        reading={"point_times": "stamp_only"} if still else None,
        on_progress=on_bytes,
    )
