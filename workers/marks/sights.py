"""Input and output of the machine's marking: frames, sights of the board, proposals and refusals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import CornerName
from apexcal.geometry.se3 import SE3
from workers.geometry.models import ModelName
from workers.geometry.projection import project

Floats = NDArray[np.float64]
Image = NDArray[np.uint8 | np.uint16]

NEIGHBOURS: Final[Mapping[CornerName, tuple[CornerName, CornerName]]] = {
    "top": ("left", "right"),
    "left": ("top", "bottom"),
    "right": ("top", "bottom"),
    "bottom": ("left", "right"),
}
"""The far ends of the two edges that meet in a corner."""

RefusalReason = Literal["no_mount", "outside", "few_pixels", "no_edge", "moved_far", "off_mount", "two_places"]
FailureReason = Literal[
    "few_poses",
    "in_one_place",
    "background_colour",
    "exposure",
    "no_consensus",
    "two_consensuses",
    "few_edges",
]


class FrameSource(Protocol):
    """Grey frames of one camera, decoded when they are read."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Image:
        """The frame (H, W), uint8 or uint16."""
        ...


@dataclass(frozen=True, eq=False)
class Sight:
    """The board of one sweep at the moment of one frame.

    Attributes:
        frame: index of the frame.
        corners: (3,) metres, LiDAR frame, by name; always with the tip ``top``.
        covariance: (3, 3) of the tip over x, y, z, square metres.
        roll: radians, as a vertex states it (`workers.vertices.vertex.Vertex`). It stands for the side corners where
            the board's size is not known.
        velocity: (3,) metres a second, of the board; zero where nothing tells it.
    """

    frame: int
    corners: Mapping[CornerName, Floats]
    covariance: Floats
    roll: float = 0.0
    velocity: Floats = field(default_factory=lambda: np.zeros(3))

    def neighbours(self, corner: CornerName) -> Floats | None:
        """(2, 3) the far ends of the corner's edges; None where they are not known.

        Without a size the tip's edges are taken to be `_SHORTEST_EDGE_M` long and to stand upright, facing the LiDAR.
        """
        ends = NEIGHBOURS[corner]
        if all(name in self.corners for name in ends):
            return np.array([self.corners[name] for name in ends], np.float64)
        if corner != "top":
            return None
        tip = self.corners["top"]
        away = tip[:2] / max(float(np.hypot(tip[0], tip[1])), 1e-9)
        left, down = np.array([-away[1], away[0], 0.0]), np.array([0.0, 0.0, -1.0])
        angle = 0.25 * np.pi + self.roll
        first = np.cos(angle) * left + np.sin(angle) * down
        second = -np.sin(angle) * left + np.cos(angle) * down
        return tip + _SHORTEST_EDGE_M * np.array([first, second])


# Boards that are sold for calibration have edges of 0.4 m and more (`workers.vertices.pose_suggestion`).
_SHORTEST_EDGE_M: Final = 0.4


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera model and its intrinsics (n,) in the order of the model."""

    model: ModelName
    intrinsics: Floats


@dataclass(frozen=True, eq=False)
class MountedLens:
    """A lens on its mount T_camera_lidar."""

    lens: Lens
    mount: SE3

    def pixels(self, points_lidar: Floats) -> Floats:
        """Pixels (N, 2) of points (N, 3); not a number where the lens does not see them."""
        return project(self.lens.model, self.lens.intrinsics, self.mount.apply(points_lidar))[0]


@dataclass(frozen=True, eq=False)
class MarkProposal:
    """A mark (u, v) by the machine.

    Attributes:
        covariance: (2, 2) square pixels.
        short_side_px: length of the shorter of the two edges in the image.
    """

    pixel: tuple[float, float]
    covariance: Floats
    short_side_px: float

    @property
    def sigma_px(self) -> float:
        """Standard deviation of a coordinate, the mean of both variances."""
        return float(np.sqrt(0.5 * np.trace(self.covariance)))


class LikelyPixel(NamedTuple):
    """A place where a corner may be, px, and its probability."""

    u: float
    v: float
    weight: float


@dataclass(frozen=True)
class MarkRefusal:
    """Why a corner has no proposal.

    Attributes:
        places: of `two_places`: both, farther apart than a mark may be off. A person decides.
        short_side_px: of these, as a proposal's.
    """

    reason: RefusalReason
    places: tuple[LikelyPixel, ...] = ()
    short_side_px: float | None = None


@dataclass(frozen=True)
class RecordingFailure:
    """Why a whole recording has no proposals: a stable name and a sentence."""

    reason: FailureReason
    sentence: str


@dataclass(frozen=True, eq=False)
class MachineMarks:
    """The machine's answer for one camera.

    Attributes:
        answers: of each sight, by corner.
        camera: mount and lens that the proposals agree on; None where there are none. A starting value, no result.
        failure: why there is no mount.
        offset_s: camera clock minus that of the pairing, seconds; 0 where the frames do not tell another.
    """

    answers: Sequence[Mapping[CornerName, MarkProposal | MarkRefusal]]
    camera: MountedLens | None = None
    failure: RecordingFailure | None = None
    offset_s: float = 0.0


def is_in_one_place(sights: Sequence[Sight]) -> bool:
    """Whether boards hide the same direction in more than half of the frames, so that a median shows the board."""
    middles: list[Floats] = []
    radii: list[float] = []
    for sight in sights:
        ends = sight.neighbours("top")
        assert ends is not None
        middle = ends.mean(axis=0)  # of the diagonal between both ends, which is the rectangle's
        distance = float(np.linalg.norm(middle))
        middles.append(middle / distance)
        radii.append(0.5 * float(np.linalg.norm(ends - sight.corners["top"], axis=1).min()) / distance)
    unit = np.array(middles)
    angles = np.arccos(np.clip(unit @ unit.T, -1.0, 1.0))
    return bool((angles < np.array(radii)[None]).mean(axis=1).max() > 0.5)
