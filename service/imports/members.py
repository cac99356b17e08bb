"""Find members in documents of other programs, at any depth and however their names are written."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from math import isfinite
from typing import Any, Final

from service.imports.contents import refused
from service.platform.http.problems import Problem

Block = Mapping[str, Any]
_MOST_NUMBERS: Final = 64
_MOST_NAMES: Final = 24
AS_CAMERA_INFO: Final = (
    "Write it as ROS's camera_info: image_width, image_height, camera_matrix (9 numbers by rows, in pixels), "
    "distortion_model (plumb_bob, rational_polynomial, equidistant, or none for undistorted images) and "
    "distortion_coefficients; and a mount as T_camera_lidar (16 numbers by rows, from LiDAR points into the camera)."
)


def nested(document: Block) -> dict[str, Any]:
    """The document with dotted names as members of members: ``Camera1.fx`` is ``fx`` of ``Camera1``."""
    grown: dict[str, Any] = {}
    for name, value in document.items():
        head, _, tail = name.partition(".")
        if tail and isinstance(grown.setdefault(head, {}), dict):
            grown[head] = {**grown[head], tail: value}
        else:
            grown[name] = value
    return grown


def blocks(value: Any, path: str = "") -> Iterator[tuple[str, Block]]:
    """Every mapping with its path, the outermost first. OpenCV's matrices are values and no blocks."""
    if isinstance(value, list):
        value = {str(index): each for index, each in enumerate(value) if isinstance(each, dict)}
    elif isinstance(value, dict) and not is_matrix(value):
        yield path, value
    else:
        return
    for name, each in value.items():
        yield from blocks(each, f"{path}.{name}".lstrip("."))


def is_matrix(value: Any) -> bool:
    """Whether it is a matrix with its shape beside it."""
    return isinstance(value, dict) and "data" in value and bool({"rows", "cols"} & set(value))


def bare(name: str) -> str:
    """A name without what programs write differently: ``dist_coeffs``, ``DistCoeff``."""
    return re.sub(r"[^a-z0-9]", "", name.lower()).removesuffix("s")


def member(block: Block, names: Collection[str]) -> Any:
    """The first member under one of these bare names; None if there is none."""
    values = {bare(name): value for name, value in block.items()}
    return next((values[name] for name in names if values.get(name) is not None), None)


def vector(value: Any) -> list[float] | None:
    """The numbers of a list, of a list of rows, or of a matrix; None for anything else."""
    value = value.get("data") if is_matrix(value) else value
    if not isinstance(value, list):
        return None
    rows = [row if isinstance(row, list) else [row] for row in value[:_MOST_NUMBERS]]
    numbers = [scalar(each) for row in rows for each in row[:_MOST_NUMBERS]]
    return None if None in numbers or len(numbers) > _MOST_NUMBERS else [each for each in numbers if each is not None]


def scalar(value: Any) -> float | None:
    """A finite number, also where YAML 1.1 reads text (1e-05); None for anything else."""
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else None
    except (ValueError, OverflowError):
        return None
    return number if number is not None and isfinite(number) else None


def listed(document: Block) -> str:
    """The names that a document holds, for a refusal."""
    names = [
        f"{path}.{name}".lstrip(".")[:60] + (f" ({value[:20]})" if isinstance(value, str) else "")
        for path, block in blocks(document)
        for name, value in block.items()
        if is_matrix(value) or not isinstance(value, dict | list) or vector(value) is not None
    ]
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"It holds {', '.join(names[:_MOST_NAMES]) or 'nothing'}{more}."


def without_distortion(name: str, block: Block) -> Problem:
    """The refusal of a lens whose distortion has no known name: it is asked for and never taken for zero."""
    return refused(
        f"{name} has a camera matrix, and no distortion under a known name. {listed(block)}",
        "If its images are undistorted, add `distortion_model: none` to the file. " + AS_CAMERA_INFO,
    )
