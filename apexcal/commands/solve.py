"""``apexcal solve``: from a recording to a calibration in one command, marked by the machine."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from apexcal.cli import WITHHELD
from apexcal.commands import calibrate, detect, recordings, rig
from apexcal.commands.calibrated import line_of, verdict_line
from apexcal.commands.export import FormatOption, export
from apexcal.commands.marks import marks
from apexcal.commands.named import find_camera
from apexcal.commands.options import CameraOption, ForceOption, OutputOption
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import check_target, complain, note, usage
from apexcal.demo.service import serving
from apexcal.documents.calibrations import CalibrationView


def solve(
    session: Session,
    recording: Annotated[Path, typer.Argument(help="File or folder that `apexcal upload` takes.", exists=True)],
    description: Annotated[Path, typer.Option("--rig", help="JSON file of the rig: docs/rigs.md.", exists=True)],
    output: OutputOption,
    board: Annotated[str, typer.Option(help="Size of the board in metres, as 0.61x0.91.")] = "",
    machine_marks: Annotated[
        bool, typer.Option("--machine-marks", help="The machine marks, and nobody looks at its marks.")
    ] = False,
    camera: CameraOption = "",
    fleet: Annotated[str, typer.Option(help="Fleet, by name; a new name makes one.")] = "",
    format: FormatOption = "urdf",
    force: ForceOption = False,
) -> Reply:
    """Calibrate a camera from a recording: rig, upload, region, detection, marks, fit and file in one command.

    It starts a service on --data where none runs. If a check says stop, it writes no file and exits with 4.
    """
    if not machine_marks:
        usage("solve asks nobody for marks", "Give --machine-marks, or follow the steps of docs/engineers.md")
    check_target(output, force)
    with ExitStack() as until:
        if not session.url:
            session.url, session.token = until.enter_context(serving(session.data.resolve()))
        added = _step(rig.rig(session, description, fleet=fleet, vehicle=recording.stem))
        name = find_camera([added], camera)
        of = str(_step(recordings.upload(session, recording, vehicle=str(added.vehicle_id), rig=str(added.id))).id)
        with TemporaryDirectory() as folder:
            region = Path(folder) / "region.json"
            _step(detect.suggest(session, of, out=region))
            detection = _step(detect.detect(session, of, region=region, board=board))
        _step(marks(session, str(detection.id), camera=name))
        done = calibrate.calibrate(session, detection=str(detection.id), camera=[name], machine_marks=True)
        calibration: CalibrationView = done.document
        summary = calibration.summary.cameras[name] if calibration.summary else None
        model = summary.models.get(summary.recommended or "") if summary else None
        if summary is None or model is None:
            complain("no model is recommended", summary.why if summary else "")
        sentences = [verdict_line(summary), *(line_of(check) for check in summary.checks if check.verdict != "pass")]
        if model.verdict == "stop":
            return Reply(calibration, "\n".join([*sentences, "No file was written."]), WITHHELD)
        export(session, result=str(model.result_id), format=format, output=output, force=force)
    return Reply(calibration, "\n".join(sentences))


def _step(reply: Reply) -> Any:
    """Say the first sentence of a step's reply, and return its document."""
    texts = [part for part in ([reply.text] if isinstance(reply.text, str) else reply.text) if isinstance(part, str)]
    note("".join(texts).partition("\n")[0])
    return reply.document
