"""The command's options: groups, names, units and defaults, and the settings that they make."""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path
from typing import Any, Protocol, get_args

from workers.geometry.models import MODELS
from workers.simulation.disturbances import SECOND_PERSON, Disturbances
from workers.simulation.sensors import SENSORS
from workers.simulation.settings import FORMATS, CameraInfos, Settings, Tree, parse_cameras
from workers.simulation.walks import WALKS

EXAMPLES = """\
examples:
  apexcal simulate --out walk
      two minutes of a VLP-16 and a front camera, as a ROS 1 bag
  apexcal simulate --out rig3 --cameras front,left,right --format mcap
      three cameras, as a ROS 2 bag
  apexcal simulate --out far --sensor os1-64 --walk field --board 1.0x1.0 --seconds 300
      would a larger board do for the far half of the field?
  apexcal simulate --out real --beam-mrad 3 --dropouts 0.05 --clock-offset-ms 30 --second-person beside
      as untidy as a real recording"""
_OFF = Disturbances()
_STANDARD = Settings()


class _HelpFormatter(argparse.ArgumentDefaultsHelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Says the defaults, and leaves the lines of the examples as they are."""


class _Group(Protocol):
    """Options under one heading."""

    def add_argument(self, *names: str, **said: Any) -> Any: ...


def parser() -> argparse.ArgumentParser:
    """The parser of ``python -m workers.simulation``, which is also the command ``apexcal simulate``."""
    made = argparse.ArgumentParser(
        prog=os.environ.get("APEXCAL_COMMAND", "python -m workers.simulation"),
        description="Simulate a rig: a spinning LiDAR, cameras beside it, and a person who carries a board "
        "turned by 45 degrees through the field in front. Writes a recording as the sensors' drivers would, "
        "the ground truth (truth.json), the rig as its owner would describe it (rig.json), and where the person "
        "walks as a region of interest (region.json).",
        formatter_class=_HelpFormatter,
        epilog=EXAMPLES,
    )
    made.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write into")
    _recording(made.add_argument_group("recording"))
    _lidar(made.add_argument_group("LiDAR"))
    _cameras(made.add_argument_group("cameras"))
    _walk(made.add_argument_group("walk"))
    _disturbances(made.add_argument_group("what is in the way"))
    _output(made.add_argument_group("output"))
    return made


def settings_of(options: argparse.Namespace) -> Settings:
    """The settings that the options say. Raises ValueError with one sentence where they cannot be."""
    return Settings(
        seconds=options.seconds,
        seed=options.seed,
        camera_model=options.camera_model,
        cameras=parse_cameras(options.cameras),
        camera_hz=options.camera_hz,
        pitch_down_deg=options.pitch_down_deg,
        clock_offset_ms=options.clock_offset_ms,
        clock_jitter_ms=options.clock_jitter_ms,
        sensor=options.sensor,
        rings=options.rings,
        sector_deg=options.sector_deg,
        range_noise_mm=options.range_noise_mm,
        walk=options.walk,
        board_m=parse_board(options.board),
        disturbances=Disturbances(
            beam_mrad=options.beam_mrad,
            dropout_share=options.dropouts,
            speckle_share=options.speckle,
            walker_height_m=options.walker_height_m,
            head_above_m=options.head_above_m,
            second_person=options.second_person,
            poles=options.poles,
        ),
        format=options.format,
        camera_info=options.camera_info,
        tree=options.tree,
    )


def parse_board(text: str) -> tuple[float, float]:
    """``0.61x0.91``: metres of the edge to the left of the apex and of the edge to its right.

    Raises:
        ValueError: it is not that.
    """
    match = re.fullmatch(r"(\d*\.?\d+)x(\d*\.?\d+)", text)
    if match is None:
        raise ValueError(f"a board is given as 0.61x0.91, metres of both edges, not {text!r}")
    return float(match[1]), float(match[2])


def _recording(group: _Group) -> None:
    formats = "; ".join(f"{name}: {what}" for name, what in FORMATS.items())
    group.add_argument("--format", choices=tuple(FORMATS), default=_STANDARD.format, help=formats)
    group.add_argument("--seconds", type=float, default=_STANDARD.seconds, help="length of the recording")
    group.add_argument("--seed", type=int, default=_STANDARD.seed, help="seed of walk, mounts and noise")


def _lidar(group: _Group) -> None:
    group.add_argument("--sensor", choices=tuple(SENSORS), default=_STANDARD.sensor, help="the LiDAR")
    group.add_argument("--rings", type=int, help="another number of rings, evenly over the sensor's elevations")
    group.add_argument(
        "--sector-deg", type=float, default=_STANDARD.sector_deg, help="azimuths it reports, +- degrees; 180: all"
    )
    group.add_argument(
        "--range-noise-mm", type=float, default=_STANDARD.range_noise_mm, help="standard deviation of a range"
    )
    group.add_argument(
        "--beam-mrad", type=float, default=_OFF.beam_mrad, help="full width of a beam: edges grow by half of it"
    )
    group.add_argument("--dropouts", type=float, default=_OFF.dropout_share, help="share of returns that are lost")


def _cameras(group: _Group) -> None:
    group.add_argument(
        "--cameras",
        default="front",
        help="names out of front, left, right, front_left, front_right; NAME:DEGREES for any other (to the left); "
        "NAME:DEGREES:MODEL for a lens of its own; or how many, up to 11",
    )
    group.add_argument("--camera-model", choices=MODELS, default=_STANDARD.camera_model, help="the cameras' lens")
    group.add_argument("--camera-hz", type=float, default=_STANDARD.camera_hz, help="frames per second")
    group.add_argument(
        "--pitch-down-deg", type=float, default=_STANDARD.pitch_down_deg, help="how far they look down"
    )
    infos = "a bag's topics: images alone; image_raw or image_rect_color with CameraInfo, /tf_static and a URDF"
    group.add_argument("--camera-info", choices=get_args(CameraInfos), default=_STANDARD.camera_info, help=infos)
    mounts = "where cameras stand in /tf_static and the URDF: as drawn, or as they are"
    group.add_argument("--tree", choices=get_args(Tree), default=_STANDARD.tree, help=mounts)
    group.add_argument(
        "--clock-offset-ms",
        type=float,
        default=_STANDARD.clock_offset_ms,
        help="how far the cameras' clock is ahead of the LiDAR's",
    )
    group.add_argument(
        "--clock-jitter-ms", type=float, default=_STANDARD.clock_jitter_ms, help="standard deviation of its stamps"
    )


def _walk(group: _Group) -> None:
    plans = "; ".join(f"{name}: {plan.summary}" for name, plan in WALKS.items())
    group.add_argument("--walk", choices=tuple(WALKS), default=_STANDARD.walk, help=plans)
    group.add_argument("--board", default="0.6096x0.9144", help="metres of its edges, left x right of the apex")
    group.add_argument(
        "--walker-height-m", type=float, default=_OFF.walker_height_m, help="a taller one lifts the board higher"
    )


def _disturbances(group: _Group) -> None:
    group.add_argument(
        "--head-above-m",
        type=float,
        default=_OFF.head_above_m,
        help="how far the head is above the board at least; 0: the walker ducks behind it",
    )
    group.add_argument(
        "--second-person", choices=SECOND_PERSON, default=_OFF.second_person, help="somebody who goes along"
    )
    group.add_argument("--poles", type=int, default=_OFF.poles, help="how many stand where the walker walks")
    group.add_argument(
        "--speckle", type=float, default=_OFF.speckle_share, help="share of beams that meet rain or snow close by"
    )


def _output(group: _Group) -> None:
    group.add_argument("--json", action="store_true", help="print the summary as one JSON object")
    group.add_argument("--progress-json", action="store_true", help="print progress as JSON lines, then the summary")
