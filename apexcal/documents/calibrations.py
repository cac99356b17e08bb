"""Requests and answers about calibrations, results and publications."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal
from uuid import UUID

from pydantic import ConfigDict, Field

from apexcal.documents.base import Magnitude, Name, Received, Sent, Stored
from apexcal.documents.bounds import BoundsPreset
from apexcal.documents.camera_models import DEFAULT_MODELS, SearchForm
from apexcal.documents.common_errors import CommonErrors
from apexcal.documents.jobs import ProblemView
from apexcal.documents.rules import Farm, LensUse, Loss, OutlierRule, WeightRule
from apexcal.documents.schedules import (
    Generations,
    Goal,
    Iterations,
    Population,
    PresetName,
    Scale,
    Slots,
    Tolerance,
)
from apexcal.documents.summaries import Summary

# What a browser's numbers hold exactly.
_LARGEST_SEED = 2**53 - 1


class Prior(Received):
    """A Gaussian prior on a parameter."""

    mean: Magnitude
    sigma: Annotated[float, Field(ge=1e-9, le=1e6, allow_inf_nan=False)]


class GivenLens(Received):
    """A camera's intrinsics as a CameraInfo says them: ``K`` by rows, ``D`` in the order of its distortion model."""

    width: Annotated[int, Field(ge=1, le=32768)]
    height: Annotated[int, Field(ge=1, le=32768)]
    distortion_model: Annotated[str, Field(max_length=64)]
    K: Annotated[list[Magnitude], Field(min_length=9, max_length=9)]
    D: Annotated[list[Magnitude], Field(max_length=14)]


class CameraLens(GivenLens):
    """The lens of a recording's camera. ``source`` says where it is from, such as a file's name."""

    source: Name | None = None


class ScheduleOverrides(Received):
    """Single numbers of the preset's schedule, replaced."""

    slots: Slots | None = None
    population: Population | None = None
    generations: Generations | None = None
    scale: Scale | None = None
    max_iterations: Iterations | None = None
    patience: Iterations | None = None
    tolerance: Tolerance | None = None
    goal_px: Goal | None = None


class CalibrationTemplate(Received):
    """Fit every model to every camera's pairs. Bounds, locks and priors go by parameter name.

    Angles are in radians, or in degrees with ``_deg`` behind the name. ``search``, ``bounds_preset``, ``loss`` and
    ``outliers`` default to what the preset means: ``paper`` to the Euler form, Table I, the mean loss and all pairs;
    the others to the rotation vector, the image size, the saturating loss, and least squares on pairs that belong.
    ``intrinsics`` states lenses by camera. For other cameras ``intrinsics_from: auto`` takes the lens that the
    recording states (CameraInfo) if it states one, ``recording`` insists on it, ``bounds`` ignores it.
    ``intrinsics_as``: ``prior`` draws the lens to the stated one, ``locked`` fixes it there, both with distortion;
    ``auto`` locks it where the pairs (or groups of them) leave fewer than 50 degrees of freedom, else it is
    ``prior``; ``bounds`` looks for focal lengths and principal point near it, where neither rig nor request bounds
    them;
    ``free`` fits the lens from the pairs alone. Models that cannot be the stated lens are fitted freely, or left out
    if it is locked. Skew is locked at 0 unless bounds, a lock, a prior or ``paper-table-1`` name it. ``seed``
    defaults to one derived from the request and the pairs: the same request gives the same bits.
    """

    models: Annotated[list[str], Field(default_factory=lambda: list(DEFAULT_MODELS), min_length=1, max_length=8)]
    preset: PresetName = "default"
    schedule: ScheduleOverrides = ScheduleOverrides()
    search: SearchForm | None = None
    rotation_range_deg: Annotated[float, Field(gt=0, le=180)] = 30.0
    bounds_preset: BoundsPreset | None = None
    intrinsics_from: Literal["auto", "recording", "bounds"] = "auto"
    intrinsics: Annotated[dict[str, GivenLens], Field(default_factory=dict, max_length=16)]
    intrinsics_as: LensUse = "auto"
    bounds: Annotated[dict[str, tuple[Magnitude, Magnitude]], Field(default_factory=dict, max_length=40)]
    locked: Annotated[dict[str, Magnitude], Field(default_factory=dict, max_length=40)]
    priors: Annotated[dict[str, Prior], Field(default_factory=dict, max_length=40)]
    loss: Loss | None = Field(default=None, description="of the search; saturating limits what a wrong mark costs")
    outliers: OutlierRule | None = Field(
        default=None, description="whether pairs that do not belong stay in the polished fit"
    )
    weights: WeightRule = Field(
        default="auto",
        description="auto: by the standard deviations of vertices and marks where all pairs state them",
    )
    common_errors: CommonErrors = Field(
        default=CommonErrors(),
        description="omitted: the default of the pairs' detector; 0 leaves an error out of the deviations",
    )
    line_time_us: Annotated[float, Field(ge=-1000, le=1000)] = Field(
        default=0.0,
        description="of a rolling shutter: from one image row to the next below it; 0 reads all rows at once",
    )
    seed: Annotated[int, Field(ge=0, le=_LARGEST_SEED)] | None = None
    folds: Annotated[int, Field(ge=0, le=20)] = Field(default=5, description="0 holds nothing out")
    farm: Farm = "auto"
    publish: Literal["recommended", "none"] = "none"


class CalibrationRequest(CalibrationTemplate):
    """A calibration of these pairs: one set for each camera, all of one rig."""

    correspondence_set_ids: Annotated[list[UUID], Field(min_length=1, max_length=16)]


class AskedCalibration(CalibrationTemplate):
    """What was asked, with everything filled in that the preset means. ``correspondence_set_ids`` are in the order in
    which they were given.
    """

    model_config = ConfigDict(extra="allow")

    correspondence_set_ids: list[UUID] = []


class RunView(Sent):
    """One fit: a model on a camera's pairs, all of them (fold -1) or without a held-out block."""

    camera: str
    model: str
    fold: int
    state: str
    iteration: int
    best_loss: float | None
    failure: Stored[ProblemView | None]


class ProgressView(Sent):
    """Progress of a calibration."""

    fraction: float
    message: str


class CalibrationView(Sent):
    """A calibration: what was asked, how far it is, and when it is done what it found."""

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    rig_id: UUID
    state: str
    request: Stored[AskedCalibration]
    notes: list[str]
    problem: Stored[ProblemView | None]
    progress: ProgressView
    runs: list[RunView]
    summary: Stored[Summary | None]
    created_at: datetime
    finished_at: datetime | None


class SlotView(Sent):
    """The best individual of one GA slot."""

    camera: str
    model: str
    fold: int
    iteration: int
    slot: int
    loss: float
    parameters: list[float]
    evaluations: int
    seconds: float
    worker: str
