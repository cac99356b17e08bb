"""The result of a fit: one document, which the solver builds, the service stores and everybody reads.

A member that some results do not have is null there. What the pairs do not tell is null, too, never a number that is
none.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any, Final, Literal
from uuid import UUID

from pydantic import ConfigDict

from apexcal.documents.base import Document
from apexcal.documents.checks import Check, CheckVerdict
from apexcal.documents.corners import CornerName
from apexcal.documents.precision import (
    Covariance,
    Deviations,
    Field,
    FitPrecision,
    FittedOffset,
    Halves,
    NextSteps,
    PersonBias,
    Precision,
    Prediction,
    RollingShutter,
    SharedErrors,
)
from apexcal.documents.rules import LensOrigin
from apexcal.documents.transforms import SolvedTransform

Status = Literal["ok", "unfinished", "not_converged", "not_determined", "not_explained"]
Stopped = Literal["agreed", "converged", "goal", "iterations"]


class Errors(Document):
    """Mean and root mean square distance of marks from where their vertices project, pixels."""

    mean_px: float
    rms_px: float


class Search(Errors):
    """The best of the genetic algorithm: what it minimised, to what, and its parameters (radians, metres, pixels)."""

    minimised: str
    parameters: dict[str, float]
    loss_px: float


class LeastSquares(Errors):
    """A least-squares fit: what it minimised, whether and how it ended, its parameters (radians, metres, pixels)."""

    minimised: str
    converged: bool
    message: str
    parameters: dict[str, float]


class FittedPairs(Errors):
    """Errors over the pairs that the polish was given."""

    pairs: int


class OutlierPair(Document):
    """A pair as its set describes it: its moment, sweep, frame or pose, corner (if not the tip's), and the mark."""

    stamp_ns: int | None = None
    sweep_index: int | None = None
    frame_index: int | None = None
    group: int | float | str | None = None
    corner: CornerName | None = None
    u: float | None = None
    v: float | None = None


class Outlier(Document):
    """A pair that the others speak against: its distance under their fit, that in standard deviations, and why.

    ``excluded``: the fit left it out. ``pair`` is added by the service, which has the set.
    """

    index: int
    residual_px: float
    score: float
    reason: str
    excluded: bool
    pair: OutlierPair | None = None


class HeldOut(Errors):
    """Errors over the pairs of the held-out fold; ``forbidden`` counts pairs without a projection.

    Models are compared by ``standard_px``: the distances in standard deviations of what the pairs state, in pixels of
    a typical pair, under a fit without outliers. ``stretch`` is how that scales lengths. Pairs of one of the
    ``blocks`` err together. What it says of single pairs is null for who may not know their marks.
    """

    forbidden: int
    max_px: float | None
    errors_px: list[float] | None
    indices: list[int] | None
    blocks: list[int] | None
    standard_px: list[float] | None
    stretch: list[float] | None


SINGLE_HELD_OUT_PAIRS: Final = ("max_px", "errors_px", "indices", "blocks", "standard_px", "stretch")


class Intrinsics(Document):
    """The lens; focal lengths and principal point in pixels, and those coefficients that the model has; the others
    are left out. A coefficient means what its model says: k3 and k4 are tangential in `brown_conrady`, radial in the
    other models. ``image_size``: width and height, pixels.
    """

    model: str
    f_x: float
    f_y: float
    c_x: float
    c_y: float
    skew: float | None = None
    k1: float | None = None
    k2: float | None = None
    k3: float | None = None
    k4: float | None = None
    k5: float | None = None
    k6: float | None = None
    p1: float | None = None
    p2: float | None = None
    image_size: list[int]

    def by_name(self) -> dict[str, float]:
        """The numbers of the lens that are stated, by name."""
        return {name: value for name, value in self if isinstance(value, float)}


class StatedLensFit(Precision):
    """The mount of the same pairs under a lens that the recording or a file states, locked there.

    ``explains``: whether the pairs bear that lens out, null if they are too few to tell; ``sentence`` says it.
    ``rms_px`` is the error under it, ``free_lens_rms_px`` that under a lens that the pairs alone hold.
    """

    intrinsics: Intrinsics
    transform: SolvedTransform
    rms_px: float
    free_lens_rms_px: float | None
    explains: bool | None
    sentence: str


class ComparedResult(Document):
    """The members by which results of one camera are compared; a history of results reads no more of each."""

    intrinsics: Intrinsics
    transform: SolvedTransform
    lens: LensOrigin
    std: Deviations
    covariance: Covariance
    field: Field | None


class Provenance(Document):
    """The data and programs that a result comes from. ``request`` is the solver's document, angles in radians."""

    request: dict[str, Any]
    pairs_sha256: str
    sources_sha256: str


class FitResult(FitPrecision):
    """The result of a fit.

    ``intrinsics`` and ``transform`` (T_camera_lidar) are the polished ones. ``ga``, ``polished``, ``baseline`` (least
    squares from the centre of the bounds) and ``linear_baseline`` (direct linear transformation with RANSAC, then
    least squares; null where no linear camera fits) stand side by side. ``ga`` is over all pairs, also where the
    others leave outliers out; ``kept`` has the errors over the rest. ``parameters`` and ``std`` are in degrees,
    metres and pixels, parameters of the stages in the search's own units: radians, metres, pixels.

    ``status``: ``unfinished`` if the schedule was stopped from outside, ``not_converged`` if the polish ran out,
    ``not_determined`` if the pairs leave a free parameter open, ``not_explained`` if half of them lie far from where
    it projects them. ``checks`` are all that the result is judged by.

    ``explained_px`` is what marks and vertices explain of ``sigma_px``; ``marks_outside`` counts marks outside of the
    image. ``weak_priors`` are the deviations of priors that hold what the pairs hardly hold: distortion about
    zero, ``aspect`` (f_y / f_x) about one.
    ``lens`` says where the lens comes from. Intrinsics and transform hold together only; ``stated_lens`` has the
    mount for who projects through the stated lens, ``unused_lens`` why a stated lens is not used.
    ``common_errors`` are the deviations stated for what all pairs
    share, ``person_bias`` is what was found of the people's, ``clock_offset`` the offset beyond the estimated one if
    these pairs tell it better, ``rolling_shutter`` what the residuals show beyond the stated ``line_time_us``.

    Of a fit to all pairs ``heldout`` is null. Of one that holds pairs out these are null: ``stated_lens``,
    ``rolling_shutter``, ``prediction``, ``next_steps``, ``explained_px``, ``marks_outside``, ``field`` and both
    baselines. ``provenance`` and ``finish_seconds`` are those of the job; ``residuals_px`` is null for who may not
    know the marks.
    """

    model_config = ConfigDict(frozen=True)

    model: str
    search: str
    status: Status
    message: str
    loss: str
    weights: Literal["equal", "covariances"]
    pairs: int
    free_parameters: int
    iterations: int
    stopped: Stopped | None
    evaluations: int
    history: list[float]
    ga: Search
    polished: LeastSquares
    baseline: LeastSquares | None
    linear_baseline: LeastSquares | None
    kept: FittedPairs
    outliers: list[Outlier]
    parameters: dict[str, float]
    intrinsics: Intrinsics
    transform: SolvedTransform
    lens: LensOrigin
    stated_lens: StatedLensFit | None
    unused_lens: str | None = None
    residuals_px: list[float] | None
    at_bounds: list[str]
    checks: list[Check]
    several_optima: list[str]
    shared_errors: SharedErrors | None
    common_errors: dict[str, float]
    person_bias: PersonBias | None
    clock_offset: FittedOffset | None
    line_time_us: float
    rolling_shutter: RollingShutter | None
    weak_priors: dict[str, float]
    halves: list[Halves]
    prediction: Prediction | None
    next_steps: NextSteps | None
    explained_px: float | None
    marks_outside: int | None
    field: Field | None
    heldout: HeldOut | None
    cpu: dict[str, str]
    versions: dict[str, str]
    provenance: Provenance | None
    finish_seconds: float | None


class ResultView(FitResult):
    """A run's result, whose it is, and all its checks at this moment.

    ``verdict`` is the gravest check of the mount with its lens, ``verdict_alone`` that for who uses the mount with
    another lens; null of a fit that is not to all pairs. Of pairs that were marked here only reviewers see
    ``residuals_px``, ``outliers`` and the errors of single held-out pairs. Once its calibration has ended, ``std``,
    ``interval95_half_width`` and ``prediction`` count the models that held-out pairs do not rule out.
    """

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    rig_id: UUID
    recording_id: UUID | None
    detection_id: UUID | None
    calibration_id: UUID
    run_id: UUID
    set_id: UUID
    camera: str
    fold: int
    seed: int | None
    verdict: CheckVerdict | None
    verdict_alone: CheckVerdict | None
    created_at: datetime
