"""What requests and answers about validations look like: a calibration tested on data it was not fitted to."""

from __future__ import annotations

from typing import Final, Literal, Self
from uuid import UUID

from pydantic import model_validator

from apexcal.documents.analyses import AnalysisView
from apexcal.documents.base import Document, Name, Received, Stored
from apexcal.documents.calibrations import GivenLens
from apexcal.documents.transforms import Transform

# Of a score of pairs: the columns with one value for each pair.
SINGLE_PAIRS = ("u", "v", "residual_u", "residual_v", "is_wrong")
DATA_BY_KIND: Final = {"pair_validation": "pairs", "lane_validation": "lanes", "edge_validation": "edges"}
Verdict = Literal["agrees", "disagrees", "unknown"]
TurnAxis = Literal["pitch", "yaw", "roll"]
AxisVerdict = Literal["pass", "look", "stop", "not_told"]


class GivenCalibration(Received):
    """A calibration that is not a result here: a lens as a CameraInfo says it, and ``T_camera_lidar``."""

    lens: GivenLens
    transform: Transform


class ValidationRequest(Received):
    """What is tested: the result ``result_id``, or ``calibration``, or else the camera's published calibration."""

    result_id: UUID | None = None
    calibration: GivenCalibration | None = None

    @model_validator(mode="after")
    def _names_one_calibration(self) -> Self:
        if self.result_id is not None and self.calibration is not None:
            raise ValueError("give result_id or calibration, not both")
        return self


class PairValidationRequest(ValidationRequest):
    """Test a camera's calibration on any correspondence set of this camera."""

    kind: Literal["pair_validation"]
    set_id: UUID


class RoadValidationRequest(ValidationRequest):
    """Test a camera's calibration on lane markers, or on depth edges, of a drive."""

    kind: Literal["lane_validation", "edge_validation"]
    recording_id: UUID
    camera: Name


class PairScore(Document):
    """Errors on pairs that the calibration was not fitted to, px.

    ``bias_px`` is the mean of projection minus mark without ``wrong`` marks, ``noise_px`` their noise per coordinate.
    ``turn_deg`` and ``shift_mm`` are the mount error that explains the residuals best, ``sigmas`` its root mean
    square over what is stated. ``forbidden`` pairs have no projection. Columns are in the order of the set's pairs.
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
    u: list[float] = []
    v: list[float] = []
    residual_u: list[float | None] = []
    residual_v: list[float | None] = []
    is_wrong: list[bool] = []


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


class PairValidationView(AnalysisView):
    """A validation on pairs. The columns are for who may see single pairs, and not in lists."""

    kind: Literal["pair_validation"]
    camera: str
    result: Stored[PairScore | None]


class RoadValidationView(AnalysisView):
    """A validation on a drive."""

    kind: Literal["lane_validation", "edge_validation"]
    camera: str
    result: Stored[RoadScore | None]


class AxisCheck(Document):
    """What a drive says of one turn of a mount, about the camera's x (``pitch``), y (``yaw``) or z (``roll``).

    ``turn_deg`` (+- ``sigma_deg``) is where its edges would lie best; null where this drive tells nothing. Of a mount
    that is far off it is known to a degree.
    """

    axis: TurnAxis
    verdict: AxisVerdict
    sentence: str
    turn_deg: float | None = None
    sigma_deg: float | None = None


class CameraCheck(Document):
    """A camera as deployed, held against a drive. ``pictures`` are files: the LiDAR's depth edges in its frames.

    ``axes`` are judged by depth edges. ``lanes``: what lane markers say of pitch and yaw together. ``motion``: how
    the vehicle moves, and what a clock offset would do.
    """

    name: str
    verdict: AxisVerdict
    sentence: str
    frames: int = 0
    axes: list[AxisCheck] = []
    lanes: Verdict = "unknown"
    motion: str = ""
    pictures: list[str] = []


class DriveCheck(Document):
    """What a recording of a drive says of the calibration that is deployed with it."""

    cameras: list[CameraCheck]
    notes: list[str]
