"""``ost.txt`` of camera_calibration: sections in brackets, names on lines of their own, and numbers under them.

As its ``lrost`` writes them: a section ``[image]`` and one of the camera for each camera. The distortion model is not
written: five coefficients are plumb_bob's and eight rational_polynomial's; four are a fisheye's or not.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from service.imports.contents import Contents, FileCamera, FileLens, image_size, numbers, refused

_MODELS = {5: "plumb_bob", 8: "rational_polynomial"}


def is_ost(text: str) -> bool:
    """Whether it has the section of the image and a camera matrix as ``ost.txt`` has them."""
    lines = {line.strip() for line in text.splitlines()}
    return {"[image]", "camera matrix"} <= lines


def read_ost(name: str, text: str) -> Contents:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    cameras: list[FileCamera] = []
    size = (0, 0)
    for section, members in _sections(text):
        if section == "image":
            values = (numbers(f"{each} of {name}", members.get(each), 1)[0] for each in ("width", "height"))
            size = image_size(f"The images of {name}", *values)
        elif "camera matrix" in members:
            D = numbers(f"distortion of {name}", members.get("distortion") or [])
            if len(D) not in _MODELS:
                raise refused(
                    f"{name} has {len(D)} coefficients and does not say their distortion model.",
                    "Send ost.yaml, which camera_calibration writes beside it.",
                )
            K = numbers(f"camera matrix of {name}", members["camera matrix"], 9)
            cameras.append(FileCamera(section[:200], lens=FileLens(_MODELS[len(D)], K, D, size)))
    return Contents(cameras)


def _sections(text: str) -> Iterator[tuple[str, dict[str, list[Any]]]]:
    section, members, name = "", dict[str, list[Any]](), ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("["):
            yield section, members
            section, members, name = line.strip("[]"), {}, ""
        elif line[:1].isalpha():
            name = line
        elif name and line and not line.startswith("#"):
            members.setdefault(name, []).extend(line.split())
    yield section, members
