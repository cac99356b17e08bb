"""``apexcal simulate``: a recording whose truth is known."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from apexcal.commands.common import FAILED, JsonOption, bar, complain, say
from apexcal.commands.grouped import grouped, option
from apexcal.documents.camera_models import ModelName

Progress = Callable[[float, str], None]

EXAMPLES = """\
apexcal simulate --out walk
    two minutes of a VLP-16 and a front camera, as a ROS 1 bag
apexcal simulate --out rig3 --cameras front,left,right --format mcap
    three cameras, as a ROS 2 bag
apexcal simulate --out far --sensor os1-64 --walk field --board 1.0x1.0 --seconds 300
    would a larger board do for the far half of the field?
apexcal simulate --out real --beam-mrad 3 --dropouts 0.05 --clock-offset-ms 30 --second-person beside
    as untidy as a real recording"""
COMMAND = grouped(EXAMPLES)

_RECORDING, _LIDAR, _CAMERAS = "Recording", "LiDAR", "Cameras"
_WALK, _WAY = "Walk", "What is in the way"

Format = Literal["bag", "db3", "mcap", "pcap", "pcapng", "video", "folder", "tar", "zip", "kitti"]
Sensor = Literal[
    "vlp16", "puck-hi-res", "vlp32c", "hdl32", "hdl64", "alpha-prime", "os0-128", "os1-32", "os1-64", "os1-128",
    "os2-128", "xt32", "qt64", "pandar40p", "mixed128", "lux4",
]  # fmt: skip
Walk = Literal["rows", "field", "cover", "yard", "slow", "still"]
Infos = Literal["none", "raw", "rectified"]
Tree = Literal["nominal", "true"]
Second = Literal["none", "beside", "behind"]


def simulate(
    ctx: typer.Context,
    out: Annotated[Path, option("--out", _RECORDING, "DIR", "Folder to write into.")],
    format_: Annotated[
        Format,
        option(
            "--format",
            _RECORDING,
            None,
            "ROS 1 bag; ROS 2 bag folder (db3, mcap); a VLP-16's packets with JPEG images (pcap, pcapng) or an MP4 "
            "per camera (video); PCD files and JPEG images (folder, tar, zip); KITTI's raw folders, whose clouds "
            "have no rings (kitti).",
        ),
    ] = "bag",
    seconds: Annotated[float, option("--seconds", _RECORDING, "S", "Length of the recording.")] = 120.0,
    seed: Annotated[int, option("--seed", _RECORDING, "N", "Seed of walk, mounts and noise.")] = 1,
    sensor: Annotated[Sensor, option("--sensor", _LIDAR, None, "LiDAR model: rings, azimuth step, rate.")] = "vlp16",
    rings: Annotated[
        int | None, option("--rings", _LIDAR, "4..128", "Another number of rings, evenly over its elevations.")
    ] = None,
    sector_deg: Annotated[
        float, option("--sector-deg", _LIDAR, "DEG", "Azimuths that it reports, to either side; 180 is all round.")
    ] = 60.0,
    range_noise_mm: Annotated[
        float, option("--range-noise-mm", _LIDAR, "MM", "Standard deviation of a range.")
    ] = 8.0,
    beam_mrad: Annotated[
        float, option("--beam-mrad", _LIDAR, "MRAD", "Full width of a beam; edges grow by half of it.")
    ] = 0.0,
    dropouts: Annotated[float, option("--dropouts", _LIDAR, "SHARE", "Returns that are lost.")] = 0.0,
    cameras: Annotated[
        str,
        option(
            "--cameras",
            _CAMERAS,
            "NAMES",
            "Out of front, left, right, front_left, front_right; NAME:DEGREES (to the left) for any other, "
            "NAME:DEGREES:MODEL for a lens of its own; or how many, up to 11.",
        ),
    ] = "front",
    camera_model: Annotated[
        ModelName, option("--camera-model", _CAMERAS, None, "Model of their lens.")
    ] = "brown_conrady",
    camera_hz: Annotated[float, option("--camera-hz", _CAMERAS, "HZ", "Frames per second of each.")] = 15.0,
    pitch_down_deg: Annotated[float, option("--pitch-down-deg", _CAMERAS, "DEG", "How far they look down.")] = 15.0,
    camera_info: Annotated[
        Infos, option("--camera-info", _CAMERAS, None, "Write image_raw or image_rect_color, CameraInfo and a URDF.")
    ] = "none",
    tree: Annotated[
        Tree, option("--tree", _CAMERAS, None, "Where cameras stand in that URDF: as drawn, or as they are.")
    ] = "nominal",
    clock_offset_ms: Annotated[
        float, option("--clock-offset-ms", _CAMERAS, "MS", "How far their clock is ahead of the LiDAR's.")
    ] = 0.0,
    clock_jitter_ms: Annotated[
        float, option("--clock-jitter-ms", _CAMERAS, "MS", "Standard deviation of their stamps.")
    ] = 0.0,
    walk: Annotated[
        Walk,
        option(
            "--walk",
            _WALK,
            None,
            "rows: across the field, slow where near, what we advise; field: from anywhere to anywhere in 10 x 30 m "
            "at 0.7 to 1.6 m/s; cover: row by row over that field to its edges; slow: as field, at 0.15 "
            "to 0.3 m/s; still: on one spot.",
        ),
    ] = "rows",
    board: Annotated[
        str, option("--board", _WALK, "WxH", "Lengths of its edges in metres, left and right of the top vertex.")
    ] = "0.6096x0.9144",
    walker_height_m: Annotated[
        float, option("--walker-height-m", _WALK, "M", "A taller person lifts the board higher.")
    ] = 1.74,
    head_above_m: Annotated[
        float,
        option("--head-above-m", _WAY, "M", "The head is at least this far above the board; 0: behind it."),
    ] = 0.0,
    second_person: Annotated[Second, option("--second-person", _WAY, None, "Where a second person walks.")] = "none",
    poles: Annotated[int, option("--poles", _WAY, "N", "Poles where the walker walks.")] = 0,
    speckle: Annotated[
        float, option("--speckle", _WAY, "SHARE", "Beams that meet rain, snow or dust close by.")
    ] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Write a recording of a simulated rig: a spinning LiDAR, cameras beside it, and a person who carries a board.

    Beside the recording: its truth (truth.json), the rig as its owner would describe it (rig.json) and the region of
    interest (region.json). Use it to plan a recording, or to try the service.
    """
    said = {name: value for name, value in ctx.params.items() if name not in ("out", "as_json")}
    options = {f"--{name.strip('_').replace('_', '-')}": value for name, value in said.items()}
    with bar("Simulating", not as_json) as progress:
        written = run_simulation(out, options, progress)
    say(
        written,
        as_json,
        f"{written['recording']}: {written['sweeps']} sweeps and {written['frames']} frames, "
        f"{written['recording_bytes'] / 1e6:.0f} MB. Truth: {written['truth']}; rig: {written['rig']}; "
        f"region of interest: {written['region']}.",
    )


def run_simulation(out: Path, options: Mapping[str, Any], progress: Progress) -> dict[str, Any]:
    """Run the simulator as a process and return its summary; leaves the command where it refuses."""
    command = [sys.executable, "-m", "workers.simulation", "--out", str(out), "--progress-json"]
    command += [f"{name}={value}" for name, value in options.items() if value is not None]
    summary: dict[str, Any] = {}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        for line in process.stdout:
            said = json.loads(line)
            if "stage" in said:
                progress(said["done"] / max(said["total"], 1) if said["stage"] == "recording" else 0.0, said["stage"])
            else:
                summary = said
        complaint = process.stderr.read().strip()
    if process.returncode != 0:
        last = complaint.splitlines()[-1] if complaint else "no reason given"
        # The parser's program name and the error number mean nothing to the person who typed this.
        reason = re.sub(r"\[Errno \d+\] ", "", re.sub(r"^\S.*?: error: ", "", last))
        complain(f"the simulation was refused: {reason}", code=2 if process.returncode == 2 else FAILED)
    return summary
