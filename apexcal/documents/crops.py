"""Requests and answers about pages of crops, on which people confirm the machine's marks."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin, sqrt, tau
from random import Random
from typing import Annotated, Any, Final
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Received, Sent
from apexcal.documents.corners import CornerName
from apexcal.documents.machine_marks import MarkPlace
from apexcal.documents.marking import CameraName

CROPS_PER_PAGE: Final = 24
"""Whole rows of 2, 3, 4, 6, 8 or 12 crops."""
LEAST_SHIFTED: Final = 3
"""Shifted marks of a page, so that one slip is less than half of them."""
LEAST_MARKS: Final = 2 * LEAST_SHIFTED
"""With fewer marks of the machine most crops of a page would be shifted."""
LEAST_SIDE_PX: Final = 48.0
"""Side of the smallest crop: its shifts are 5 to 12 px."""
MOST_SIDE_PX: Final = 96.0
"""Side of the largest crop: drawn 115 CSS px wide (three beside each other on a screen of 390) 5 px are still 6."""
LEAST_SHIFT_PX: Final = 5.0
"""`make bench-marks` counts marks beyond this as wrong: the least shift is as small as the machine's gross errors."""
MOST_SHIFT_SHARE: Final = 1 / 4
"""Largest shift over the crop's side. It leaves the corner in the middle half of the crop."""


def side_of(edge_px: float | None) -> float:
    """Return the side of a crop (px) that shows half of the board's shorter edge on each side of the corner."""
    return min(max(edge_px or LEAST_SIDE_PX, LEAST_SIDE_PX), MOST_SIDE_PX)


def expected_pixel(mark: Mapping[str, Any]) -> tuple[float, float]:
    """Return the pixel (u, v) about which a mark of the machine is expected: an eighth to a quarter of a side off it.

    It is always the same, in any direction. Crops show a shifted mark turned about it, as far off as the true one.
    Whoever does not know all of the mark's digits, its deviations among them, cannot undo it.
    """
    random = Random(" ".join(str(mark[name]) for name in ("vertex_id", "u", "v", "sigma_u", "sigma_v", "edge_px")))
    most = MOST_SHIFT_SHARE * side_of(mark["edge_px"])
    length, angle = most * sqrt(random.uniform(0.25, 1.0)), tau * random.random()
    return mark["u"] + length * cos(angle), mark["v"] + length * sin(angle)


class NextCrops(Received):
    """Ask for a page of crops of a camera; the person's page that is not answered yet comes again."""

    camera: CameraName


class CropImage(Sent):
    """The picture that a crop is cut from. Its top-left pixel is the frame's pixel (``u``, ``v``)."""

    url: str
    u: int
    v: int
    width: int
    height: int


class CropView(Sent):
    """A mark (``u``, ``v``) to look at, in the middle of a square of ``side_px`` pixels of its frame.

    Some marks of a page are shifted by the service. Nothing in a page says which.
    """

    vertex_id: UUID
    corner: CornerName
    frame_index: int
    u: float
    v: float
    side_px: float
    image: CropImage


class CropSheet(Sent):
    """A page of crops, given to the person ``person_id``."""

    id: UUID
    person_id: UUID
    camera: str
    crops: list[CropView]


class CropAnswer(Received):
    """Say which marks of a page do not lie on their corner; the person accepts all others.

    ``id`` is a random one of the client's: the same answer sent again is the same.
    """

    id: UUID
    wrong: Annotated[list[UUID], Field(max_length=2 * CROPS_PER_PAGE, description="vertices of the page")]


class CropProgress(Sent):
    """Progress of the confirmation of the machine's marks in one camera.

    ``marks`` are the machine's, ``judged`` of them need nobody's look any more. ``blind_needed`` more of these
    vertices have to be marked blind before there are crops, for example ``next_blind``. ``unmarked`` corners have no
    answer, and no mark of the machine or one that people rejected; the first of them is ``next_unmarked``.
    """

    marks: int
    judged: int
    blind_needed: int
    next_blind: UUID | None
    unmarked: int
    next_unmarked: UUID | None


class CropVerdict(Sent):
    """The outcome of an answered page.

    ``shifted`` marks were shifted by the service, and the person accepted ``missed`` of them. Unless the page is
    ``accepted``, nothing on it is confirmed or rejected, and its marks come again.
    """

    id: UUID
    accepted: bool
    shifted: int
    missed: int
    confirmed: int
    rejected: int
    sentence: str
    progress: CropProgress


class ExpectedCorner(Sent):
    """Where to look for a vertex in its frame: the corner lies within ``within_px`` of (``u``, ``v``), pixels.

    It is the machine's mark, moved at random by an eighth to a quarter of a crop's side: it says where, not what to
    mark. Where the machine cannot decide between two ``places``, both are told, and it is between them.
    """

    vertex_id: UUID
    u: float
    v: float
    within_px: float
    places: list[MarkPlace] = []
