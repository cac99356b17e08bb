"""``apexcal draft-rig``: writes a rig's description from a URDF or from a recording's ``/tf_static``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from apexcal.commands.common import (
    DataOption,
    TokenOption,
    UrlOption,
    check_target,
    console,
    usage,
    write_target,
)
from apexcal.commands.connect import check_id, connected
from apexcal.embedded.folder import DEFAULT
from apexcal.errors import InputError

_CAMERA = re.compile(r"([^=]+)=([^=]+)=(\d+)x(\d+)")


def draft_rig(
    lidar: Annotated[str, typer.Option(help="The LiDAR's link.", show_default=False)],
    camera: Annotated[
        list[str],
        typer.Option(
            help="NAME=LINK=WIDTHxHEIGHT of a camera; LINK is its optical frame. May be given several times.",
            show_default=False,
        ),
    ],
    urdf: Annotated[Path | None, typer.Option(help="The vehicle's URDF file.", exists=True)] = None,
    recording: Annotated[str, typer.Option(help="Id of a recording, for its /tf_static.")] = "",
    joint: Annotated[
        list[str] | None,
        typer.Option(help="NAME=JOINT: the joint (or its child link) that a camera's results are given for."),
    ] = None,
    vehicle_link: Annotated[str, typer.Option(help="The vehicle's link; otherwise the root above the LiDAR.")] = "",
    name: Annotated[str, typer.Option(help="The rig's name.")] = "roof",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="File to write, such as rig.json.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
) -> None:
    """Write a rig's description for `apexcal rig`: mounts, frames, and the joints to solve for."""
    if (urdf is None) == (not recording):
        usage("draft-rig needs either --urdf or --recording")
    if output:
        check_target(output, force)
    joints = dict(_pair(one) for one in joint or [])
    asked: dict[str, Any] = {
        "name": name,
        "lidar_link": lidar,
        "vehicle_link": vehicle_link or None,
        "cameras": [_camera(one, joints) for one in camera],
    }
    if joints:
        usage(f"--joint names {next(iter(joints))!r}, which is no camera", "Name cameras as --camera does")
    with connected(url, token, data) as client:
        if urdf is not None:
            drafted = client.imports.draft_rig(_text(urdf), **asked)
        else:
            drafted = client.imports.draft_rig_of_recording(check_id(recording, "recording"), **asked)
    for note in drafted.notes:
        console(errors=True).print(note, markup=False, soft_wrap=True)
    text = json.dumps(drafted.rig.model_dump(mode="json", exclude_none=True), indent=2, ensure_ascii=False)
    if output is None:
        print(text)
        return
    write_target(output, text + "\n")
    console(errors=True).print(f"Wrote {output}. Add it with `apexcal rig {output}`.", markup=False, soft_wrap=True)


def _text(urdf: Path) -> str:
    try:
        return urdf.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {urdf}: {getattr(error, 'strerror', None) or 'it is no UTF-8 text'}") from None


def _pair(text: str) -> tuple[str, str]:
    name, sign, joint = text.partition("=")
    if not sign:
        usage(f"--joint {text} names no joint", "Write it as --joint NAME=JOINT")
    return name, joint


def _camera(text: str, joints: dict[str, str]) -> dict[str, Any]:
    found = _CAMERA.fullmatch(text)
    if found is None:
        usage(f"--camera {text} is not understood", "Write it as --camera front=camera_front_optical=1920x1200")
    name, link, width, height = found.groups()
    return {"name": name, "link": link, "image_size": [int(width), int(height)], "joint": joints.pop(name, None)}
