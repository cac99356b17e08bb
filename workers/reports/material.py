"""What a report is made of: results, pairs and what else the database has of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from apexcal.documents.checks import Check
from apexcal.documents.results import FitResult, HeldOut
from workers.solver.problem import FitProblem

Json = dict[str, Any]


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A camera model's fit to all pairs: its result, its problem, and the held-out errors of its folds."""

    result: FitResult
    problem: FitProblem
    heldout: Sequence[HeldOut] = ()


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
    """All that the report of one result reads.

    ``chosen`` is the reported model, ``models`` are all of its camera. ``pairs``: columns of equal lengths.
    ``checks``: all checks of the result. ``slots``: iteration, slot and loss of each slot.
    ``marks``: by person, where the pairs are made of marks. ``frames``: by number of the pair. ``elsewhere``: what
    validations found on other data, the newest first, without single pairs. ``names`` are those of vehicle, rig and
    camera; ``ids`` of the rows.
    """

    chosen: FittedModel
    models: Sequence[FittedModel]
    pairs: Json
    checks: Sequence[Check] = ()
    recommended: str | None = None
    why: str = ""
    slots: Sequence[tuple[int, int, float]] = ()
    marks: Sequence[PersonMark] = ()
    frames: Mapping[int, FrameImage] = field(default_factory=dict[int, FrameImage])
    elsewhere: Sequence[Json] = ()
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    ids: Mapping[str, str] = field(default_factory=dict[str, str])
    request: Json = field(default_factory=dict[str, Any])
    made_at: str = ""
