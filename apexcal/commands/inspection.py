"""``apexcal inspect``: what a recording on this machine holds and lacks, told by the child that reads uploads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from apexcal.cli import FAILED, USAGE
from apexcal.commands.recordings import (
    LidarModelOption,
    RingsOption,
    StillOption,
    TopicOption,
    candidates_of,
    reading_of,
)
from apexcal.commands.session import Reply
from apexcal.commands.terminal import complain
from apexcal.documents.inspections import InspectedSensor, Inspection


def inspect(
    path: Annotated[Path, typer.Argument(help="File or folder, as `apexcal upload` takes it.", exists=True)],
    topic: TopicOption = None,
    still: StillOption = False,
    lidar_model: LidarModelOption = None,
    rings: RingsOption = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the outcome as JSON.")] = False,
) -> None:
    """Say what a recording holds, which cameras can be calibrated with it, and what is missing. It needs no service.

    Exit codes: 0 nothing is missing; 1 something is missing, as it says; 2 no camera can be calibrated, the recording
    cannot be read, or wrong usage.
    """
    options = reading_of(topic, still=still, lidar_model=lidar_model, rings=rings)
    topics = options.pop("topics", {})
    request = {"inspect": True, "options": options, "lidar": topics.get("lidar"), "cameras": topics.get("cameras")}
    command = (sys.executable, "-m", "workers.readers", str(path), os.devnull, "--request", json.dumps(request))
    child = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    lines = [json.loads(line) for line in child.stdout.splitlines()]
    if not lines or not {"inspection", "error"} & set(lines[-1]):
        complain(f"the reader of {path} ended with the code {child.returncode}", "What it said stands above.")
    if error := lines[-1].get("error"):
        question = candidates_of(error["fields"]).replace("apexcal reread RECORDING", f"apexcal inspect {path}")
        complain(f"{error['message'].rstrip('.')} ({error['code']})", error["hint"] + question, code=USAGE)
    inspection = Inspection.model_validate(lines[-1]["inspection"])
    Reply(inspection, _text(inspection)).print(as_json=as_json)
    raise typer.Exit(USAGE if not inspection.calibratable else FAILED if inspection.faults else 0)


def _text(inspection: Inspection) -> str:
    trees = {None: "It states no /tf_static.", True: "/tf_static connects its sensors.", False: ""}
    lines = [f"{inspection.format}, {inspection.seconds:.1f} s. {trees[inspection.is_connected]}".strip()]
    lines += [_sensor_line(sensor) for sensor in inspection.sensors]
    lines += [
        line
        for fault in inspection.faults
        for line in (f"{fault.verdict} ({fault.code}): {fault.sentence}", f"  {fault.remedy}")
    ]
    cameras = ", ".join(inspection.calibratable) or "no camera"
    return "\n".join([*lines, f"It can calibrate {cameras}."])


def _sensor_line(sensor: InspectedSensor) -> str:
    rate = "" if sensor.rate_hz is None else f" at {sensor.rate_hz:.1f} Hz"
    parts = [f"{sensor.count} messages{rate}, longest pause {sensor.longest_pause_s:.2f} s"]
    parts += [f"stamped {sensor.delay_s:.2f} s before they were recorded"] if sensor.delay_s is not None else []
    parts += [f"{sensor.image_size[0]} x {sensor.image_size[1]} pixels"] if sensor.image_size else []
    if sensor.kind == "camera":
        parts += [
            f"{sensor.image_kind or 'raw or rectified (not said)'}",
            f"lens {'' if sensor.states_lens else 'not '}stated",
        ]
    return f"  {sensor.name:<12} {sensor.topic} [{sensor.frame_id}]: {', '.join(parts)}"
