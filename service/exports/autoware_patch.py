"""Autoware's own calibration file with one camera's pose as calibrated. Every other byte stays."""

from __future__ import annotations

import yaml

from service.exports.autoware import NAMES, mounted_edge, values
from service.exports.calibrated import CalibratedCamera
from service.platform.http.problems import Problem, unprocessable

# PyYAML takes time with the square of how deep brackets lie in each other.
_MOST_BRACKETS = 1000


def patched(document: str, child: str, camera: CalibratedCamera) -> str:
    """``sensor_kit_calibration.yaml`` or ``sensors_calibration.yaml`` with the new pose of ``child`` in its parent.

    Raises:
        Problem: 422 ``autoware_not_read``, where the file has no such entry, or its child is not the solved one.
    """
    edge = mounted_edge(camera)
    if child != edge.from_frame:
        raise _refused(
            f"The calibration says where {edge.from_frame!r} is, not {child!r}.",
            f"Name it as `joint`: {edge.from_frame}.",
        )
    if document.count("[") + document.count("{") > _MOST_BRACKETS:
        raise _refused(f"The file has more than {_MOST_BRACKETS} brackets.", "Send the file as Autoware reads it.")
    try:
        if any(isinstance(token, yaml.AnchorToken | yaml.AliasToken) for token in yaml.scan(document)):
            raise _refused("The file has anchors, so that a number may stand for several.", "Write each number.")
        pose = _entry(_entry(yaml.compose(document, yaml.SafeLoader), edge.to_frame), child)
        numbers = {name: _entry(pose, name) for name in NAMES}
    except (yaml.YAMLError, RecursionError) as error:
        raise _refused(f"The file is no YAML: {error}.", "Send the file as Autoware reads it.") from None
    for name, node in sorted(numbers.items(), key=lambda item: -item[1].start_mark.index):
        if not isinstance(node, yaml.ScalarNode):
            raise _refused(
                f"{name} of {child!r} is no number.", "Write a number for each of x, y, z, roll, pitch, yaw."
            )
        document = document[: node.start_mark.index] + values(edge)[name] + document[node.end_mark.index :]
    return document


def _entry(node: yaml.Node | None, key: str) -> yaml.Node:
    entries = [(name.value, value) for name, value in node.value] if isinstance(node, yaml.MappingNode) else []
    values = [value for name, value in entries if name == key]
    if len(values) != 1:
        there = ", ".join(str(name) for name, _ in entries)[:500] or "nothing"
        hint = (
            f"There is {there}. State the camera's joint in the rig as your tree has it: `apexcal inspect walk.bag "
            "--urdf truck.urdf --rig-out rig.json` writes it."
        )
        raise _refused(f"The file has {'no' if not values else 'more than one'} entry {key!r}.", hint)
    return values[0]


def _refused(what: str, hint: str) -> Problem:
    return unprocessable("autoware_not_read", what, hint)
