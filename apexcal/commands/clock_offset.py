"""``apexcal clock-offset``: estimates how far the camera's clock is ahead of the LiDAR's."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.named import find_camera, find_detection
from apexcal.commands.options import CameraOption, DetectionArgument, check_model
from apexcal.commands.session import Reply, Session
from apexcal.documents.analyses import ClockOffset
from apexcal.documents.camera_models import MODELS
from apexcal.documents.detections import DetectionView

# Standard deviations within which an offset is no reason to move anything.
_CERTAIN = 2.0
# What `apexcal detect` takes where --max-gap-ms is not given.
_MAX_GAP_NS = 50_000_000
_REGION = "REGION.json is the file of the region that this detection was given."


def clock_offset(
    session: Session,
    detection: DetectionArgument,
    camera: CameraOption = "",
    model: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            callback=check_model,
            help=f"Camera model that is fitted with the offset: {', '.join(MODELS)}.",
        ),
    ] = "brown_conrady",
) -> Reply:
    """Estimate the offset between the clocks of camera and LiDAR from the moving board and its marks.

    It needs a minute of walking with many turns, and refuses if the motion does not determine the offset. Then detect
    again: `apexcal detect RECORDING ... --offset-ms OFFSET`, with the same options. Marks are kept.
    """
    client = session.client
    of = find_detection(client, detection)
    recording = client.recordings.get(of.recording_id)
    name = find_camera([client.vehicles.rig(recording.rig_id)], camera)
    request = client.analyses.estimate_offset(of.id, name, model=model)
    view = session.wait(request, "Estimating the offset")
    assert view.result is not None
    return Reply(view, _outcome(view.result, of, name))


def _outcome(result: ClockOffset, detection: DetectionView, camera: str) -> str:
    """The offset in a sentence, and the command that uses it: that of the detection, but for the offset."""
    way = "ahead of" if result.offset_ns >= 0 else "behind"
    sentence = (
        f"The clock of {camera} is {abs(result.offset_ns) / 1e6:.2f} ms {way} the LiDAR's, with a standard deviation "
        f"of {result.sigma_ns / 1e6:.2f} ms, from {result.pairs} marks ({result.rms_px:.2f} px RMS).\n"
    )
    if abs(result.offset_ns) < _CERTAIN * result.sigma_ns:
        sentence += "The clocks agree within the error"
        if not detection.pairing.offset_ns:
            return f"{sentence}: no offset is needed."
        sentence += f"; this detection was paired with an offset of {detection.pairing.offset_ns / 1e6:g} ms"
        return f"{sentence}, so detect again without it.\n{_command(detection, 0)}\n{_REGION}"
    several = "Cameras whose clocks differ need a detection each."
    return f"{sentence}Use it: {_command(detection, result.offset_ns)}\n{_REGION} {several}"


def _command(detection: DetectionView, offset_ns: int) -> str:
    """The command line that detects again as a detection did, under another offset."""
    options, pairing = dict(detection.options), detection.pairing
    words = [f"apexcal detect {detection.recording_id} --region REGION.json --detector {detection.detector}"]
    width, height = options.pop("board_width_m", 0.0), options.pop("board_height_m", 0.0)
    if width and height:
        words.append(f"--board {width:g}x{height:g}")
    words += [f"--option {name}={value:g}" for name, value in options.items()]
    words += [f"--max-gap-ms {pairing.max_gap_ns / 1e6:g}"] if pairing.max_gap_ns != _MAX_GAP_NS else []
    words += [] if pairing.mode == "auto" else [f"--{pairing.mode}"]
    return " ".join([*words, f"--offset-ms {offset_ns / 1e6:.3f}"])
