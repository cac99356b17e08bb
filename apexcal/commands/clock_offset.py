"""``apexcal clock-offset``: how much the camera's clock shows more than the LiDAR's."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say
from apexcal.commands.connect import check_id, connected, find_camera
from apexcal.embedded.folder import DEFAULT


def clock_offset(
    detection: Annotated[str, typer.Argument(help="Id of a detection whose vertices people have marked.")],
    camera: Annotated[str, typer.Option(help="Camera; needed where the rig has several.")] = "",
    model: Annotated[
        str, typer.Option(help="Lens that is fitted along: pinhole, brown_conrady or kannala_brandt.")
    ] = ("brown_conrady"),
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Estimate the offset between the clocks of camera and LiDAR from the moving board and its marks.

    It needs a minute of walking with many turns, and says so where the motion does not tell the offset. Detect again
    with it: `apexcal detect RECORDING ... --offset-ms OFFSET`, with or without `--interpolate`; marks are kept.
    """
    with connected(url, token, data) as client, bar("Estimating the offset", not as_json) as progress:
        found = client.detections.get(check_id(detection, "detection", "`apexcal detect`"))
        recording = client.recordings.get(found["recording_id"])
        of = find_camera(client.vehicles.rig(recording["rig_id"]), camera)
        asked = client.detections.estimate_offset(recording["id"], detection, of, model=model)
        done = client.wait(asked, on_progress=progress)
    result = done["result"]
    say(
        done,
        as_json,
        f"The camera's clock minus the LiDAR's is {result['offset_ns'] / 1e6:.2f} ms, with a standard deviation of "
        f"{result['sigma_ns'] / 1e6:.2f} ms, from {result['pairs']} marks ({result['rms_px']:.2f} px RMS).\n"
        f"Use it: apexcal detect {recording['id']} --region region.json --offset-ms {result['offset_ns'] / 1e6:.3f}",
    )
