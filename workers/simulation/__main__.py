"""The command: ``python -m workers.simulation --out DIR`` writes a recording with its ground truth."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from workers.geometry.models import MODELS
from workers.simulation.lidar import SENSORS
from workers.simulation.simulate import OnProgress, Settings, Simulated, simulate

_PROGRESS_EVERY_S = 0.2


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse, simulate, say what was written. Returns the exit code: 0 done, 2 refused."""
    parser = _parser()
    options = parser.parse_args(arguments)
    began = time.perf_counter()
    try:
        settings = Settings(
            seconds=options.seconds,
            seed=options.seed,
            camera_model=options.camera_model,
            sensor=options.sensor,
            rings=options.rings,
            sector_deg=options.sector_deg,
            range_noise_mm=options.range_noise_mm,
            format=options.format,
        )
        written = simulate(settings, options.out, _reporter(options.progress_json))
    except FileExistsError as error:
        return _refuse(f"{error}. Choose another folder with --out, or remove it.", options.json)
    except (ValueError, OSError) as error:
        return _refuse(f"{error}.", options.json)
    summary = _summary(settings, written, time.perf_counter() - began)
    print(json.dumps(summary) if options.json or options.progress_json else _sentence(written, summary["took_s"]))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m workers.simulation",
        description="Simulate a rig: a spinning LiDAR, a camera beside it, and a person who carries a board "
        "turned by 45 degrees through the field in front. Writes a recording as the sensors' drivers would, "
        "the ground truth (truth.json), the rig as its owner would describe it (rig.json), and where the person "
        "walks as a region of interest (region.json).",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    standard = Settings()
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write into")
    parser.add_argument("--seconds", type=float, default=standard.seconds, help="length of the recording")
    parser.add_argument("--seed", type=int, default=standard.seed, help="of walk, mount and noise")
    parser.add_argument(
        "--camera-model", choices=MODELS, default=standard.camera_model, help="the lens that the camera has"
    )
    parser.add_argument("--sensor", choices=tuple(SENSORS), default=standard.sensor, help="the LiDAR")
    parser.add_argument("--rings", type=int, help="another number of rings over the sensor's elevations")
    parser.add_argument(
        "--sector-deg", type=float, default=standard.sector_deg, help="azimuths that the LiDAR reports, +- degrees"
    )
    parser.add_argument(
        "--range-noise-mm", type=float, default=standard.range_noise_mm, help="standard deviation of a range"
    )
    parser.add_argument("--format", choices=("bag",), default=standard.format, help="of the recording (ROS 1 bag)")
    parser.add_argument("--json", action="store_true", help="print the summary as one JSON object")
    parser.add_argument("--progress-json", action="store_true", help="print progress as JSON lines, then the summary")
    return parser


def _reporter(as_json: bool) -> OnProgress | None:
    """Progress as JSON lines on standard output, or as one rewritten line on a terminal's standard error."""
    if not as_json and not sys.stderr.isatty():
        return None
    last = 0.0

    def report(stage: str, done: int, total: int) -> None:
        nonlocal last
        now = time.monotonic()
        if done < total and now - last < _PROGRESS_EVERY_S:
            return
        last = now
        if as_json:
            print(json.dumps({"stage": stage, "done": done, "total": total}), flush=True)
        else:
            end = "\n" if done == total else ""
            print(f"\r{stage}: {done} of {total}", end=end, file=sys.stderr, flush=True)

    return report


def _summary(settings: Settings, written: Simulated, took_s: float) -> dict[str, object]:
    return {
        "recording": str(written.recording),
        "truth": str(written.truth),
        "rig": str(written.rig),
        "region": str(written.region),
        "seconds": settings.seconds,
        "sweeps": written.sweeps,
        "frames": written.frames,
        "recording_bytes": written.recording_bytes,
        "took_s": round(took_s, 3),
    }


def _sentence(written: Simulated, took_s: object) -> str:
    return (
        f"{written.recording}: {written.sweeps} sweeps and {written.frames} frames, "
        f"{written.recording_bytes / 1e6:.0f} MB, in {took_s} s.\n"
        f"The truth is in {written.truth}, the rig's description in {written.rig}."
    )


def _refuse(sentence: str, as_json: bool) -> int:
    print(json.dumps({"error": {"message": sentence}}) if as_json else sentence, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
