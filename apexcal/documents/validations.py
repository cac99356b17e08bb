"""What requests and answers about validations look like: a calibration tested on data it was not fitted to."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal, Self
from uuid import UUID

from pydantic import Field, model_validator

from apexcal.documents.base import Document, Magnitude, Name, Received, Sent, Stored
from apexcal.documents.bounds import LEAST_FOCAL_PX
from apexcal.documents.camera_models import CAMERA_MODELS, ModelName
from apexcal.documents.comparisons import ResultDifference
from apexcal.documents.jobs import JobView, ProblemView
from apexcal.documents.precision import Deviations
from apexcal.documents.publications import PublicationView
from apexcal.documents.results import Intrinsics, SolvedTransform
from apexcal.documents.states import WorkState
from apexcal.documents.transforms import Transform

# Of a score of pairs: the columns with one value for each pair.
SINGLE_PAIRS = ("u", "v", "residual_u", "residual_v", "is_wrong")
ValidationKind = Literal["pairs", "lanes", "edges"]
Verdict = Literal["agrees", "disagrees", "unknown"]


class GivenLens(Received):
    """A lens by the names of our camera models, pixels."""

    model: ModelName
    parameters: dict[str, Magnitude]
    image_size: tuple[Annotated[int, Field(ge=1, le=100_000)], Annotated[int, Field(ge=1, le=100_000)]]

    @model_validator(mode="after")
    def _has_its_parameters(self) -> Self:
        known = CAMERA_MODELS[self.model].intrinsics
        missing = [name for name in ("f_x", "f_y", "c_x", "c_y") if name not in self.parameters]
        strange = sorted(set(self.parameters) - set(known))
        if missing or strange:
            raise ValueError(f"the parameters of {self.model} are {', '.join(known)}; f_x, f_y, c_x, c_y are needed")
        for name in ("f_x", "f_y"):
            if self.parameters[name] < LEAST_FOCAL_PX:
                given = self.parameters[name]
                raise ValueError(f"{name} is {given:g}; no camera has a focal length below {LEAST_FOCAL_PX:g} px")
        return self


class GivenCalibration(Received):
    """A calibration that is not a result here: a lens and ``T_camera_lidar``."""

    lens: GivenLens
    transform: Transform


class ValidationRequest(Received):
    """Test a camera's calibration on other data.

    ``pairs`` takes ``set_id``, any correspondence set of this camera; ``lanes`` and ``edges`` take ``recording_id``,
    a drive. The calibration is ``result_id``, or ``calibration``, or else what the camera is given now.
    """

    kind: ValidationKind
    camera: Name
    set_id: UUID | None = None
    recording_id: UUID | None = None
    result_id: UUID | None = None
    calibration: GivenCalibration | None = None

    @model_validator(mode="after")
    def _says_what_is_needed(self) -> Self:
        data = "set_id" if self.kind == "pairs" else "recording_id"
        other = "recording_id" if self.kind == "pairs" else "set_id"
        if getattr(self, data) is None or getattr(self, other) is not None:
            raise ValueError(f"{self.kind} takes {data}, and no {other}")
        if self.result_id is not None and self.calibration is not None:
            raise ValueError("give result_id or calibration, not both")
        return self


class PairScore(Document):
    """Errors on pairs that the calibration was not fitted to, px.

    ``bias_px`` is the mean of projection minus mark without ``wrong`` marks, ``noise_px`` their noise per coordinate.
    ``turn_deg`` and ``shift_mm`` are the mount error that the residuals look like, ``sigmas`` its root mean square
    over what is stated. ``forbidden`` pairs have no projection. Columns are in the order of the set's pairs.
    """

    verdict: Verdict
    sentence: str
    pairs: int
    forbidden: int
    wrong: int
    mean_px: float
    rms_px: float
    median_px: float
    max_px: float
    bias_px: list[float] | None = None
    bias_sigma_px: list[float] | None = None
    noise_px: float | None = None
    stated_noise_px: float | None = None
    turn_deg: float | None = None
    shift_mm: float | None = None
    sigmas: float | None = None
    probability: float | None = None
    u: list[float]
    v: list[float]
    residual_u: list[float | None]
    residual_v: list[float | None]
    is_wrong: list[bool]


class OffsetCurve(Document):
    """The score over one offset of the mount with all others at zero; ``unit`` is ``deg`` or ``m``.

    Offsets are about and along the camera's axes: ``yaw`` about y (down), ``pitch`` about x (right), ``roll`` about z
    (ahead).
    """

    offset: Literal["yaw", "pitch", "roll", "x", "y", "z"]
    unit: Literal["deg", "m"]
    at: list[float]
    score: list[float]


class RoadScore(Document):
    """How well what the LiDAR sees lies on what the camera sees, and where it would lie best.

    ``score`` is that of the calibration as it is. Lanes: the share of marker points on bright pixels, where
    ``chance`` is that of other ground points. Edges: the mean image gradient at depth discontinuities over that of
    the surroundings, ``chance`` is 1. ``yaw_deg`` and ``pitch_deg`` (``sigma_...``) is the turn about the camera's y
    and x axes under which it would be highest; null where nothing can be told. ``parts`` counts markers or
    discontinuities, ``frames`` the frames that were looked at.
    """

    verdict: Verdict
    sentence: str
    frames: int
    parts: int
    points: int
    score: float | None = None
    chance: float | None = None
    score_at_one_degree: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    sigma_yaw_deg: float | None = None
    sigma_pitch_deg: float | None = None
    curves: list[OffsetCurve] = []
    seconds_per_frame: float | None = None


class ValidationView(Sent):
    """A validation; ``result`` is there when it is done, ``problem`` when it failed."""

    id: UUID
    vehicle_id: UUID
    kind: ValidationKind
    camera: str
    set_id: UUID | None
    recording_id: UUID | None
    result_id: UUID | None
    state: WorkState
    result: Stored[PairScore | RoadScore | None]
    problem: Stored[ProblemView | None]
    job: JobView | None
    created_at: datetime


class DriftStep(Sent):
    """A result of a camera, and how far it is from the one before it and from the first.

    ``sigmas`` is the mount's difference in what both results state, root mean square; ``differs`` says that chance
    makes such a difference once in 1000. Null where a result states no deviations. ``std`` are its own deviations,
    with the spread between models. ``withdrawn`` is null unless its newest publication was withdrawn: then no later
    result is compared with it.
    """

    result_id: UUID
    calibration_id: UUID
    model: str
    at: datetime
    intrinsics: Intrinsics
    transform: SolvedTransform
    std: Deviations
    from_previous: ResultDifference | None
    from_first: ResultDifference | None
    withdrawn: PublicationView | None


class Drift(Sent):
    """A camera's recommended results, the oldest first, with what their order says in a sentence.

    ``next`` is given as ``after`` to get the results before these, and is null if there are none. Each answer
    compares with the first of its own results that was not withdrawn.
    """

    vehicle_id: UUID
    camera: str
    sentence: str
    steps: list[DriftStep]
    next: str | None = None
