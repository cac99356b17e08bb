"""``apexcal simulate``: a recording whose truth is known."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from apexcal.commands.common import FAILED, JsonOption, bar, complain, say

Progress = Callable[[float, str], None]


def simulate(
    out: Annotated[Path, typer.Option("--out", help="Folder to write into.")],
    seconds: Annotated[float | None, typer.Option(help="Length of the recording; 120.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of walk, mount and noise; 1.")] = None,
    camera_model: Annotated[str | None, typer.Option(help="pinhole, brown_conrady or kannala_brandt.")] = None,
    sensor: Annotated[str | None, typer.Option(help="vlp16 (standard), hdl32 or os1-64.")] = None,
    rings: Annotated[int | None, typer.Option(help="Another number of rings over the sensor's span.")] = None,
    sector_deg: Annotated[float | None, typer.Option(help="Azimuths that the LiDAR reports, +- degrees; 60.")] = None,
    range_noise_mm: Annotated[float | None, typer.Option(help="Standard deviation of a range; 8.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a recording of a simulated rig, with its truth (truth.json), its description (rig.json) and a region of
    interest (region.json)."""
    options = {
        "--seconds": seconds,
        "--seed": seed,
        "--camera-model": camera_model,
        "--sensor": sensor,
        "--rings": rings,
        "--sector-deg": sector_deg,
        "--range-noise-mm": range_noise_mm,
    }
    with bar("Simulating", not as_json) as progress:
        written = run_simulation(out, options, progress)
    say(
        written,
        as_json,
        f"{written['recording']}: {written['sweeps']} sweeps and {written['frames']} frames, "
        f"{written['recording_bytes'] / 1e6:.0f} MB. Truth: {written['truth']}; rig: {written['rig']}; "
        f"region of interest: {written['region']}.",
    )


def run_simulation(out: Path, options: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """Run the simulator as a process and return its summary; leaves the command where it refuses."""
    command = [sys.executable, "-m", "workers.simulation", "--out", str(out), "--progress-json"]
    command += [str(word) for name, value in options.items() if value is not None for word in (name, value)]
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
        # Neither the parser's program nor the system's number of an error says anything to whoever typed this.
        reason = re.sub(r"\[Errno \d+\] ", "", re.sub(r"^\S.*?: error: ", "", last))
        complain(f"the simulation was refused: {reason}", code=2 if process.returncode == 2 else FAILED)
    return summary
