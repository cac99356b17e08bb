"""``apexcal solve``: from a recording to a calibration in one command."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any
from urllib.parse import quote

import typer

from apexcal.commands import calibrate, detect, recordings
from apexcal.commands.calibrated import doubts, verdict_line
from apexcal.commands.export import FormatOption, export
from apexcal.commands.marks import marks_of
from apexcal.commands.named import find_camera
from apexcal.commands.options import CameraOption, ForceOption, IntrinsicsOption, LockOption, OutputOption
from apexcal.commands.proposing import (
    FrameOption,
    JointOption,
    LooksOption,
    UrdfOption,
    answers_of,
    choose_camera,
    propose,
)
from apexcal.commands.recordings import (
    AcceptOption,
    LidarModelOption,
    RingsOption,
    StillOption,
    TopicOption,
    reading_of,
)
from apexcal.commands.rig import add_rig
from apexcal.commands.session import Reply, Session
from apexcal.commands.stated_files import read_text
from apexcal.commands.terminal import WITHHELD, check_target, complain, note
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.corners import CORNERS
from apexcal.documents.crops import LEAST_MARKS
from apexcal.documents.detections import DetectionView
from apexcal.documents.fleets import RigOut
from apexcal.documents.recordings import RecordingView
from apexcal.documents.rules import LensUse
from apexcal.embedded.serving import serving
from apexcal.errors import ApiError
from apexcal.rigs import read_rig

# Pairs, in six places, with which the check `pairs` passes: 2 x 33 pixels leave the 16 parameters of the largest lens
# model and its mount 50 degrees of freedom (`workers/judge/pair_checks.py`).
_SUFFICIENT = 33
_POLL_S = 2.0


def solve(
    session: Session,
    recording: Annotated[Path, typer.Argument(exists=True)],
    output: OutputOption,
    urdf: UrdfOption = None,
    board: str = "",
    corner: detect.BoardCorner = "tip",
    description: Annotated[Path | None, typer.Option("--rig", exists=True)] = None,
    machine_marks: Annotated[bool, typer.Option("--machine-marks")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y")] = False,
    camera: CameraOption = "",
    topic: TopicOption = None,
    frame: FrameOption = None,
    looks: LooksOption = None,
    joint: JointOption = None,
    still: StillOption = False,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    intrinsics: IntrinsicsOption = None,
    intrinsics_as: LensUse | None = None,
    lock: LockOption = None,
    accept: AcceptOption = False,
    fleet: str = "",
    vehicle: str = "",
    format: FormatOption = "urdf",
    force: ForceOption = False,
) -> Reply:
    """Calibrate a camera from a recording: rig, upload, region, detection, marks, fit and file in one command.

    The rig comes from the recording and --urdf; what neither says is asked. Without --machine-marks it prints the
    address where a person confirms the machine's marks, and waits. It starts a service on --data where none runs. The
    lens is that of the recording's CameraInfo, of --intrinsics, or of a file in its folder or beside it.
    With --urdf the output is that file with the camera's joint as calibrated. If a check says stop, it writes no file
    and exits with 4.

    Args:
        recording: File or folder that `apexcal upload` takes.
        board: Size of the board in metres, as 0.61x0.91.
        corner: Which corner of the board is looked for: see `apexcal detect`.
        description: JSON file of the rig (docs/rigs.md), instead of what the recording proposes.
        machine_marks: The machine marks and nobody looks. With --board and few poses it marks all four corners.
        intrinsics_as: How the stated lens is used, as in `apexcal calibrate`: free fits another. Otherwise auto.
        yes: Do not ask whether to use the clock offset that the times of recording tell.
        fleet: Fleet, by name; a new name makes one.
        vehicle: Vehicle, by name; a new name makes one. Otherwise it bears the name of the recording's file.
    """
    check_target(output, force)
    detect.board_options(board, corner)
    reading = reading_of(topic, still=still, lidar_model=lidar_model, rings=rings, accept=accept)
    if description:
        document = read_rig(description)
    else:
        proposal = propose(recording, reading, answers_of(frame, looks, joint), urdf)
        camera = choose_camera([each.name for each in proposal.rig.cameras], camera)
        document = proposal.rig.model_dump(mode="json")
        for sentence in proposal.notes:
            note(sentence)
    with ExitStack() as until:
        link = ""
        if not session.url:
            session.url, session.token, link = until.enter_context(serving(session.data.resolve()))
        if link:
            note(f"While this runs, its pages are here; the link works once: {link}")
        added, where = add_rig(session.client, document, fleet, vehicle or recording.resolve().stem, again=True)
        note(f"The rig {added.name!r} of {where} is {added.id}.")
        name = find_camera([added], camera)
        named = {"vehicle": str(added.vehicle_id), "rig": str(added.id), "topic": topic}
        how = {"still": still, "lidar_model": lidar_model, "rings": rings, "accept": accept}
        taken = _step(recordings.upload(session, recording, **named, **how, intrinsics=intrinsics))
        of, has_lens = str(taken.id), any(each.name == name and each.facts.camera_info for each in taken.sensors)
        offset_ms = _clock_offset_ms(taken, name, asks=not yes and not machine_marks)
        left = _left_undone(board=board, has_lens=has_lens, machine_marks=machine_marks)
        with TemporaryDirectory() as folder:
            region = Path(folder) / "region.json"
            _step(detect.suggest(session, of, out=region))
            looked_for = {"region": region, "board": board, "corner": corner, "offset_ms": offset_ms}
            detected: DetectionView = _step(detect.detect(session, of, **looked_for))
        detection, asks_all = str(detected.id), machine_marks and _ask_all_corners(session, detected)
        of_machine = _step(marks_of(session, detected, name, again=asks_all))["analysis"].result
        if not machine_marks:
            _people_mark(session, detection, name, is_own=bool(link))
        elif of_machine.warning:
            complain("the machine's marks contradict the rig's mount", of_machine.warning)
        elif not of_machine.marked:
            complain("the machine marked nothing, so there is nothing to calibrate from", " ".join(left))
        terms = {"detection": detection, "machine_marks": machine_marks, "lock": lock, "intrinsics_as": intrinsics_as}
        calibration: CalibrationView = calibrate.calibrate(session, camera=[name], **terms).document
        summary = calibration.summary.cameras[name] if calibration.summary else None
        model = summary.models.get(summary.recommended or "") if summary else None
        if summary is None or model is None:
            complain("no model is recommended", summary.why if summary else "")
        sentences = [*(f"Note: {each}" for each in calibration.notes)]
        sentences += [verdict_line(summary), *doubts(summary)]
        if model.verdict != "pass":
            sentences += [f"Not done yet: {each}" for each in left]
        again = f"apexcal serve --data {session.data}`, then `" if link else ""
        look = f"See it with `{again}apexcal open calibration {calibration.id}`."
        if model.verdict == "stop":
            return Reply(calibration, "\n".join([*sentences, f"No file was written. {look}"]), WITHHELD)
        into = _patched(added, name, urdf) if format == "urdf" else {}
        export(session, result=str(model.result_id), format=format, output=output, force=force, **into)
        if model.verdict == "look":
            publish = f"`apexcal publish {model.result_id} --reason WHY`"
            sentences.append(
                f"Nothing is published by itself while a check says look. Publish with {publish}. {look}"
            )
    return Reply(calibration, "\n".join(sentences))


def _ask_all_corners(session: Session, detection: DetectionView) -> bool:
    """Have all corners of the board marked if its tips alone are too few pairs.

    The tips of a recording share errors: of the edges' blooming and of the board's shape. Few tips do not show them,
    because such errors do not scatter; opposite corners of one pose have them with opposite signs.

    Returns:
        Whether they are marked. Without the board's size the detection knows no other corners.
    """
    if detection.counts.accepted >= _SUFFICIENT:
        return False
    try:
        session.client.detections.ask_corners(detection.id, CORNERS)
    except ApiError as error:
        if error.code != "corners_not_known":
            raise
        return False
    return True


def _left_undone(*, board: str, has_lens: bool, machine_marks: bool) -> list[str]:
    """Return sentences, each with an option, about the statements that would make the result better."""
    undone = {
        "State the board's size: --board WIDTHxHEIGHT.": bool(board),
        "State the camera's lens: --intrinsics FILE.": has_lens,
        "Have a person confirm the machine's marks, or mark: leave --machine-marks out.": not machine_marks,
    }
    return [sentence for sentence, is_done in undone.items() if not is_done]


def _people_mark(session: Session, detection: str, camera: str, *, is_own: bool) -> None:
    """Say where a person confirms the machine's marks, or marks, and wait for them. Ctrl-C says how to go on.

    The wait ends when people have looked at all marks of the machine, or have marked as many vertices as it takes.
    """
    marking = session.client.marking
    of_machine = marking.crop_progress(detection, camera).marks
    confirms = of_machine >= LEAST_MARKS
    what, page = ("Confirm the machine's marks", "crops") if confirms else ("Mark", "mark")
    try:
        note(f"{what} here: {session.url.rstrip('/')}/detections/{detection}/{page}?camera={quote(camera)}")
        with session.progress("Waiting for marks") as on_progress:
            while True:
                progress = marking.progress(detection, camera)
                needed = max(min(_SUFFICIENT, progress.vertices), 1)
                share, text = progress.complete / needed, f"{progress.complete} of {needed} corners marked"
                if confirms:
                    judged = marking.crop_progress(detection, camera).judged
                    share = max(share, judged / of_machine)
                    text += f", {judged} of {of_machine} marks looked at"
                on_progress(min(share, 1.0), text)
                if share >= 1.0:
                    return
                time.sleep(_POLL_S)
    except KeyboardInterrupt:
        start = f"apexcal serve --data {session.data}`, then `" if is_own else ""
        later = f"apexcal calibrate --detection {detection} --camera {camera}"
        complain(
            "stopped before there were enough marks; the marks so far stay",
            f"Go on with `{start}{later}`",
            code=130,
        )


def _clock_offset_ms(recording: RecordingView, camera: str, *, asks: bool) -> float:
    """Return the offset to pair a camera's frames with, as the times of recording tell it: 0 if the clocks agree."""
    facts = next(each.facts for each in recording.sensors if each.name == camera)
    if not facts.offset_ns:
        return 0.0
    note(next((sentence for sentence in recording.warnings if sentence.startswith(f"The clock of {camera} is")), ""))
    if asks and sys.stdin.isatty() and not typer.confirm("Pair the frames with this offset?", default=True, err=True):
        complain("without the offset no frame is near a sweep", "Synchronise the clocks, and record again.")
    note(f"Frames are paired with an offset of {facts.offset_ns / 1e6:.3f} ms.")
    return facts.offset_ns / 1e6


def _patched(added: RigOut, camera: str, urdf: Path | None) -> dict[str, Any]:
    """Return what `export` takes to write the calibration into the URDF, if that holds the camera and its joint."""
    if urdf is None:
        return {}
    of, text = next(each for each in added.cameras if each.name == camera), read_text(urdf)
    if of.joint is None or of.frame not in text or of.joint.T_child_camera.to_frame not in text:
        note(f"{urdf} has no joint for {of.frame}. The output is a URDF of LiDAR and camera alone.")
        return {}
    return {"urdf": urdf, "joint": of.joint.T_child_camera.to_frame}


def _step(reply: Reply) -> Any:
    """Say the first sentence of a step's reply, and return its document."""
    texts = [part for part in ([reply.text] if isinstance(reply.text, str) else reply.text) if isinstance(part, str)]
    note("".join(texts).partition("\n")[0])
    return reply.document
