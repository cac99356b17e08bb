"""A URDF file as far as a calibration needs it: its links, its joints, and at which bytes a joint's origin stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from apexcal.documents.errors import InputError
from apexcal.geometry.rotations import rotation_from_euler
from apexcal.geometry.se3 import SE3, Floats

_MOST_JOINTS = 2000
# Metres or radians, as of the transforms that requests bring: products of larger ones are no numbers.
_LARGEST = 1e6
_SAFE_ENCODINGS = ("utf-8", "utf8", "us-ascii", "ascii")


class Span(NamedTuple):
    """The bytes from ``begin`` to before ``end``."""

    begin: int
    end: int


@dataclass
class UrdfJoint:
    """One joint. ``T_parent_child`` is its origin; ``origin`` is where that element stands, None where it has none.

    ``inside`` is the byte behind the joint's own start tag.
    """

    name: str
    kind: str
    parent: str = ""
    child: str = ""
    xyz: str = "0 0 0"
    rpy: str = "0 0 0"
    origin: Span | None = None
    inside: int = 0

    @property
    def T_parent_child(self) -> SE3:  # noqa: N802 - a transform
        """Raises :class:`InputError` ``urdf_not_read`` where the origin is no three and three numbers."""
        R = rotation_from_euler(_three(self, self.rpy)[::-1], "zyx")
        return SE3(self.parent, self.child, R, _three(self, self.xyz))


def refused(what: str, hint: str) -> InputError:
    """A URDF file that cannot be used."""
    return InputError("urdf_not_read", what, hint)


def read_joints(document: bytes) -> Mapping[str, UrdfJoint]:
    """The joints by name. Nothing outside the document is read, and no entity is expanded.

    Raises:
        InputError: ``urdf_not_read`` for what is no URDF, is xacro, or has a document type.
    """
    reader = _Reader(document)
    try:
        reader.parser.Parse(document, True)
    except expat.ExpatError as error:
        raise refused(f"The file is no XML: {error}.", "Send the URDF file as it is.") from None
    if not reader.is_robot:
        raise refused("The file's outermost element is no <robot>.", "Send a URDF file.")
    return reader.joints


class _Reader:
    """Collects joints while expat walks over the document."""

    def __init__(self, document: bytes) -> None:
        self.joints: dict[str, UrdfJoint] = {}
        self.is_robot = False
        self._document = document
        self._path: list[str] = []
        self._joint: UrdfJoint | None = None
        # Expat does not know every name of UTF-8. The declaration of any other encoding is refused.
        self.parser = expat.ParserCreate("utf-8")
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.XmlDeclHandler = self._declaration

    def _doctype(self, *_: object) -> None:
        raise refused("The file has a document type, and with it entities.", "Take the DOCTYPE out.")

    def _declaration(self, version: str, encoding: str | None, standalone: int) -> None:
        if encoding is not None and encoding.lower() not in _SAFE_ENCODINGS:
            raise refused(f"The file is written in {encoding}.", "Save it as UTF-8.")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag.startswith("xacro:") or "${" in "".join(attributes.values()) or "$(" in "".join(attributes.values()):
            raise refused(f"The file is xacro: <{tag}>.", "Expand it first: xacro robot.urdf.xacro > robot.urdf.")
        self._path.append(tag)
        if self._path == ["robot"]:
            self.is_robot = True
        elif self._path == ["robot", "joint"]:
            self._begin_joint(attributes)
        elif self._path[:2] == ["robot", "joint"] and len(self._path) == 3 and self._joint is not None:
            self._inside_joint(self._joint, tag, attributes)

    def _begin_joint(self, attributes: dict[str, str]) -> None:
        name = attributes.get("name", "")
        if name in self.joints:
            raise refused(f"Two joints are named {name!r}.", "Joints have names of their own.")
        if len(self.joints) >= _MOST_JOINTS:
            raise refused(f"The file has more than {_MOST_JOINTS} joints.", "Send a smaller one.")
        self._joint = UrdfJoint(name, attributes.get("type", ""), inside=self._behind_tag())
        self.joints[name] = self._joint

    def _inside_joint(self, joint: UrdfJoint, tag: str, attributes: dict[str, str]) -> None:
        if tag == "parent":
            joint.parent = attributes.get("link", "")
        elif tag == "child":
            joint.child = attributes.get("link", "")
        elif tag == "origin":
            if joint.origin is not None:
                raise refused(f"The joint {joint.name!r} has two origins.", "Leave one.")
            joint.xyz, joint.rpy = attributes.get("xyz", joint.xyz), attributes.get("rpy", joint.rpy)
            joint.origin = Span(self.parser.CurrentByteIndex, self._behind_tag())

    def _end(self, tag: str) -> None:
        joint = self._joint
        begun = joint.origin if joint is not None and self._path == ["robot", "joint", "origin"] else None
        if joint is not None and begun is not None and self._document[begun.end - 2 : begun.end] != b"/>":
            joint.origin = Span(begun.begin, self._document.index(b">", self.parser.CurrentByteIndex) + 1)
        self._path.pop()
        if self._path == ["robot"]:
            self._joint = None

    def _behind_tag(self) -> int:
        """The byte behind the start tag that begins here; a > may stand inside of a quoted value."""
        at, quote = self.parser.CurrentByteIndex, 0
        while True:
            byte = self._document[at]
            at += 1
            if quote:
                quote = 0 if byte == quote else quote
            elif byte in b"\"'":
                quote = byte
            elif byte == ord(">"):
                return at


def _three(joint: UrdfJoint, text: str) -> Floats:
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != 3 or not all(isfinite(value) and abs(value) <= _LARGEST for value in values):
        raise refused(f"The origin of the joint {joint.name!r} says {text!r}.", "Three numbers are needed.")
    return np.array(values)
