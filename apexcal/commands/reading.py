"""Options that describe a file's content, for the commands that upload it or read it again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from apexcal.commands.common import usage
from apexcal.documents.readings import LidarModel
from apexcal.transport import Document

TopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="NAME=TOPIC",
        help="Which topic, folder or file is which: lidar=/velodyne_points, or a camera's name in the rig, as "
        "front=/camera/image. Several times.",
    ),
]
StillOption = Annotated[
    bool,
    typer.Option(
        "--still",
        help="Still poses, one sweep or several of each: no track, and no times of single points.",
    ),
]
LidarModelOption = Annotated[
    LidarModel | None, typer.Option(help="Sensor of a packet capture; otherwise found from its packets.")
]
RingsOption = Annotated[int, typer.Option(help="Number of the LiDAR's rings, if the file does not say it.", min=0)]


def reading_of(
    topics: Sequence[str] | None, *, still: bool = False, lidar_model: LidarModel | None = None, rings: int = 0
) -> dict[str, Any]:
    """The ``reading`` of a recording. A topic that is no ``name=topic`` ends the command as wrong usage."""
    reading: dict[str, Any] = {"point_times": "stamp_only"} if still else {}
    reading |= {"lidar_model": lidar_model} if lidar_model else {}
    reading |= {"rings": rings} if rings else {}
    cameras: dict[str, str] = {}
    named: dict[str, Any] = {}
    for text in topics or []:
        name, equals, topic = (part.strip() for part in text.partition("="))
        if not (name and equals and topic):
            usage(
                f"--topic {text!r} names no topic", "Write it as --topic front=/camera/image or --topic lidar=/points"
            )
        if name == "lidar":
            named["lidar"] = topic
        else:
            cameras[name] = topic
    named |= {"cameras": cameras} if cameras else {}
    return reading | ({"topics": named} if named else {})


def which_is_which(problem: Document | None) -> str:
    """The topics that a refused recording has, and how to say which is which; empty for any other refusal."""
    candidates = (problem or {}).get("candidates") or []
    if not candidates:
        return ""
    lines = "".join(f"\n  {each['kind']:<6}  {each['name']}{_more(each)}" for each in candidates)
    return f"\nIt holds:{lines}\nSay which is which: apexcal reread RECORDING --topic NAME={candidates[-1]['name']}"


def _more(candidate: Document) -> str:
    count = candidate.get("count")
    width, height = candidate.get("width"), candidate.get("height")
    parts = [f"{count} messages" if count is not None else "", f"{width} x {height} pixels" if width else ""]
    said = ", ".join(part for part in parts if part)
    return f"  ({said})" if said else ""
