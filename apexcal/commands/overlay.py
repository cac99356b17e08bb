"""``apexcal overlay``: a frame with the LiDAR's points, as a PNG file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.common import (
    DataOption,
    JsonOption,
    TokenOption,
    UrlOption,
    bar,
    check_target,
    say,
    write_content,
)
from apexcal.commands.connect import check_id, connected, find_recording
from apexcal.embedded.folder import DEFAULT


def overlay(
    result: Annotated[str, typer.Argument(help="Id of a result; `apexcal calibrate --json` prints them.")],
    frame: Annotated[int, typer.Option("--frame", min=0, help="Number of the frame, from 0.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("overlay.png"),
    recording: Annotated[
        str, typer.Option(help="Recording, by id or by name; otherwise the one that the result's pairs are of.")
    ] = "",
    keep: Annotated[bool, typer.Option("--keep", help="Keep the image on the service, too.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Draw the sweep nearest to a frame into it, through the result's own lens, coloured by depth."""
    check_target(output, force)
    with connected(url, token, data) as client, bar("Drawing the overlay", not as_json) as progress:
        of = find_recording(client, recording).id if recording else None
        asked = client.calibrations.draw_overlay(check_id(result, "result"), frame, of)
        made = client.wait(asked, on_progress=progress)
        content = client.calibrations.overlay(made.id)
        if not keep:
            client.calibrations.delete_overlay(made.id)
    write_content(output, content)
    assert made.result is not None
    drawn = made.result
    say(
        made,
        as_json,
        f"Wrote {output}: {drawn.points} points of sweep {drawn.sweep_index}; {drawn.hidden} more are hidden, and "
        f"{drawn.moved} were moved to the frame's time.",
    )
