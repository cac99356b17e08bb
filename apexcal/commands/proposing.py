"""A rig from a recording on this machine: what its file and a URDF say, and what a person answers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from pydantic import ValidationError

from apexcal.commands.named import assignments
from apexcal.commands.recordings import candidates_of
from apexcal.commands.terminal import USAGE, complain, note, usage
from apexcal.documents.base import first_fault
from apexcal.documents.inspections import Inspection
from apexcal.documents.rig_proposals import RigAnswers, RigProposal, RigQuestion
from apexcal.transport import Document

UrdfOption = Annotated[Path | None, typer.Option("--urdf", help="The vehicle's URDF file.", exists=True)]
FrameOption = Annotated[
    list[str] | None,
    typer.Option(
        "--frame",
        metavar="NAME=FRAME",
        help="A sensor's frame in the vehicle's tree: lidar=velodyne, or a camera's. Several times.",
    ),
]
LooksOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=WHERE",
        help="Where a camera looks: forward, left, backward or right of the vehicle (x forward, y left; with no tree "
        "of the LiDAR), or tree: as the tree says. Several times.",
    ),
]
JointOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=JOINT", help="The joint of the tree, or its child link, that a camera's results are given for."
    ),
]
_OPTIONS = {"frames": "--frame", "looks": "--looks"}
_TOPICS = ("ambiguous_lidar", "ambiguous_cameras")


def answers_of(frame: list[str] | None, looks: list[str] | None, joint: list[str] | None = None) -> RigAnswers:
    """Return what the options say of a rig; what they cannot say ends the command as wrong usage."""
    texts = {
        "frames": assignments(frame, "--frame", "lidar=velodyne"),
        "looks": assignments(looks, "--looks", "front=forward"),
        "joints": assignments(joint, "--joint", "front=camera_joint"),
    }
    try:
        return RigAnswers.model_validate(texts)
    except ValidationError as error:
        where, wrong = first_fault(error)
        usage(f"{where}: {wrong}", "`apexcal inspect --help` shows how it is written")


def inspect_file(
    path: Path, reading: Mapping[str, Any], answers: RigAnswers, urdf: Path | None
) -> Inspection | Document:
    """Return what the child that reads uploads says of a recording: its inspection, or its error."""
    rig = answers.model_dump(mode="json")
    answer = read_file("workers.readers", path, os.devnull, reading, inspect=True, rig=rig, urdf=urdf)
    return answer["error"] if "error" in answer else Inspection.model_validate(answer["inspection"])


def read_file(module: str, path: Path, out: Path | str, reading: Mapping[str, Any], **more: Any) -> Document:
    """Return the last line of a child that reads a recording: its outcome, or its ``error``."""
    options = dict(reading)
    topics = options.pop("topics", {})
    request = {"options": options, "lidar": topics.get("lidar"), "cameras": topics.get("cameras")}
    request |= {name: str(value) if isinstance(value, Path) else value for name, value in more.items()}
    command = (sys.executable, "-m", module, str(path), str(out), "--request", json.dumps(request))
    child = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    lines = [json.loads(line) for line in child.stdout.splitlines()]
    if not lines or not {"used", "error"} & set(lines[-1]):
        complain(f"the reader of {path} ended with the code {child.returncode}", "The reason stands above.")
    return lines[-1]


def refuse(error: Document, again: str) -> NoReturn:
    """End the command with what the reader refused; ``again`` is the command that takes the options of topics."""
    question = candidates_of(error["fields"]).replace("apexcal reread RECORDING", again)
    complain(f"{error['message'].rstrip('.')} ({error['code']})", error["hint"] + question, code=USAGE)


def propose(path: Path, reading: dict[str, Any], answers: RigAnswers, urdf: Path | None) -> RigProposal:
    """Return the rig that a recording proposes. What it does not say is asked on the terminal.

    With no terminal the command ends as wrong usage, and names the option that answers.
    """
    while True:
        inspection = inspect_file(path, reading, answers, urdf)
        if not isinstance(inspection, Inspection):
            if inspection["code"] != _TOPICS[0] or not _is_terminal():
                refuse(inspection, f"apexcal solve {path}")
            reading = _with_lidar(reading, inspection)
            continue
        stops = [fault for fault in inspection.faults if fault.verdict == "stop"]
        proposal = inspection.proposal
        if not inspection.calibratable or proposal is None:
            complain(
                f"no camera of {path} can be calibrated", " ".join(f"{each.sentence} {each.remedy}" for each in stops)
            )
        if not proposal.questions:
            return proposal
        question = proposal.questions[0]
        members = answers.model_dump(mode="json")
        members[question.asks][question.sensor] = _ask(question)
        answers = RigAnswers.model_validate(members)


def choose_camera(names: list[str], camera: str) -> str:
    """Return the camera to calibrate; of several it is asked on the terminal."""
    if camera in names or (len(names) == 1 and not camera):
        return camera or names[0]
    if camera or not _is_terminal():
        listed = ", ".join(names)
        usage(
            f"there is no camera {camera!r}" if camera else "the recording has several cameras",
            f"Say which one with --camera: {listed}",
        )
    return _choose("Which camera?", names)


def _with_lidar(reading: dict[str, Any], error: Document) -> dict[str, Any]:
    names = [each["name"] for each in error["fields"]["candidates"]]
    note(error["message"])
    lidar = _choose("Which one is the LiDAR?", names)
    return reading | {"topics": reading.get("topics", {}) | {"lidar": lidar}}


def _ask(question: RigQuestion) -> str:
    option = f"{_OPTIONS[question.asks]} {question.sensor}"
    if not _is_terminal():
        choices = ", ".join(question.choices[:20])
        usage(question.sentence.rstrip("."), f"Say it with {option}=, one of {choices}; or give a rig with --rig")
    note(question.sentence)
    if question.asks == "looks":
        what = f"Where does {question.sensor} look?"
        return _choose(what, question.choices, question.assumed)
    note(f"The tree's frames: {', '.join(question.choices)}.")
    return typer.prompt(f"Which frame is that of {question.sensor}?", default=question.assumed, err=True)


def _choose(question: str, choices: list[str], assumed: str | None = None) -> str:
    """Ask until one of the choices is given."""
    while True:
        answer = typer.prompt(f"{question} ({', '.join(choices)})", default=assumed, err=True).strip()
        if answer in choices:
            return answer
        note(f"{answer!r} is none of these.")


def _is_terminal() -> bool:
    return sys.stdin.isatty()
