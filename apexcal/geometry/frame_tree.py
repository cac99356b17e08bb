"""A vehicle's frames as its URDF or ``/tf_static`` has them: each with one parent, and its pose there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from apexcal.documents.errors import InputError
from apexcal.geometry.se3 import SE3, from_document
from apexcal.geometry.urdf_tree import read_joints


class Joint(NamedTuple):
    """``T_parent_child`` is the child's pose in its parent; ``fixed``: whether it never changes."""

    name: str
    fixed: bool
    T_parent_child: SE3

    @property
    def parent(self) -> str:
        """The parent's frame."""
        return self.T_parent_child.to_frame

    @property
    def child(self) -> str:
        """The child's frame."""
        return self.T_parent_child.from_frame


class JointPath(NamedTuple):
    """The path from one frame to another: joints up from the first to the common ancestor, and down to the second.

    Both are in the order in which they are passed.
    """

    up: Sequence[Joint]
    down: Sequence[Joint]

    @property
    def joints(self) -> Sequence[Joint]:
        """Return all joints of the path."""
        return [*self.up, *self.down]


def unusable(what: str, hint: str) -> InputError:
    """A tree that says not what is asked of it."""
    return InputError("frames_not_usable", what, hint)


class FrameTree:
    """Raises :class:`InputError` ``frames_not_usable`` where a frame has two parents."""

    def __init__(self, joints: Iterable[Joint]) -> None:
        self._above: dict[str, Joint] = {}
        self.frames: dict[str, None] = {}
        for joint in joints:
            existing = self._above.setdefault(joint.child, joint)
            if existing is not joint and existing.parent != joint.parent:
                raise unusable(
                    f"The frame {joint.child!r} has two parents, {existing.parent!r} and {joint.parent!r}.",
                    "Every frame has one parent. Remove the wrong joint.",
                )
            # Said again, the later one counts, as for tf2.
            self.put(joint)

    def put(self, joint: Joint) -> None:
        """Add a joint, or replace the one above its child."""
        self._above[joint.child] = joint
        self.frames |= {joint.parent: None, joint.child: None}

    def above(self, frame: str) -> list[Joint]:
        """The joints from a frame up to its root. Raises :class:`InputError` for an unknown frame or a circle."""
        if frame not in self.frames:
            listed = ", ".join(list(self.frames)[:50])
            raise unusable(f"There is no frame {frame!r}.", f"The frames are {listed or 'none'}.")
        path: list[Joint] = []
        while frame in self._above:
            path.append(self._above[frame])
            frame = path[-1].parent
            if len(path) > len(self._above):
                raise unusable(f"The frame {frame!r} is its own ancestor.", "Remove a joint of the circle.")
        return path

    def root(self, frame: str) -> str:
        """The root above a frame."""
        above = self.above(frame)
        return above[-1].parent if above else frame

    def way(self, start: str, end: str) -> JointPath:
        """Raises :class:`InputError` where no joints lead from one to the other."""
        up, down = self.above(start), self.above(end)
        if self.root(start) != self.root(end):
            raise unusable(
                f"No joints lead from {start!r} to {end!r}: their roots are {self.root(start)!r} and "
                f"{self.root(end)!r}.",
                "Add the joint between them, even if it is only roughly known.",
            )
        while up and down and up[-1] == down[-1]:
            up.pop()
            down.pop()
        return JointPath(up, down[::-1])

    def transform(self, to_frame: str, from_frame: str) -> SE3:
        """``T_<to_frame>_<from_frame>`` by the joints between."""
        total = SE3(from_frame, from_frame)
        way = self.way(from_frame, to_frame)
        for joint in way.up:
            total = joint.T_parent_child @ total
        for joint in way.down:
            total = joint.T_parent_child.inverse() @ total
        return total


def urdf_tree(document: bytes) -> FrameTree:
    """Return the tree of a URDF file. Raises :class:`InputError` ``urdf_not_read``, ``frames_not_usable``."""
    joints = read_joints(document)
    return FrameTree(Joint(name, joint.kind == "fixed", joint.T_parent_child) for name, joint in joints.items())


def recorded_tree(transforms: Iterable[Mapping[str, Any]]) -> FrameTree:
    """Return the tree of a recording's fixed frames, as its facts keep them. A joint is named after its child."""
    return FrameTree(
        Joint(
            transform["child"],
            True,
            from_document(
                {
                    "to_frame": transform["parent"],
                    "from_frame": transform["child"],
                    "rotation": {"quaternion_xyzw": transform["quaternion_xyzw"]},
                    "translation_m": transform["translation_m"],
                }
            ),
        )
        for transform in transforms
    )
