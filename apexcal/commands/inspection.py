"""``apexcal inspect``: what a recording on this machine holds and lacks, and the rig that it proposes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.options import ForceOption
from apexcal.commands.proposing import (
    FrameOption,
    JointOption,
    LooksOption,
    UrdfOption,
    answers_of,
    inspect_file,
    refuse,
)
from apexcal.commands.recordings import (
    AcceptOption,
    LidarModelOption,
    RingsOption,
    StillOption,
    TopicOption,
    reading_of,
)
from apexcal.commands.session import Reply
from apexcal.commands.stated_files import lens_files
from apexcal.commands.terminal import FAILED, USAGE, check_target, note, write_content
from apexcal.documents.inspections import InspectedSensor, Inspection
from apexcal.documents.rig_proposals import RigProposal

_OF_LENSES = ("no_camera_info", "lens_not_stated", "lens_not_used", "lens_not_plausible")


def inspect(
    path: Annotated[Path, typer.Argument(exists=True)],
    topic: TopicOption = None,
    still: StillOption = False,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    accept: AcceptOption = False,
    urdf: UrdfOption = None,
    frame: FrameOption = None,
    looks: LooksOption = None,
    joint: JointOption = None,
    rig_out: Annotated[Path | None, typer.Option("--rig-out")] = None,
    force: ForceOption = False,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """Say what a recording holds, which cameras can be calibrated with it, and what is missing. It needs no service.

    It also proposes the rig: sensors, topics and frames of the recording, mounts of /tf_static, /robot_description or
    --urdf. Exit codes: 0 nothing is missing; 1 something is missing, as it says; 2 no camera can be calibrated, the
    recording cannot be read, or wrong usage.

    Args:
        path: File or folder, as `apexcal upload` takes it.
        rig_out: File to write the proposed rig into, for --rig.
        as_json: Print the outcome as JSON.
    """
    if rig_out:
        check_target(rig_out, force)
    reading = reading_of(topic, still=still, lidar_model=lidar_model, rings=rings, accept=accept)
    inspection = inspect_file(path, reading, answers_of(frame, looks, joint), urdf)
    if not isinstance(inspection, Inspection):
        refuse(inspection, f"apexcal inspect {path}")
    inspection = _with_lens_files(inspection, path)
    Reply(inspection, _text(inspection)).print(as_json=as_json)
    if rig_out and inspection.proposal:
        rig = inspection.proposal.rig.model_dump(mode="json", exclude_none=True)
        write_content(rig_out, json.dumps(rig, indent=2, ensure_ascii=False) + "\n")
        note(f"Wrote {rig_out}. Give it with --rig, or add it with `apexcal rig {rig_out}`.")
    raise typer.Exit(USAGE if not inspection.calibratable else FAILED if inspection.faults else 0)


def _with_lens_files(inspection: Inspection, path: Path) -> Inspection:
    """Say of a lens that the recording does not state which files may state it: the service reads them."""
    listed = ", ".join(file.name for file in lens_files(path))
    remedy = f"`apexcal upload` and `apexcal solve` read {listed}: is the lens of this camera in it?"
    faults = [
        fault.model_copy(update={"remedy": remedy}) if listed and fault.code in _OF_LENSES else fault
        for fault in inspection.faults
    ]
    return inspection.model_copy(update={"faults": faults})


def _text(inspection: Inspection) -> str:
    trees = {None: "It states no /tf_static.", True: "/tf_static connects its sensors.", False: ""}
    length = "" if inspection.sensors[0].longest_pause_s is None else f", {inspection.seconds:.1f} s"
    lines = [f"{inspection.format}{length}. {trees[inspection.is_connected]}".strip()]
    lines += [_sensor_line(sensor) for sensor in inspection.sensors]
    lines += [
        line
        for fault in inspection.faults
        for line in (f"{fault.verdict} ({fault.code}): {fault.sentence}", f"  {fault.remedy}")
    ]
    lines += [line for omission in inspection.omissions for line in (omission.sentence, f"  {omission.example}")]
    lines += [f"note: {note}" for note in inspection.notes]
    lines += _rig_lines(inspection.proposal) if inspection.proposal else []
    cameras = ", ".join(inspection.calibratable) or "no camera"
    return "\n".join([*lines, f"It can calibrate {cameras}."])


def _rig_lines(proposal: RigProposal) -> list[str]:
    frames = ", ".join(f"{camera.name} [{camera.frame}]" for camera in proposal.rig.cameras)
    lines = [
        f"Proposed rig: lidar [{proposal.rig.lidar.frame}], {frames}.",
        *(f"  {each}" for each in proposal.notes),
    ]
    return lines + [
        f"  {question.sentence} Assumed: {question.assumed}. Say it with "
        f"{'--looks' if question.asks == 'looks' else '--frame'} {question.sensor}=..., or give --urdf."
        for question in proposal.questions
    ]


def _sensor_line(sensor: InspectedSensor) -> str:
    rate = "" if sensor.rate_hz is None else f" at {sensor.rate_hz:.1f} Hz"
    pause = "without times" if sensor.longest_pause_s is None else f"longest pause {sensor.longest_pause_s:.2f} s"
    parts = [f"{sensor.count} messages{rate}, {pause}"]
    parts += [f"stamped {sensor.delay_s:.2f} s before they were recorded"] if sensor.delay_s is not None else []
    parts += [f"{sensor.image_size[0]} x {sensor.image_size[1]} pixels"] if sensor.image_size else []
    if sensor.kind == "camera":
        parts += [
            f"{sensor.image_kind or 'raw or rectified (not said)'}",
            f"lens {'' if sensor.lens else 'not '}stated",
        ]
    return f"  {sensor.name:<12} {sensor.topic} [{sensor.frame_id}]: {', '.join(parts)}"
