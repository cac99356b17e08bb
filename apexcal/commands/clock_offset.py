"""``apexcal clock-offset``: estimates how far the camera's clock is ahead of the LiDAR's."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.choices import known_model
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say
from apexcal.commands.connect import cameras_of, check_id, connected, find_camera
from apexcal.documents.camera_models import MODELS
from apexcal.documents.detections import DetectionView
from apexcal.documents.studies import ClockOffset
from apexcal.embedded.folder import DEFAULT

# An offset within so many of its standard deviations is no reason to move anything.
_CERTAIN = 2.0
# What `apexcal detect` takes where --max-gap-ms is not given.
_MAX_GAP_NS = 50_000_000
_REGION = "REGION.json is the file of the region that this detection was given."


def clock_offset(
    detection: Annotated[str, typer.Argument(help="Id of a detection whose vertices people have marked.")],
    camera: Annotated[str, typer.Option(help="Camera; needed where the rig has several.")] = "",
    model: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            callback=known_model,
            help=f"Camera model that is fitted with the offset: {', '.join(MODELS)}.",
        ),
    ] = "brown_conrady",
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Estimate the offset between the clocks of camera and LiDAR from the moving board and its marks.

    It needs a minute of walking with many turns, and refuses if the motion does not determine the offset. Then detect
    again: `apexcal detect RECORDING ... --offset-ms OFFSET`, with the same options. Marks are kept.
    """
    with connected(url, token, data) as client, bar("Estimating the offset", not as_json) as progress:
        found = client.detections.get(check_id(detection, "detection"))
        recording = client.recordings.get(found.recording_id)
        of = find_camera(cameras_of(client.vehicles.rig(recording.rig_id)), camera)
        asked = client.detections.estimate_offset(recording.id, detection, of, model=model)
        done = client.wait(asked, on_progress=progress)
    assert done.result is not None
    say(done, as_json, _outcome(done.result, found, of))


def _outcome(result: ClockOffset, detection: DetectionView, camera: str) -> str:
    """The offset in a sentence, and the command that uses it: that of the detection, but for the offset."""
    said = (
        f"The clock of {camera} minus the LiDAR's is {result.offset_ns / 1e6:.2f} ms, with a standard deviation "
        f"of {result.sigma_ns / 1e6:.2f} ms, from {result.pairs} marks ({result.rms_px:.2f} px RMS).\n"
    )
    used = detection.pairing.offset_ns
    if abs(result.offset_ns) < _CERTAIN * result.sigma_ns:
        said += "The clocks agree within the error"
        if not used:
            return f"{said}: no offset is needed."
        return (
            f"{said}; this detection was paired with an offset of {used / 1e6:g} ms, so detect again without it.\n"
            + (f"{_command(detection, 0)}\n{_REGION}")
        )
    several = "Cameras whose clocks differ need a detection each."
    return f"{said}Use it: {_command(detection, result.offset_ns)}\n{_REGION} {several}"


def _command(detection: DetectionView, offset_ns: int) -> str:
    """The command line that detects again as a detection did, under another offset."""
    options, pairing = dict(detection.options), detection.pairing
    words = [
        "apexcal detect",
        str(detection.recording_id),
        "--region REGION.json",
        f"--detector {detection.detector}",
    ]
    width, height = options.pop("board_width_m", 0.0), options.pop("board_height_m", 0.0)
    if width and height:
        words.append(f"--board {width:g}x{height:g}")
    words += [f"--option {name}={value:g}" for name, value in options.items()]
    words += [f"--max-gap-ms {pairing.max_gap_ns / 1e6:g}"] if pairing.max_gap_ns != _MAX_GAP_NS else []
    words += [] if pairing.mode == "auto" else [f"--{pairing.mode}"]
    return " ".join([*words, f"--offset-ms {offset_ns / 1e6:.3f}"])
