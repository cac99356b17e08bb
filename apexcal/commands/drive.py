"""``apexcal check``: whether the calibration that a vehicle drives with fits what its sensors recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.options import ForceOption
from apexcal.commands.proposing import read_file, refuse
from apexcal.commands.recordings import LidarModelOption, RingsOption, TopicOption, reading_of
from apexcal.commands.session import Reply
from apexcal.commands.terminal import FAILED, WITHHELD, usage
from apexcal.documents.validations import AxisCheck, CameraCheck, DriveCheck


def check(
    path: Annotated[Path, typer.Argument(exists=True)],
    tf_from: Annotated[Path | None, typer.Option(exists=True)] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output")] = None,
    topic: TopicOption = None,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    force: ForceOption = False,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """Hold the deployed calibration, CameraInfo and /tf_static, against a drive: no board and no service is needed.

    Each turn of each camera gets pass, look, stop, or not told by this drive. Look at the pictures: they show mounts
    shifted, or turned by more than 1.5 degrees, which no verdict tells. Exit codes: 0 a camera passes, none is
    accused; 1 nothing is told; 2 the recording cannot be read, or wrong usage; 4 a camera has look or stop.

    Args:
        path: Recording of a drive, as `apexcal upload` takes it.
        tf_from: URDF, or recording with /tf_static, that the mounts are read from instead.
        output: Folder for the pictures; DRIVE.check if not given.
        as_json: Print the outcome as JSON.
    """
    folder = output or path.resolve().with_name(f"{path.resolve().name}.check")
    if folder.exists() and not folder.is_dir():
        usage(f"{folder} is a file", "Name a folder for the pictures with -o")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        usage(f"{folder} holds files already", "Name another folder with -o, or say --force")
    reading = reading_of(topic, still=False, lidar_model=lidar_model, rings=rings)
    is_urdf = tf_from is not None and tf_from.is_file() and _begins_xml(tf_from)
    mounts = {"urdf" if is_urdf else "tf_from": tf_from} if tf_from else {}
    answer = read_file("workers.validation.drive_check", path, folder, reading, **mounts)
    if "error" in answer:
        refuse(answer["error"], f"apexcal check {path}")
    checked = DriveCheck.model_validate(answer["check"])
    lines = [*checked.notes, *(line for camera in checked.cameras for line in _lines(camera, folder))]
    Reply(checked, "\n".join(lines)).print(as_json=as_json)
    verdicts = {camera.verdict for camera in checked.cameras}
    raise typer.Exit(WITHHELD if verdicts & {"look", "stop"} else 0 if "pass" in verdicts else FAILED)


def _begins_xml(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def _lines(camera: CameraCheck, folder: Path) -> list[str]:
    lines = [f"{camera.name}: {_words(camera.verdict)}. {camera.sentence}"]
    lines += [f"  {axis.axis:<5} {_words(axis.verdict)}{_turn(axis)}" for axis in camera.axes]
    lines += [f"  lane markers: {camera.lanes}"] if camera.lanes != "unknown" else []
    return lines + (
        [f"  pictures: {folder / camera.pictures[0]} and {len(camera.pictures) - 1} more"] if camera.pictures else []
    )


def _words(verdict: str) -> str:
    return "not told by this drive" if verdict == "not_told" else verdict


def _turn(axis: AxisCheck) -> str:
    return "" if axis.turn_deg is None else f" ({axis.turn_deg:+.2f} +- {axis.sigma_deg:.2f} degrees)"
