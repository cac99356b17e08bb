"""The material of a report: results, pairs and whatever else the database has about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from apexcal.documents.checks import Check
from apexcal.documents.results import FitResult, HeldOut
from workers.solver.problem import FitProblem

Json = dict[str, Any]


@dataclass(frozen=True)
class PersonMark:
    """A person's own mark of a pair, by the pair's number: pixels."""

    pair: int
    person: str
    u: float
    v: float


@dataclass(frozen=True)
class FrameImage:
    """A camera frame's image, encoded as it is stored, and its size in pixels."""

    media_type: str
    data: bytes
    width: int
    height: int


@dataclass(frozen=True, eq=False)
class Material:
    """The data that the report of one result is made of.

    ``result`` is a fit to all pairs, ``problem`` its problem, ``heldout`` the held-out errors of its folds.
    ``pairs``: columns of equal lengths. ``checks``: all checks of the result. ``summary``: the camera's models side
    by side, a ``CameraSummary``, once there is one. ``marks``: by
    person, where the pairs are made of marks. ``elsewhere``: what validations found on other data, the newest first,
    without single pairs. ``names`` are those of vehicle, rig and camera; ``rows`` are the members of a ``ResultView``
    that say whose the result is. ``upper_corner`` is the detection's option.
    """

    result: FitResult
    problem: FitProblem
    pairs: Json
    summary: Json | None = None
    heldout: Sequence[HeldOut] = ()
    checks: Sequence[Check] = ()
    marks: Sequence[PersonMark] = ()
    elsewhere: Sequence[Json] = ()
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    rows: Mapping[str, Any] = field(default_factory=dict[str, Any])
    request: Json = field(default_factory=dict[str, Any])
    made_at: str = ""
    upper_corner: int = 0
