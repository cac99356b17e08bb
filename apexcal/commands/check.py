"""``apexcal check``: whether the calibration that a vehicle drives with fits what its sensors recorded."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from apexcal.commands.options import ForceOption
from apexcal.commands.proposing import read_file, refuse
from apexcal.commands.recordings import LidarModelOption, RingsOption, TopicOption, reading_of
from apexcal.commands.session import Reply
from apexcal.commands.terminal import FAILED, USAGE, WITHHELD, complain, usage
from apexcal.documents.validations import AxisCheck, CameraCheck, DriveCheck

# Endings of calibration files of text; a URDF or a recording has another.
_TEXTS: Final = (".txt", ".yaml", ".yml", ".json")


def check(
    path: Annotated[Path, typer.Argument(exists=True)],
    tf_from: Annotated[list[Path] | None, typer.Option(exists=True)] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output")] = None,
    topic: TopicOption = None,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    force: ForceOption = False,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """Check the deployed calibration, CameraInfo and /tf_static, against a drive: without a board or a service.

    Each turn of each camera gets pass, look, stop, or not checked, where this drive does not show it. Mounts that are
    turned by up to 10 degrees or shifted by up to 30 cm are looked for. Exit codes: 0 pitch, yaw and roll of every
    camera pass; 1 some are not checked; 2 the recording cannot be read, or wrong usage; 4 a camera has look or stop.

    Args:
        path: Recording of a drive, as `apexcal upload` takes it.
        tf_from: URDF, or recording with /tf_static, that the mounts are read from instead; or calibration files of
            text (KITTI, nuScenes, OpenCV, Kalibr and more), one option each, that state mounts and lenses.
        output: Folder for the pictures; DRIVE.check if not given.
        as_json: Print the outcome as JSON.
    """
    folder = output or path.resolve().with_name(f"{path.resolve().name}.check")
    if folder.exists() and not folder.is_dir():
        usage(f"{folder} is a file", "Name a folder for the pictures with -o")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        usage(f"{folder} holds files already", "Name another folder with -o, or say --force")
    reading = reading_of(topic, still=False, lidar_model=lidar_model, rings=rings)
    answer = read_file("workers.validation.drive_check", path, folder, reading, **_mounts(path, tf_from or []))
    if "error" in answer:
        refuse(answer["error"], f"apexcal check {path}")
    checked = DriveCheck.model_validate(answer["check"])
    lines = [*checked.notes, *(line for camera in checked.cameras for line in _lines(camera, folder))]
    Reply(checked, "\n".join(lines)).print(as_json=as_json)
    verdicts = {camera.verdict for camera in checked.cameras}
    raise typer.Exit(WITHHELD if verdicts & {"look", "stop"} else 0 if verdicts == {"pass"} else FAILED)


def _mounts(recording: Path, files: list[Path]) -> dict[str, Any]:
    """Return the source of the mounts as the reader takes it."""
    if not files:
        return {}
    if all(file.is_file() and file.suffix.lower() in _TEXTS for file in files):
        command = (sys.executable, "-m", "service.imports", str(recording), *map(str, files))
        child = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        outcome = json.loads(child.stdout.splitlines()[-1]) if child.stdout else {}
        if "read" not in outcome:
            error = outcome.get("error") or {
                "message": "The files were not read",
                "hint": "The reason stands above.",
            }
            complain(error["message"].rstrip("."), error["hint"], code=USAGE)
        return {"calibrations": outcome["read"]["cameras"]}
    if len(files) > 1:
        usage("--tf-from names several files, and not all are calibration files", "Name one URDF or recording")
    (file,) = files
    return {"urdf" if file.is_file() and _begins_xml(file) else "tf_from": file}


def _begins_xml(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def _lines(camera: CameraCheck, folder: Path) -> list[str]:
    lines = [f"{camera.name}: {_words(camera.verdict)}. {camera.sentence}"]
    lines += [f"  {axis.axis:<5} {_words(axis.verdict)}{_turn(axis, camera.sentence)}" for axis in camera.axes]
    lines += [f"  lane markers: {camera.lanes}"] if camera.lanes != "unknown" else []
    lines += [f"  {camera.motion}"] if camera.motion else []
    if camera.pictures:
        more = f" and {len(camera.pictures) - 1} more" if camera.pictures[1:] else ""
        lines.append(f"  pictures: {folder / camera.pictures[0]}{more}")
    return lines


def _words(verdict: str) -> str:
    return "not checked" if verdict == "not_told" else verdict


def _turn(axis: AxisCheck, headline: str) -> str:
    """The turn that fits, of a far-off mount to a degree; where none is told, why, if the headline does not say."""
    if axis.verdict == "not_told":
        return "" if axis.sentence in headline else f": {axis.sentence}"
    if axis.turn_deg is None or axis.sigma_deg is None:
        return ""
    is_rough = axis.sigma_deg >= 1.0
    return (
        f" (about {axis.turn_deg:+.0f} degrees)"
        if is_rough
        else f" ({axis.turn_deg:+.2f} +- {axis.sigma_deg:.2f} degrees)"
    )
